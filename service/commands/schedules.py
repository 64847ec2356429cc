"""`shape-concepts schedules`: jobs that are submitted again and again."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from service.commands.options import application_of, json_option
from service.commands.reporting import done, examples
from service.engine.errors import InvalidParameter


@click.group()
def schedules() -> None:
    """Has jobs submitted at the times of a cron expression.

    Schedules stand in the database SHAPE_CONCEPTS_JOBS_URL. Workers (shape-concepts-worker run) submit their jobs,
    each once, however many workers there are. Times at which none ran are made good by one job when one starts.
    """


@schedules.command(
    epilog=examples(
        'shape-concepts schedules create weekly --cron "0 3 * * mon" '
        '--job \'{"name": "default", "extend": "default", "datasets": ["scans"]}\'',
        'shape-concepts schedules create nightly --cron "30 2 * * *" --zone Europe/Berlin --job job.json',
    )
)
@click.argument("name")
@click.option(
    "--cron", required=True, metavar="TIMES", help="Minute, hour, day of month, month, day of week, as 0 3 * * mon."
)
@click.option("--zone", default="UTC", show_default=True, help="Time zone by whose clock it goes, as Europe/Berlin.")
@click.option(
    "--job", required=True, metavar="JSON", help="What each job is to do, as jobs are over REST: JSON, or its file."
)
@json_option
def create(name: str, cron: str, zone: str, job: str, as_json: bool) -> None:
    """Makes a schedule. Made again with the same times and job, it is the same one."""
    from service.job_specs import read_spec

    made = application_of(None).scheduling.create(name, cron, read_spec(_read_job(job)), zone, local=True)
    sentence = f"Schedule {made.name} is {made.state}; next due {made.next_due:%Y-%m-%d %H:%M} UTC."
    done(made.model_dump(mode="json"), sentence, as_json)


@schedules.command("list", epilog=examples("shape-concepts schedules list", "shape-concepts schedules list --json"))
@json_option
def list_schedules(as_json: bool) -> None:
    """Lists schedules, and when they are next due."""
    found = application_of(None).scheduling.schedules()
    if as_json:
        click.echo(json.dumps({"schedules": [schedule.model_dump(mode="json") for schedule in found]}))
    else:
        from service.schedule_tables import show_schedules

        show_schedules(found)


@schedules.command("show", epilog=examples("shape-concepts schedules show weekly --json"))
@click.argument("name")
@json_option
def show_schedule(name: str, as_json: bool) -> None:
    """Shows a schedule and the job that it submits."""
    found = application_of(None).scheduling.schedule(name)
    if as_json:
        click.echo(found.model_dump_json())
    else:
        from service.schedule_tables import show_schedule as show

        show(found)


@schedules.command(epilog=examples("shape-concepts schedules pause weekly"))
@click.argument("name")
@json_option
def pause(name: str, as_json: bool) -> None:
    """Submits nothing from now on."""
    found = application_of(None).scheduling.pause(name)
    done(found.model_dump(mode="json"), f"Schedule {name} is {found.state}.", as_json)


@schedules.command(epilog=examples("shape-concepts schedules resume weekly"))
@click.argument("name")
@json_option
def resume(name: str, as_json: bool) -> None:
    """Submits again. The times of the pause count for nothing."""
    found = application_of(None).scheduling.resume(name)
    sentence = f"Schedule {name} is {found.state}; next due {found.next_due:%Y-%m-%d %H:%M} UTC."
    done(found.model_dump(mode="json"), sentence, as_json)


@schedules.command(epilog=examples("shape-concepts schedules delete weekly"))
@click.argument("name")
@json_option
def delete(name: str, as_json: bool) -> None:
    """Removes a schedule. Jobs that it has submitted stay."""
    was = application_of(None).scheduling.delete(name)
    done(was.model_dump(mode="json"), f"Schedule {name} is gone.", as_json)


def _read_job(given: str) -> dict[str, Any]:
    """The JSON object that an option is, or whose file it names."""
    text = given if given.lstrip().startswith("{") else Path(given).read_text(encoding="utf-8")
    try:
        read = json.loads(text)
    except ValueError as error:
        raise InvalidParameter(f"The job is no JSON: {error}.") from error
    if not isinstance(read, dict):
        raise InvalidParameter('The job should be a JSON object, as {"name": "default", "simulate": 250}.')
    return read
