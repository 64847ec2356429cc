"""Options that several commands have, and what follows from them."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

if TYPE_CHECKING:
    from service.application import Application
    from service.settings import Settings

Command = TypeVar("Command", bound=Callable[..., Any])


def store_option(command: Command) -> Command:
    """Adds --store."""
    return click.option(
        "--store",
        metavar="URL",
        help="Model store: a folder, file:///folder or s3://bucket/prefix.  [default: SHAPE_CONCEPTS_STORE, or a "
        "folder in the user's data directory]",
    )(command)


def json_option(command: Command) -> Command:
    """Adds --json."""
    return click.option("--json", "as_json", is_flag=True, help="Print JSON, for programs.")(command)


def settings_of(**given: Any) -> Settings:
    """Settings of the environment, with what was given on the command line in their stead."""
    from pydantic import ValidationError
    from pydantic_settings import SettingsError

    from service.settings import Settings

    try:
        return Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        raise click.UsageError("; ".join(_fault(e["loc"], e["msg"]) for e in error.errors())) from error
    except SettingsError as error:
        field = re.search(r'field "(\w+)"', str(error))
        name = f"SHAPE_CONCEPTS_{field[1].upper()}" if field else "A setting"
        raise click.UsageError(f"{name} is no JSON: {error.__cause__ or error}.") from error


def _fault(place: tuple[int | str, ...], what: str) -> str:
    """Which variable is wrong, where in it if it is JSON, and what about it."""
    name, *inside = map(str, place)
    return f"SHAPE_CONCEPTS_{name.upper()}{''.join(f', {part}' for part in inside)}: {what}"


def application_of(store: str | None) -> Application:
    """The use cases, on a store; None for that of the environment."""
    from service.application import Application

    settings = settings_of(store=store)
    click.get_current_context().find_root().obj = settings.store
    return Application(settings)
