"""`shape-concepts models`: what the store holds, and which version an alias means."""

from __future__ import annotations

import json
from pathlib import Path

import click

from service.commands.options import application_of, json_option, store_option
from service.commands.reporting import done, examples


@click.group()
def models() -> None:
    """Lists, shows and promotes models."""


@models.command(
    "list",
    epilog=examples("shape-concepts models list", "shape-concepts models list --store s3://robots/models --json"),
)
@json_option
@store_option
def list_models(as_json: bool, store: str | None) -> None:
    """Lists models, versions and aliases."""
    found = application_of(store).models.all()
    if as_json:
        click.echo(json.dumps({"models": [summary.model_dump() for summary in found]}))
    else:
        from service import tables

        tables.show_models(found)


@models.command(epilog=examples("shape-concepts models show default", "shape-concepts models show default:2 --json"))
@click.argument("model", metavar="NAME")
@json_option
@store_option
def show(model: str, as_json: bool, store: str | None) -> None:
    """Shows how a model was made, and what its aliases have meant."""
    application = application_of(store)
    name, version = application.which(model)
    manifest = application.models.manifest(name, version)
    history = application.models.histories(name)
    if as_json:
        aliases = {alias: [entry._asdict() for entry in entries] for alias, entries in history.items()}
        click.echo(json.dumps(manifest.model_dump(mode="json") | {"aliases": aliases}))
    else:
        from service import tables

        tables.show_manifest(manifest, history)


@models.command(
    epilog=examples(
        "shape-concepts models export default --out exported", "shape-concepts models export default:2 --out exported"
    )
)
@click.argument("model", metavar="NAME")
@click.option("--out", required=True, metavar="DIR", type=click.Path(path_type=Path, file_okay=False), help="Folder.")
@json_option
@store_option
def export(model: str, out: Path, as_json: bool, store: str | None) -> None:
    """Writes a model as files for any program.

    They are manifest.json and model.safetensors, byte for byte as the store has them.
    """
    application = application_of(store)
    name, version = application.which(model)
    files = [str(path) for path in application.models.export(name, version, out)]
    result = {"model": name, "version": version, "files": files}
    done(result, f"Wrote {name}:{version} to {' and '.join(files)}.", as_json)


@models.command(
    epilog=examples(
        "shape-concepts models promote default:2",
        "shape-concepts models promote default:2 --alias staging",
        "shape-concepts models promote default@staging",
    )
)
@click.argument("model", metavar="NAME:VERSION")
@click.option("--alias", default="production", show_default=True, help="Alias to move.")
@json_option
@store_option
def promote(model: str, alias: str, as_json: bool, store: str | None) -> None:
    """Lets an alias mean a version from now on.

    The version is named by its number, or as NAME@ALIAS by another alias.
    """
    if not {":", "@"} & set(model):
        raise click.BadParameter(f"say which version shall be meant, as {model}:2.", param_hint="NAME:VERSION")
    name, version = application_of(store).models.promote(model, alias)
    done({"model": name, "version": version, "alias": alias}, f"{name}@{alias} is version {version} now.", as_json)


@models.command(
    epilog=examples(
        "shape-concepts models compare default:2 default:3",
        "shape-concepts models compare default default@staging --json",
    )
)
@click.argument("old", metavar="NAME:1")
@click.argument("new", metavar="NAME:2")
@json_option
@store_option
def compare(old: str, new: str, as_json: bool, store: str | None) -> None:
    """Tells what became of the concepts of a version in another one.

    They persist, merge, split or disappear, and others appear. Versions are compared by the clouds that they learnt
    from: a concept persists if more than half of its objects and of a new concept's are common to both.
    """
    application = application_of(store)
    compared = application.models.compare(application.which(old), application.which(new))
    if as_json:
        click.echo(compared.model_dump_json())
    else:
        from service.comparison_tables import show_comparison

        show_comparison(compared)


@models.command(
    epilog=examples("shape-concepts models rollback default", "shape-concepts models rollback default --alias staging")
)
@click.argument("model", metavar="NAME")
@click.option("--alias", default="production", show_default=True, help="Alias to move back.")
@json_option
@store_option
def rollback(model: str, alias: str, as_json: bool, store: str | None) -> None:
    """Lets an alias mean what it meant before its last promotion."""
    version = application_of(store).models.rollback(model, alias)
    done({"model": model, "version": version, "alias": alias}, f"{model}@{alias} is version {version} again.", as_json)
