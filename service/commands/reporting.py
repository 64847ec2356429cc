"""How commands say what they did, and what went wrong."""

from __future__ import annotations

import json
import re
from typing import Any

import click

from service.engine.errors import DatasetNotFound, JobNotFound, ModelNotFound, ScheduleNotFound, ShapeConceptsError

IN_OPTIONS = {
    "send unit=mm": "say --unit mm",
    "scene=true": "--scene",
    "its camera: fx": "its camera, --intrinsics: fx",
}
ADVICE = {  # by what an error says
    "169.254.169.254": "No credentials were found: set AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_REGION, and "
    "AWS_ENDPOINT_URL for a server of your own.",
    "Unable to connect to any of": "Is the router, or the service, running, and is that where it listens?",
    "Not a directory": "Give a folder, or a URL such as s3://bucket/prefix.",
}
LISTS: dict[type[ShapeConceptsError], str] = {  # the command that lists what there is
    DatasetNotFound: "shape-concepts datasets list",
    JobNotFound: "shape-concepts jobs list",
    ScheduleNotFound: "shape-concepts schedules list",
}


class ReportingGroup(click.Group):
    """Commands whose foreseen failures are one line on stderr and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        """Runs a command."""
        try:
            return super().invoke(ctx)
        except ShapeConceptsError as error:
            place = f" (store: {ctx.obj})" if isinstance(error, ModelNotFound) and ctx.obj else ""
            raise click.ClickException(f"{in_words(error)}{place}") from error
        except OSError as error:
            if isinstance(error, BrokenPipeError):
                raise
            raise click.ClickException(f"{error.strerror or error}: {error.filename}") from error


def in_words(error: ShapeConceptsError) -> str:
    """What an error says, in the words of the command line, with what to try."""
    said = str(error)
    for term, option in IN_OPTIONS.items():
        said = said.replace(term, option)
    said = re.sub(r"\[Single\((\S+)\)\]! *$", r"\1.", said)  # zenoh's way to list endpoints
    advice = [sentence for part, sentence in ADVICE.items() if part in said]
    advice += [f"{command} shows which there are." for kind, command in LISTS.items() if isinstance(error, kind)]
    return " ".join([said if said.endswith((".", "?")) or not advice else f"{said}.", *advice])


def examples(*commands: str) -> str:
    """Runnable examples, for below a command's help."""
    return "\b\nExamples:\n" + "\n".join(f"  {command}" for command in commands)


def done(result: dict[str, Any], sentence: str, as_json: bool) -> None:
    """Says what was done: in a sentence, or as JSON."""
    click.echo(json.dumps(result) if as_json else sentence)
