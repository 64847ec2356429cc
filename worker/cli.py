"""The command line of the training worker: `shape-concepts-worker`.

What a command needs is imported when it runs. Results go to stdout, everything else to stderr. Exit codes: 0 all went
well, 1 something failed, 2 the command was not understood.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service import __version__
from service.commands.options import json_option, settings_of, store_option
from service.commands.reporting import ReportingGroup, examples

if TYPE_CHECKING:
    from worker.config import TrainingConfig
    from worker.evaluation.vector_files import VectorFile
    from worker.sources import Source

workers_option = click.option(
    "--workers", type=click.IntRange(min=1), default=os.cpu_count() or 1, show_default="all cores", help="Processes."
)
cluster_option = click.option(
    "--cluster",
    metavar="ADDRESS",
    help="Scheduler of a Dask cluster that does the work, tcp://HOST:8786.  [default: SHAPE_CONCEPTS_CLUSTER, or none]",
)
config_option = click.option(
    "--config", metavar="FILE", type=click.Path(path_type=Path), help="TOML or JSON file with parameters of the stages."
)


@click.group(
    cls=ReportingGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog=examples(
        "shape-concepts-worker simulate --count 250 --seed 7 --out clouds",
        "shape-concepts-worker train --simulate 250 --name default",
    ),
)
@click.version_option(__version__, prog_name="shape-concepts-worker")
def main() -> None:
    """Simulates abstract objects, learns shape concepts from clouds, and publishes models."""


@main.command(
    epilog=examples(
        "shape-concepts-worker simulate --count 250 --seed 7 --out clouds",
        "shape-concepts-worker simulate --count 20 --seed 1 --out boxes-and-balls --orders 1-2 --noise none",
        "shape-concepts-worker simulate --count 50 --seed 7 --out clouds --renderer raycast",
        "shape-concepts-worker simulate --count 100000 --out clouds --cluster tcp://10.0.0.1:8786",
    )
)
@click.option("--count", type=click.IntRange(min=1), required=True, help="Number of objects.")
@click.option("--seed", type=click.IntRange(min=0), default=7, show_default=True, help="Of all random draws.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True, metavar="DIR", help="Folder.")
@click.option("--orders", metavar="RANGE", help="Prototype orders, each for as many objects: 1-5, 3, 1,2,5.")
@click.option("--noise", type=click.Choice(["kinect", "none"]), help="The sensor's noise.  [default: kinect]")
@click.option("--renderer", type=click.Choice(["sapien", "raycast"]), help="What sees the scene.  [default: sapien]")
@config_option
@workers_option
@cluster_option
@json_option
def simulate(
    count: int,
    seed: int,
    out: Path,
    orders: str | None,
    noise: str | None,
    renderer: str | None,
    config: Path | None,
    workers: int,
    cluster: str | None,
    as_json: bool,
) -> None:
    """Simulates abstract objects and writes their clouds.

    They are composed by the paper's Alg. 1. Clouds are PLY; contact-sheet.png beside them shows the first 400.
    """
    from worker.progress import watching
    from worker.sharing import shared_out
    from worker.simulation import simulate as simulate_objects
    from worker.simulation.writing import write

    params = _config(config).simulation.but(orders=_orders(orders), noise=noise, renderer=renderer)
    with watching() as watch, shared_out(workers, settings_of(cluster=cluster).cluster):
        watch.stage("simulating")
        objects = simulate_objects(count, seed, params=params)
        write(watch.count(objects, count), out)
    result = {"clouds": count, "seed": seed, "folder": str(out), "contact_sheet": str(out / "contact-sheet.png")}
    click.echo(
        json.dumps(result) if as_json else f"Wrote {count} cloud{'s' * (count > 1)} and contact-sheet.png to {out}."
    )


@main.command(
    epilog=examples(
        "shape-concepts-worker train --simulate 250 --name default",
        "shape-concepts-worker train --clouds scans --name workshop --config parameters.toml",
        "shape-concepts-worker train --simulate 1000 --seed 3 --name default --alias staging",
        "shape-concepts-worker train --simulate 10000 --name default --cluster tcp://10.0.0.1:8786",
    )
)
@click.option("--clouds", type=click.Path(path_type=Path), metavar="DIR", help="Learn from all clouds of this folder.")
@click.option("--simulate", "count", type=click.IntRange(min=2), metavar="COUNT", help="Learn from simulated objects.")
@click.option("--seed", type=click.IntRange(min=0), default=7, show_default=True, help="Of all random draws.")
@click.option("--name", required=True, help="Of the model: lower case letters, digits and hyphens.")
@click.option("--alias", default="production", show_default=True, help="What shall mean the new version.")
@click.option("--renderer", type=click.Choice(["sapien", "raycast"]), help="What sees the scene.  [default: sapien]")
@config_option
@workers_option
@cluster_option
@json_option
@store_option
def train(
    clouds: Path | None,
    count: int | None,
    seed: int,
    name: str,
    alias: str,
    renderer: str | None,
    config: Path | None,
    workers: int,
    cluster: str | None,
    as_json: bool,
    store: str | None,
) -> None:
    """Learns shape concepts and publishes them as a model.

    Each time makes the next version. The clouds are those of a folder, one object each as a depth camera saw it, or
    simulated ones. Clouds that cannot be learnt from are named and left out. Concepts that are still the same as in the
    version that the alias meant before keep the names that people gave them.
    """
    from worker.processes import prepare

    settings = settings_of(store=store, cluster=cluster)
    if count is not None and settings.cluster is None:
        prepare(renderer)
    from service.carrying import carry_from_earlier
    from service.model_file import check_name
    from service.store import ModelStore
    from worker.learning.train import train as learn
    from worker.progress import watching
    from worker.sharing import shared_out
    from worker.sources import Simulation

    check_name(name, " model")
    check_name(alias, "n alias")
    models = ModelStore(settings.store)
    chosen = _config(config)
    source = _source(clouds, count, seed, chosen, renderer)
    with watching() as watch, shared_out(workers, settings.cluster):
        clouds_to_learn = source.unmade() if isinstance(source, Simulation) else source
        model, refused = learn(watch.count(clouds_to_learn, source.count), chosen.model, seed, watch.stage)
        watch.stage("publishing")
        before = models.aliases(name).get(alias)
        manifest = models.publish(model, name=name, seed=seed, source=source.describe(), alias=None)
        carried = carry_from_earlier(models, f"{name}:{before}" if before else None, (name, manifest.version))
        models.promote(name, manifest.version, alias, only_forward=True)
    left_out = [(key, str(error)) for key, error in (*source.refused, *refused)]
    for key, why in left_out:
        click.echo(f"Left out: {key}: {why}", err=True)
    if as_json:
        told = {"left_out": dict(left_out), "names_carried": [each.model_dump() for each in carried]}
        click.echo(json.dumps(manifest.model_dump(mode="json") | told))
    else:
        counts = manifest.counts
        click.echo(
            f"Published {name}:{manifest.version} ({name}@{alias}): {counts['concepts']} concepts "
            f"from {counts['objects']} objects, at filtration time {manifest.epsilon_max:.2f}."
        )
        if carried:
            click.echo(f"{len(carried)} names were carried over from {name}:{before}.")


@main.command(
    epilog=examples(
        "shape-concepts-worker evaluate --model default --labels scans/labels.csv --report report",
        "shape-concepts-worker evaluate --model default:3 --labels scans/labels.csv --report report --robustness",
        "shape-concepts-worker evaluate --model default --labels scans/labels.csv --other occluded/labels.csv "
        "--baseline VFH=vfh.csv --report report",
    )
)
@click.option("--model", required=True, metavar="NAME", help="NAME, NAME@ALIAS or NAME:VERSION.")
@click.option(
    "--labels",
    required=True,
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="CSV with the columns file (relative to it) and category, and optionally group and source.",
)
@click.option(
    "--report", required=True, metavar="DIR", type=click.Path(path_type=Path, file_okay=False), help="Folder."
)
@click.option(
    "--other",
    "others",
    multiple=True,
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="Labels of another set, whose clouds are judged by those of the first; may be repeated.",
)
@click.option(
    "--baseline",
    "baselines",
    multiple=True,
    metavar="NAME=FILE",
    help="CSV of another program's vectors, path,v1,v2,..., to be judged beside the model; may be repeated.",
)
@click.option(
    "--robustness/--no-robustness",
    default=False,
    show_default=True,
    help="Answer each cloud rescaled, thinned, with noise, and partly hidden as well: 18 answers instead of one.",
)
@workers_option
@json_option
@store_option
def evaluate(
    model: str,
    labels: Path,
    report: Path,
    others: tuple[Path, ...],
    baselines: tuple[str, ...],
    robustness: bool,
    workers: int,
    as_json: bool,
    store: str | None,
) -> None:
    """Judges a model by labelled clouds, and writes a report.

    It is report.html, and report.json for programs. Labels judge, they never teach the model. Figures are balanced over
    labels, 1 is best. Clouds that the model refuses are named and in no figure. Ready-made descriptors of whole clouds
    are judged beside the model.
    """
    from joblib import parallel_config

    from service.store import ModelStore
    from worker import tables
    from worker.evaluation.evaluate import Request
    from worker.evaluation.evaluate import evaluate as judge
    from worker.evaluation.page import write_page
    from worker.evaluation.report import write_report
    from worker.progress import watching

    models = ModelStore(settings_of(store=store).store)
    shape_model, manifest = models.load(*models.resolve(model))
    called = ["evaluate", "--model", model, "--labels", str(labels), "--report", str(report)]
    called += [word for other in others for word in ("--other", str(other))]
    called += [word for baseline in baselines for word in ("--baseline", baseline)]
    called += ["--robustness"] * robustness
    request = Request(
        table=labels,
        command=shlex.join(["shape-concepts-worker", *called]),
        vectors=_vector_files(baselines),
        others=others,
        robustness=robustness,
    )
    with watching() as watch, parallel_config(backend="loky", n_jobs=workers):
        judged = judge(shape_model, manifest, request, watch.stage, watch.count)
    file, page = write_report(judged, report), write_page(judged, shape_model, report)
    for name, why in judged.data.unanswered.items():
        click.echo(f"Unanswered: {name}: {why}", err=True)
    if as_json:
        click.echo(judged.model_dump_json())
    else:
        tables.show_report(judged)
        click.echo(f"Wrote {file} and {page}.")


@main.command(
    epilog=examples(
        "shape-concepts-worker promote default:2 --labels scans/labels.csv",
        "shape-concepts-worker promote default@staging --labels scans/labels.csv --tolerance 0.01 --json",
    )
)
@click.argument("model", metavar="NAME:VERSION")
@click.option(
    "--labels",
    required=True,
    metavar="FILE",
    type=click.Path(path_type=Path),
    help="CSV with the columns file (relative to it) and category, and optionally group and source.",
)
@click.option("--alias", default="production", show_default=True, help="Alias to move.")
@click.option(
    "--tolerance",
    type=click.FloatRange(0, 1),
    metavar="SHARE",
    help="By how much each figure may be lower than before.  [default: 0.02]",
)
@workers_option
@json_option
@store_option
def promote(
    model: str, labels: Path, alias: str, tolerance: float | None, workers: int, as_json: bool, store: str | None
) -> None:
    """Lets an alias mean a version if that is not worse.

    It and the one that the alias means now are judged by the labelled clouds that both answer: nearest neighbour,
    support vector machine, and the two figures of regions, all balanced over labels; and the share of the clouds that
    they answer. If one of these is lower by more than is tolerated, the alias stays, and the exit code is 1.
    """
    from joblib import parallel_config

    from service.model_file import check_name
    from service.store import ModelStore
    from worker.evaluation.promotion import TOLERANCE, Rule
    from worker.progress import watching
    from worker.promoting import promote_by_rule

    check_name(alias, "n alias")
    if not {":", "@"} & set(model):
        raise click.BadParameter(f"say which version shall be meant, as {model}:2.", param_hint="NAME:VERSION")
    models = ModelStore(settings_of(store=store).store)
    rule = Rule(tolerance=TOLERANCE if tolerance is None else tolerance)
    with watching() as watch, parallel_config(backend="loky", n_jobs=workers):
        outcome = promote_by_rule(models, model, alias, labels, rule, watch.stage, watch.count)
    if as_json:
        click.echo(outcome.model_dump_json())
    else:
        for reason in outcome.reasons:
            click.echo(reason)
        click.echo(outcome.sentence())
    if not outcome.promoted:
        sys.exit(1)


@main.command(epilog=examples("shape-concepts-worker run", "shape-concepts-worker run --worker gpu-box-2 --workers 8"))
@click.option(
    "--worker", "name", metavar="NAME", help="Of this worker, the same at every start and no other's.  [default: host]"
)
@workers_option
@cluster_option
@store_option
def run(name: str | None, workers: int, cluster: str | None, store: str | None) -> None:
    """Takes jobs from the queue and does them, one after the other.

    The queue is the database SHAPE_CONCEPTS_JOBS_URL. At SIGTERM or Ctrl-C the worker ends, exit code 0; a job that it
    was doing goes on where it was, step by step, when the worker of that name starts again, even after a kill -9.
    """
    import platform

    from worker.jobs import run as take_jobs

    take_jobs(settings_of(store=store, cluster=cluster), name or platform.node() or "worker", workers)


def _source(folder: Path | None, count: int | None, seed: int, config: TrainingConfig, renderer: str | None) -> Source:
    from worker.sources import Folder, Simulation

    if folder is not None and count is None:
        return Folder(folder)
    if folder is None and count is not None:
        return Simulation(count, seed, config.simulation.but(renderer=renderer))
    raise click.UsageError("Give one of --clouds DIR and --simulate COUNT.")


def _vector_files(named: tuple[str, ...]) -> tuple[VectorFile, ...]:
    """What each "NAME=FILE" holds."""
    from worker.evaluation.vector_files import read_vector_file

    pairs = [text.partition("=") for text in named]
    if wrong := [text for text, (name, _, file) in zip(named, pairs, strict=True) if not name or not file]:
        raise click.BadParameter(f"'{wrong[0]}' is no NAME=FILE.", param_hint="--baseline")
    return tuple(read_vector_file(name, Path(file)) for name, _, file in pairs)


def _config(file: Path | None) -> TrainingConfig:
    from worker.config import TrainingConfig, read_config

    return read_config(file) if file else TrainingConfig()


def _orders(text: str | None) -> tuple[int, ...] | None:
    """The orders that "1-5", "3" or "1,2,5" name."""
    if text is None:
        return None
    from worker.simulation.params import MAX_ORDER

    try:
        spans = [[int(end) for end in part.split("-")] for part in text.split(",")]
        if any(not 1 <= span[0] <= span[-1] <= MAX_ORDER for span in spans):
            raise click.BadParameter(f"orders go from 1 to {MAX_ORDER}, not '{text}'.", param_hint="--orders")
        return tuple(order for span in spans for order in range(span[0], span[-1] + 1))
    except ValueError:
        raise click.BadParameter(
            f"'{text}' is no range of orders, such as 1-5, 3 or 1,2,5.", param_hint="--orders"
        ) from None


if __name__ == "__main__":
    main()
