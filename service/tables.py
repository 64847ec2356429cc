"""Results as tables with units, for people at a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from service.aliases import AliasEntry
from service.answer import Answer
from service.application import ModelSummary
from service.jobs import Job
from service.model_file import Manifest


def show_answer(file: str, answer: Answer) -> None:
    """Prints the concepts that a cloud resembles, best first."""
    total = sum(answer.timings_ms.values())
    title = (
        f"{escape(file)}  ({answer.model}:{answer.version} at time {answer.time:.2f}; {answer.segments} segments, "
        f"{answer.extent_m * 100:.1f} cm across, novelty {answer.novelty:.2f}, {total:.0f} ms)"
    )
    table = Table(title=title, title_justify="left", title_style="bold")
    for heading in ("rank", "concept", "name", "response", "distance (Eq. 4)", "prototypes"):
        table.add_column(heading, justify="left" if heading == "name" else "right")
    for concept in answer.concepts:
        table.add_row(
            str(concept.rank),
            str(concept.id),
            escape(concept.name or "-"),
            f"{concept.response:.3f}",
            f"{concept.distance:.3f}",
            str(concept.prototypes),
        )
    console = Console()
    console.print(table)
    for warning in answer.warnings:
        console.print(f"note: {warning}", markup=False, highlight=False)
    if answer.truncated:
        console.print("note: there were more constellations than are looked at; the smallest were left out")


def show_models(models: list[ModelSummary]) -> None:
    """Prints the models of a store."""
    table = Table()
    for heading in ("model", "versions", "aliases"):
        table.add_column(heading)
    for model in models:
        aliases = ", ".join(f"{alias} = {version}" for alias, version in model.aliases.items())
        table.add_row(model.name, ", ".join(map(str, model.versions)), aliases or "-")
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


def show_jobs(jobs: list[Job]) -> None:
    """Prints jobs, a row each."""
    table = Table()
    for heading in ("job", "state", "model", "clouds", "submitted (UTC)", "outcome"):
        table.add_column(heading)
    for job in jobs:
        source = job.spec.clouds or f"{job.spec.simulate} simulated"
        submitted = f"{job.submitted:%Y-%m-%d %H:%M:%S}"
        table.add_row(job.id, job.state, job.spec.name, escape(source), submitted, escape(_outcome(job)))
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
        **{f"parameters: {stage}": _pairs(params) for stage, params in job.spec.params.model_dump().items()},
    }
    for name, value in rows.items():
        table.add_row(name, escape(value))
    Console().print(table)


def _outcome(job: Job) -> str:
    if job.result:
        left_out = f", {job.result.left_out} left out" if job.result.left_out else ""
        return f"{job.result.model}:{job.result.version} from {job.result.clouds} clouds{left_out}"
    return f"{job.error.type}: {job.error.detail}" if job.error else "-"


def _pairs(record: object) -> str:
    return ", ".join(f"{key} = {value}" for key, value in dict(record).items()) or "-"  # type: ignore[call-overload]
