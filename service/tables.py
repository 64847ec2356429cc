"""Results as tables with units, for people at a terminal."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from rich.columns import Columns
from rich.console import Console
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table

from service.aliases import AliasEntry
from service.answer import Answer
from service.explanation import Explanation, Likeness
from service.job import Job
from service.job_records import Progress
from service.keys import AccessKey
from service.model_cases import ModelSummary
from service.model_file import Manifest
from service.proposals import Proposal
from service.scene_answer import AnsweredObject, LeftOut, SceneAnswer

SHADES = " .:-=+*#%@"  # from dark to bright


Thumbnail = Callable[[int], NDArray[np.uint8]]  # the picture (48, 48) of a training object


def show_scene(file: str, answer: SceneAnswer, thumbnail: Thumbnail) -> None:
    """Prints where each object of a scene is and what it resembles, and what was left out."""
    console = Console()
    milliseconds = sum(answer.timings_ms.values())
    console.print(
        f"{file}: {len(answer.objects)} objects on a plane {answer.plane.sensor_height_m:.2f} m below the sensor, "
        f"{milliseconds:.0f} ms",
        markup=False,
        highlight=False,
    )
    for one in answer.objects:
        if one.answer:
            show_answer(f"object {one.number}", one.answer)
        console.print(_place(one), markup=False, highlight=False)
        if one.error:
            console.print(f"not answered: {one.error.detail}", markup=False, highlight=False)
        if one.answer and one.answer.explanation:
            show_explanation(one.answer.explanation, thumbnail)
    if answer.left_out:
        console.print(_left_out(answer.left_out))
    _print_notes(console, answer.warnings)


def _place(one: AnsweredObject) -> str:
    """Where an object is, in a sentence."""
    length, width, height = (f"{100 * metres:.1f}" for metres in one.box.size_m)
    notes = [f"touches {', '.join(map(str, one.touches))}"] if one.touches else []
    notes += [f"perhaps hidden in part by {', '.join(map(str, one.hidden_by))}"] if one.hidden_by else []
    notes += ["at the image's border"] if one.at_border else []
    notes += ["goes on beyond the plane's edge"] if one.beyond_edge else []
    position = ", ".join(f"{metres:.3f}" for metres in one.position_m)
    return "; ".join(
        [f"object {one.number}: at ({position}) m, {length} x {width} x {height} cm, {one.points} points", *notes]
    )


def _left_out(reasons: list[LeftOut]) -> Table:
    table = Table(title="left out", title_justify="left")
    for heading in ("points", "pieces", "because"):
        table.add_column(heading, justify="left" if heading == "because" else "right")
    for left in reasons:
        table.add_row(str(left.points), str(left.pieces or "-"), left.detail)
    return table


def _print_notes(console: Console, warnings: list[str]) -> None:
    for warning in warnings:
        console.print(f"note: {warning}", markup=False, highlight=False)


def show_answer(file: str, answer: Answer) -> None:
    """Prints the concepts that a cloud resembles, best first."""
    milliseconds = sum(answer.timings_ms.values())
    title = (
        f"{escape(file)}  ({answer.model}:{answer.version} at time {answer.time:.2f}; {answer.segments} segments, "
        f"{answer.extent_m * 100:.1f} cm across, novelty {answer.novelty:.2f}, {milliseconds:.0f} ms)"
    )
    listed, total = len(answer.concepts), len(answer.responses)
    caption = f"the first {listed} of {total} concepts" if listed < total else None
    table = Table(title=title, title_justify="left", title_style="bold", caption=caption, caption_justify="left")
    for heading in ("rank", "concept", "name", "response", "distance (Eq. 4)", "prototypes", "time"):
        table.add_column(heading, justify="left" if heading == "name" else "right")
    for concept in answer.concepts:
        table.add_row(
            str(concept.rank),
            str(concept.id),
            escape(concept.name or "-"),
            f"{concept.response:.3f}",
            f"{concept.distance:.3f}",
            str(concept.prototypes),
            f"{concept.time:.2f}",
        )
    console = Console()
    console.print(table)
    _print_notes(console, answer.warnings)
    if answer.truncated:
        console.print("note: there were more constellations than are looked at; the smallest were left out")


def show_keys(keys: Sequence[AccessKey], revoked: Collection[str]) -> None:
    """Prints access keys, without their secrets."""
    table = Table()
    for heading in ("id", "name", "allows to", "limits", "created", "state"):
        table.add_column(heading)
    for key in keys:
        limits = {
            "a second": key.rate,
            "at a time": key.concurrency,
            "bytes": key.max_body,
            "points": key.max_points,
            "clouds a batch": key.max_batch,
        }
        table.add_row(
            key.id,
            escape(key.name),
            ", ".join(key.scopes),
            ", ".join(f"{most:.12g} {what}" for what, most in limits.items() if most is not None) or "-",
            f"{key.created:%Y-%m-%d %H:%M} UTC",
            "revoked" if key.id in revoked else "valid",
        )
    Console().print(table)


def show_explanation(explanation: Explanation, thumbnail: Thumbnail) -> None:
    """Prints why an answer is what it is.

    Args:
        explanation: of the answer.
        thumbnail: gives the picture (48, 48) of a training object.
    """
    console = Console()
    console.print(_segments(explanation))
    console.print(_fired_vertices(explanation))
    for concept in explanation.concepts:
        console.print(f"concept {concept.id}: its prototypes nearest to the cloud, by the distance of Eq. 4")
        console.print(_pictures(concept.nearest, thumbnail))
    console.print("training objects most like the cloud as a whole, by JSD: its novelty is by the first")
    console.print(_pictures(explanation.wholes, thumbnail))


def _segments(explanation: Explanation) -> Table:
    table = Table(title="segments", title_justify="left")
    for heading in ("no.", "share", "across", "centre (m)", "beside", "words"):
        table.add_column(heading)
    table.add_column("most like (JSD)", no_wrap=True)
    for number, segment in enumerate(explanation.segments):
        table.add_row(
            str(number),
            f"{segment.share:.0%}",
            f"{segment.extent_m * 100:.1f} cm",
            " ".join(f"{x:.2f}" for x in segment.centroid_m),
            _numbers(segment.adjacent),
            _numbers(segment.words),
            _likenesses(segment.nearest),
        )
    return table


def _fired_vertices(explanation: Explanation) -> Table:
    caption = "v: index of stimuli; H_f: hierarchies; by: segments that fired it; T^v: number of motif prototypes"
    table = Table(title="motif vertices that fired most", title_justify="left", caption=caption)
    for heading in ("v", "H_f", "level", "words", "stimulus", "by", "T^v"):
        table.add_column(heading)
    table.add_column("nearest (JSD)", no_wrap=True)
    for fired in explanation.vertices:
        table.add_row(
            str(fired.vertex),
            _numbers([fired.hierarchy, *fired.also_in]),
            str(fired.level),
            _numbers(fired.words),
            f"{fired.stimulus:.3f}",
            _numbers(fired.segments),
            str(fired.prototypes),
            _likenesses(fired.nearest),
        )
    return table


def _pictures(objects: list[Likeness], thumbnail: Thumbnail) -> Columns:
    return Columns(
        Panel(_draw(thumbnail(near.object)), title=_likenesses([near]), padding=0, expand=False) for near in objects
    )


def _draw(image: NDArray[np.uint8]) -> str:
    """A picture in letters, each of 4 x 2 pixels, as letters are twice as high as wide."""
    rows, columns = image.shape
    mean = image.reshape(rows // 4, 4, columns // 2, 2).mean(axis=(1, 3))
    return "\n".join("".join(SHADES[int(grey) * len(SHADES) // 256] for grey in line) for line in mean.tolist())


def _likenesses(objects: list[Likeness]) -> str:
    return "\n".join(f"{escape(near.key)} {near.distance:.3f}" for near in objects)


def _numbers(numbers: list[int]) -> str:
    return " ".join(map(str, numbers)) or "-"


def show_models(models: list[ModelSummary]) -> None:
    """Prints the models of a store."""
    table = Table()
    for heading in ("model", "versions", "aliases"):
        table.add_column(heading)
    for model in models:
        aliases = ", ".join(f"{alias} = {version}" for alias, version in model.aliases.items())
        name = f"{model.name} (built in)" if model.built_in else model.name
        table.add_row(name, ", ".join(map(str, model.versions)), aliases or "-")
    Console().print(table)


def show_manifest(manifest: Manifest, aliases: dict[str, list[AliasEntry]]) -> None:
    """Prints how a model was made, and what its aliases have meant."""
    table = Table(
        title=f"{manifest.name}:{manifest.version}", title_justify="left", title_style="bold", show_header=False
    )
    rows = {
        "created": f"{manifest.created:%Y-%m-%d %H:%M:%S} UTC",
        "seed": manifest.seed,
        "source": _pairs(manifest.source),
        "counts": _pairs(manifest.counts),
        "epsilon_max": f"{manifest.epsilon_max:.3f} (filtration time, 0 to 1)",
        "notes": "\n".join(manifest.notes) or "-",
        **{f"parameters: {stage}": _pairs(params) for stage, params in manifest.params.model_dump().items()},
        "files": "\n".join(f"{name}, {c.size} bytes, sha256 {c.sha256}" for name, c in manifest.contents.items()),
        "libraries": _pairs(manifest.libraries),
        **{
            f"@{alias}": "\n".join(f"{entry.at} {entry.action} {entry.version}" for entry in entries)
            for alias, entries in aliases.items()
        },
    }
    for name, value in rows.items():
        table.add_row(name, escape(str(value)))
    Console().print(table)


def show_names(names: Mapping[int, str], carried: Mapping[int, str]) -> None:
    """Prints the names of concepts, and of which version they were carried over."""
    table = Table()
    table.add_column("concept", justify="right")
    table.add_column("name")
    table.add_column("carried over from")
    for concept, name in names.items():
        table.add_row(str(concept), escape(name), carried.get(concept, "-"))
    Console().print(table)


def show_proposals(proposals: list[Proposal], *, applied: bool) -> None:
    """Prints the names that are proposed for concepts, and why."""
    table = Table(caption="they are called so now" if applied else "nothing is stored; --apply gives these names")
    for heading in ("concept", "proposed", "now", "share", "of clouds", "their labels"):
        table.add_column(heading, justify="right" if heading in ("concept", "share", "of clouds") else "left")
    for proposal in proposals:
        table.add_row(
            str(proposal.concept),
            escape(proposal.name or f"- ({' and '.join(proposal.tied)} tie)"),
            escape(proposal.current or "-"),
            f"{proposal.share:.0%}",
            str(proposal.support),
            escape(", ".join(f"{label} {count}" for label, count in proposal.labels.items())),
        )
    Console().print(table)


def show_jobs(jobs: list[Job]) -> None:
    """Prints jobs, a row each."""
    table = Table()
    table.add_column("job", no_wrap=True, min_width=max((len(job.id) for job in jobs), default=3))  # to be copied whole
    for heading in ("state", "makes", "of", "submitted (UTC)", "outcome"):
        table.add_column(heading)
    for job in jobs:
        submitted = f"{job.submitted:%Y-%m-%d %H:%M:%S}"
        table.add_row(job.id, job.state, *map(escape, _asked(job)), submitted, escape(_outcome(job)))
    Console().print(table)


def show_job(job: Job) -> None:
    """Prints a job with all that is known of it."""
    table = Table(title=f"job {job.id}", title_justify="left", title_style="bold", show_header=False)
    times = {"submitted": job.submitted, "started": job.started, "finished": job.finished}
    rows = {
        "state": job.state,
        **{name: f"{time:%Y-%m-%d %H:%M:%S} UTC" if time else "-" for name, time in times.items()},
        "worker": job.worker or "-",
        "outcome": _outcome(job),
        **{name: str(value) for name, value in job.spec.model_dump(exclude={"params"}).items() if value is not None},
        **{f"parameters: {stage}": _pairs(params) for stage, params in _params_of(job).items()},
    }
    for name, value in rows.items():
        table.add_row(name, escape(value))
    Console().print(table)


def _asked(job: Job) -> tuple[str, str]:
    """What a job makes or judges, and of what."""
    spec = job.spec
    if spec.kind == "evaluate":
        return spec.model, f"judged by dataset {spec.dataset}"
    if spec.kind == "simulate":
        return f"dataset {spec.dataset}", f"{spec.count} simulated"
    sources = [f"what {spec.extend} learnt from"] if spec.extend else []
    sources += [f"dataset {name}" for name in spec.datasets]
    if spec.simulate is not None:
        sources.append(f"{spec.simulate} simulated")
    if spec.clouds is not None:
        sources.append(spec.clouds)
    return spec.name, ", ".join(sources)


def _params_of(job: Job) -> dict[str, dict[str, object]]:
    return job.spec.params.model_dump() if job.spec.kind == "train" else {}


def _outcome(job: Job) -> str:
    if job.error:
        return f"{job.error.type}: {job.error.detail}"
    result = job.result
    if result is None:
        return underway(job.progress) if job.progress and job.state == "running" else "-"
    if result.kind == "simulate":
        return f"{result.clouds} clouds in dataset {result.dataset}"
    figures = ", ".join(f"{name} {value:.3f}" for name, value in (result.metrics or {}).items())
    judged = f" ({figures})" if figures else ""
    if result.kind == "evaluate":
        return f"{result.model}:{result.version} judged by {result.clouds} clouds{judged}"
    left_out = f", {result.left_out} left out" if result.left_out else ""
    stays = ", not promoted" if not result.promoted else ""
    return f"{result.model}:{result.version} from {result.clouds} clouds{left_out}{judged}{stays}"


def underway(progress: Progress) -> str:
    """How far a job is, in a line."""
    done = f" {progress.done} of {progress.total}" if progress.total else ""
    left = f", about {progress.left_s:.0f} s left" if progress.left_s is not None else ""
    return f"{progress.stage}{done} (stage {progress.stages_done + 1} of {progress.stages}{left})"


def _pairs(record: object) -> str:
    return ", ".join(f"{key} = {value}" for key, value in dict(record).items()) or "-"  # type: ignore[call-overload]
