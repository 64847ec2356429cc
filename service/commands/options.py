"""Options that several commands have, and what follows from them."""

from __future__ import annotations

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
        faults = [f"SHAPE_CONCEPTS_{'_'.join(map(str, e['loc'])).upper()}: {e['msg']}" for e in error.errors()]
        raise click.UsageError("; ".join(faults)) from error
    except SettingsError as error:
        raise click.UsageError(f"A setting is no JSON: {error}.") from error


def application_of(store: str | None) -> Application:
    """The use cases, on a store; None for that of the environment."""
    from service.application import Application

    settings = settings_of(store=store)
    click.get_current_context().find_root().obj = settings.store
    return Application(settings)
