"""`shape-concepts jobs`: training, evaluation and simulation that workers do."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from service.commands.options import application_of, json_option
from service.commands.reporting import done, examples

if TYPE_CHECKING:
    from service.job_records import LogLine
    from service.job_specs import JobSpec

id_argument = click.argument("job", metavar="ID")


@click.group()
def jobs() -> None:
    """Submits jobs and tells what became of them.

    Workers (shape-concepts-worker run) take jobs from the database SHAPE_CONCEPTS_JOBS_URL, in the order in which
    they were submitted, and publish to their own model store.
    """


@jobs.command(
    epilog=examples(
        "shape-concepts jobs submit --simulate 250 --name default",
        "shape-concepts jobs submit --dataset scans --dataset more-scans --simulate 250 --name workshop",
        "shape-concepts jobs submit --dataset scans --name default --parent default --labelled test-scans",
        "shape-concepts jobs submit --extend default --dataset new-scans --labelled test-scans --promote not-worse "
        "--name default",
        "shape-concepts jobs submit --evaluate default@staging --dataset test-scans",
        "shape-concepts jobs submit --simulate 1000 --into toys",
        "shape-concepts jobs submit --simulate 1000 --name default --id nightly-2025-01-31 --timeout 3600",
    )
)
@click.option("--name", help="Of the model to be learnt: lower-case letters, digits and hyphens.")
@click.option("--alias", default="production", show_default=True, help="What shall mean the new version.")
@click.option("--simulate", type=int, metavar="COUNT", help="Learn from simulated objects.")
@click.option("--dataset", "datasets", multiple=True, metavar="NAME", help="Learn from a dataset; may be repeated.")
@click.option(
    "--clouds",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Learn from all clouds of a folder that workers see.",
)
@click.option("--labelled", metavar="NAME", help="Dataset by whose labels the model is judged before it is published.")
@click.option("--parent", metavar="MODEL", help="The model that the new version follows, for its manifest.")
@click.option("--extend", metavar="MODEL", help="Learn from what this model learnt from first; it is the parent.")
@click.option(
    "--promote",
    type=click.Choice(["always", "not-worse", "never"]),
    default="always",
    show_default=True,
    help="Whether the alias moves: not-worse judges both versions by --labelled.",
)
@click.option(
    "--tolerance", type=float, default=0.02, show_default=True, help="How much lower a figure is not worse yet."
)
@click.option("--into", metavar="NAME", help="Add the simulated clouds to a dataset instead of learning.")
@click.option("--evaluate", metavar="MODEL", help="Judge a model by the labels of a dataset instead of learning.")
@click.option("--robustness", is_flag=True, help="Judge it by disturbed clouds as well.")
@click.option("--seed", type=int, default=7, show_default=True, help="Of all random draws.")
@click.option("--preset", default="default", show_default=True, help="Parameters of all stages: default or paper.")
@click.option("--renderer", type=click.Choice(["sapien", "raycast"]), help="What sees the scene.  [default: sapien]")
@click.option("--timeout", type=float, metavar="SECONDS", help="Fails when it was at work for longer.")
@click.option("--attempts", type=int, default=5, show_default=True, help="Of a stage that lacks the store, say.")
@click.option("--id", "job_id", metavar="ID", help="Names the job: submitted twice, it is one job.  [default: random]")
@json_option
def submit(job_id: str | None, as_json: bool, **given: Any) -> None:
    """Puts a job into the queue.

    It learns a model; with --evaluate it judges one, with --into it simulates clouds into a dataset.
    """
    job = application_of(None).training.submit(_spec(given), job_id, local=True)
    done(job.model_dump(mode="json"), f"Job {job.id} is {job.state}.", as_json)


@jobs.command(
    "list",
    epilog=examples(
        "shape-concepts jobs list",
        "shape-concepts jobs list --state failed",
        "shape-concepts jobs list --limit 100 --before nightly-2025-01-31 --json",
    ),
)
@click.option("--limit", type=click.IntRange(1, 1000), default=20, show_default=True, help="How many.")
@click.option("--before", metavar="ID", help="Those that were submitted before this one.")
@click.option("--state", type=click.Choice(["queued", "running", "done", "failed", "cancelled"]), help="Of the jobs.")
@json_option
def list_jobs(limit: int, before: str | None, state: Any, as_json: bool) -> None:
    """Lists jobs, the one submitted last first."""
    page = application_of(None).training.jobs(limit, before, state)
    if as_json:
        click.echo(json.dumps({"jobs": [job.model_dump(mode="json") for job in page.jobs], "next": page.next}))
    else:
        from service import tables

        tables.show_jobs(page.jobs)
        if page.next:
            click.echo(f"There are more: --before {page.next}")


@jobs.command(
    "show",
    epilog=examples(
        "shape-concepts jobs show nightly-2025-01-31", "shape-concepts jobs show nightly-2025-01-31 --json"
    ),
)
@id_argument
@json_option
def show_job(job: str, as_json: bool) -> None:
    """Shows a job, how far it is, and what came of it."""
    found = application_of(None).training.job(job)
    if as_json:
        click.echo(found.model_dump_json())
    else:
        from service import tables

        tables.show_job(found)


@jobs.command(epilog=examples("shape-concepts jobs watch nightly-2025-01-31"))
@id_argument
@json_option
def watch(job: str, as_json: bool) -> None:
    """Tells of a job as it goes on, until it is over.

    With --json, there is a line for each change. The exit code is 0 when it is done, 1 when it failed or was cancelled.
    """
    from service import tables

    look = None
    for look in application_of(None).training.follow(job):
        if as_json:
            lines = [_as_json(line) for line in look.lines]
            click.echo(json.dumps({"job": look.job.model_dump(mode="json"), "log": lines}))
        else:
            for line in look.lines:
                click.echo(_as_text(line))
            if look.job.progress and look.job.state == "running":
                click.echo(tables.underway(look.job.progress), err=True)
    if look is not None and look.job.state != "done":
        reason = f": {look.job.error.detail}" if look.job.error else ""
        raise click.ClickException(f"Job {job} is {look.job.state}{reason}")


@jobs.command(epilog=examples("shape-concepts jobs logs nightly-2025-01-31"))
@id_argument
@json_option
def logs(job: str, as_json: bool) -> None:
    """Prints the log of a job; with --json a line each."""
    after = 0
    training = application_of(None).training
    while lines := training.look(job, after).lines:
        for line in lines:
            click.echo(json.dumps(_as_json(line)) if as_json else _as_text(line))
        after = lines[-1].number


@jobs.command(epilog=examples("shape-concepts jobs report 8e03978e-40d5-43dd-bc93-6894a57f9324 --out report"))
@id_argument
@click.option("--out", required=True, metavar="DIR", type=click.Path(path_type=Path, file_okay=False), help="Folder.")
def report(job: str, out: Path) -> None:
    """Fetches the report of a job that has judged a model.

    It is report.html and, for programs, report.json.
    """
    from service.training import REPORTS

    training = application_of(None).training
    files = {name: training.report(job, name).data for name in REPORTS}
    out.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (out / name).write_bytes(data)
    click.echo(f"Wrote {' and '.join(files)} to {out}.")


@jobs.command(epilog=examples("shape-concepts jobs cancel nightly-2025-01-31"))
@id_argument
@json_option
def cancel(job: str, as_json: bool) -> None:
    """Takes a job from the queue, or stops it.

    One that is over stays as it is.
    """
    found = application_of(None).training.cancel(job)
    done(found.model_dump(mode="json"), f"Job {found.id} is {found.state}.", as_json)


@jobs.command(epilog=examples("shape-concepts jobs retry nightly-2025-01-31"))
@id_argument
@json_option
def retry(job: str, as_json: bool) -> None:
    """Lets a failed or cancelled job go on with the stage it ended at."""
    found = application_of(None).training.retry(job)
    done(found.model_dump(mode="json"), f"Job {found.id} is {found.state}.", as_json)


def _spec(given: dict[str, Any]) -> JobSpec:
    """The job that the options describe."""
    from service.engine.params import ModelParams
    from service.job_specs import read_spec

    common = {"timeout": given["timeout"], "attempts": given["attempts"]}
    simulation = {"renderer": given["renderer"]} if given["renderer"] else {}
    if given["evaluate"]:
        _refuse(given, "--evaluate", ("name", "into", "simulate", "clouds", "labelled", "parent", "extend"))
        if len(given["datasets"]) != 1:
            raise click.UsageError("--evaluate needs one --dataset NAME, whose labels judge the model.")
        return read_spec(
            {
                "kind": "evaluate",
                "model": given["evaluate"],
                "dataset": given["datasets"][0],
                "robustness": given["robustness"],
                **common,
            }
        )
    if given["into"]:
        _refuse(given, "--into", ("name", "datasets", "clouds", "labelled", "parent", "extend", "robustness"))
        if given["simulate"] is None:
            raise click.UsageError("--into needs --simulate COUNT.")
        asked = {"dataset": given["into"], "count": given["simulate"], "seed": given["seed"], "simulation": simulation}
        return read_spec({"kind": "simulate", **asked, **common})
    if not given["name"]:
        raise click.UsageError("Give --name MODEL to learn, --evaluate MODEL, or --simulate COUNT --into DATASET.")
    _refuse(given, "--name", ("robustness",))
    named = {key: given[key] for key in ("name", "alias", "datasets", "simulate", "labelled", "parent", "seed")}
    named |= {key: given[key] for key in ("extend", "promote", "tolerance")}
    clouds = str(given["clouds"].absolute()) if given["clouds"] else None
    params = ModelParams.preset(given["preset"])
    return read_spec({**named, "clouds": clouds, "params": params, "simulation": simulation, **common})


def _refuse(given: dict[str, Any], beside: str, options: tuple[str, ...]) -> None:
    """Refuses options that would be without effect."""
    if wrong := [option for option in options if given[option]]:
        raise click.UsageError(f"{beside} does not go with --{'dataset' if wrong[0] == 'datasets' else wrong[0]}.")


def _as_json(line: LogLine) -> dict[str, Any]:
    return {"number": line.number, "at": datetime.fromtimestamp(line.at, UTC).isoformat(), "line": line.line}


def _as_text(line: LogLine) -> str:
    return f"{datetime.fromtimestamp(line.at, UTC):%Y-%m-%d %H:%M:%S}Z {line.line}"
