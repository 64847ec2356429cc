"""How commands say what they did, and what went wrong."""

from __future__ import annotations

import json
from typing import Any

import click

from service.engine.errors import ModelNotFound, ShapeConceptsError


class ReportingGroup(click.Group):
    """Commands whose foreseen failures are one line on stderr and exit code 1."""

    def invoke(self, ctx: click.Context) -> Any:
        """Runs a command."""
        try:
            return super().invoke(ctx)
        except ShapeConceptsError as error:
            place = f" (store: {ctx.obj})" if isinstance(error, ModelNotFound) and ctx.obj else ""
            raise click.ClickException(f"{error}{place}") from error
        except OSError as error:
            if isinstance(error, BrokenPipeError):
                raise
            raise click.ClickException(f"{error.strerror or error}: {error.filename}") from error


def examples(*commands: str) -> str:
    """Runnable examples, for below a command's help."""
    return "\b\nExamples:\n" + "\n".join(f"  {command}" for command in commands)


def done(result: dict[str, Any], sentence: str, as_json: bool) -> None:
    """Says what was done: in a sentence, or as JSON."""
    click.echo(json.dumps(result) if as_json else sentence)
