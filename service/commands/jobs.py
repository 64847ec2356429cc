"""`shape-concepts jobs`: training that workers do."""

from __future__ import annotations

import json
from pathlib import Path

import click

from service.commands.options import application_of, json_option
from service.commands.reporting import done, examples


@click.group()
def jobs() -> None:
    """Submits training jobs and tells what became of them.

    Workers (shape-concepts-worker run) take jobs from the database SHAPE_CONCEPTS_JOBS_URL, in the order in which
    they were submitted, and publish to their own model store.
    """


@jobs.command(
    epilog=examples(
        "shape-concepts jobs submit --simulate 250 --name default",
        "shape-concepts jobs submit --clouds scans --name workshop --alias staging --json",
        "shape-concepts jobs submit --simulate 1000 --name default --id nightly-2025-01-31",
    )
)
@click.option("--name", required=True, help="Of the model: lower-case letters, digits and hyphens.")
@click.option("--alias", default="production", show_default=True, help="What shall mean the new version.")
@click.option("--simulate", type=int, metavar="COUNT", help="Learn from simulated objects.")
@click.option(
    "--clouds",
    metavar="DIR",
    type=click.Path(path_type=Path),
    help="Learn from all clouds of a folder that workers see.",
)
@click.option("--seed", type=int, default=7, show_default=True, help="Of all random draws.")
@click.option("--preset", default="default", show_default=True, help="Parameters of all stages: default or paper.")
@click.option("--renderer", type=click.Choice(["sapien", "raycast"]), help="What sees the scene.  [default: sapien]")
@click.option("--id", "job_id", metavar="ID", help="Names the job: submitted twice, it is one job.  [default: random]")
@json_option
def submit(
    name: str,
    alias: str,
    simulate: int | None,
    clouds: Path | None,
    seed: int,
    preset: str,
    renderer: str | None,
    job_id: str | None,
    as_json: bool,
) -> None:
    """Puts a training job into the queue."""
    from service.engine.params import ModelParams
    from service.job_specs import read_spec

    spec = read_spec(
        {
            "name": name,
            "alias": alias,
            "simulate": simulate,
            "clouds": str(clouds.absolute()) if clouds else None,
            "seed": seed,
            "params": ModelParams.preset(preset),
            "simulation": {"renderer": renderer} if renderer else {},
        }
    )
    job = application_of(None).training.submit(spec, job_id, local=True)
    done(job.model_dump(mode="json"), f"Job {job.id} is {job.state}.", as_json)


@jobs.command("list", epilog=examples("shape-concepts jobs list", "shape-concepts jobs list --limit 100 --json"))
@click.option("--limit", type=click.IntRange(min=1), default=20, show_default=True, help="How many.")
@json_option
def list_jobs(limit: int, as_json: bool) -> None:
    """Lists jobs, the one submitted last first."""
    found = application_of(None).training.jobs(limit).jobs
    if as_json:
        click.echo(json.dumps({"jobs": [job.model_dump(mode="json") for job in found]}))
    else:
        from service import tables

        tables.show_jobs(found)


@jobs.command(
    "show",
    epilog=examples(
        "shape-concepts jobs show nightly-2025-01-31", "shape-concepts jobs show nightly-2025-01-31 --json"
    ),
)
@click.argument("job", metavar="ID")
@json_option
def show_job(job: str, as_json: bool) -> None:
    """Shows a job: its state, what it is to do, and what came of it."""
    found = application_of(None).training.job(job)
    if as_json:
        click.echo(found.model_dump_json())
    else:
        from service import tables

        tables.show_job(found)


@jobs.command(epilog=examples("shape-concepts jobs cancel nightly-2025-01-31"))
@click.argument("job", metavar="ID")
@json_option
def cancel(job: str, as_json: bool) -> None:
    """Takes a job from the queue, or stops it; one that is over stays as it is."""
    found = application_of(None).training.cancel(job)
    done(found.model_dump(mode="json"), f"Job {found.id} is {found.state}.", as_json)
