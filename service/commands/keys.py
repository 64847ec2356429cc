"""`shape-concepts keys`: who may use the service when it listens to others than this machine."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from service.commands.options import json_option, settings_of, store_option
from service.commands.reporting import done, examples
from service.scopes import SCOPES, Scope

if TYPE_CHECKING:
    from service.keys import KeyStore


@click.group()
def keys() -> None:
    """Creates, lists and revokes access keys.

    Clients send a key as "Authorization: Bearer KEY". Keys live in the model store, as hashes: all replicas share them.
    """


@keys.command(
    epilog=examples(
        "shape-concepts keys create robot-7",
        "shape-concepts keys create retraining --scope train --scope answer",
        "shape-concepts keys create visitors --rate 5 --concurrency 2",
        "shape-concepts keys create cameras --max-body 4000000 --max-points 300000 --max-batch 8",
    )
)
@click.argument("name")
@click.option(
    "scopes",
    "--scope",
    type=click.Choice(SCOPES),
    multiple=True,
    default=["answer"],
    show_default=True,
    help="What it allows: clouds answered, jobs and datasets, models and names altered; may be repeated.",
)
@click.option(
    "--rate",
    type=float,
    help="Requests a second, at each replica; each cloud of a batch or a stream counts as one.  [default: no limit]",
)
@click.option("--concurrency", type=int, help="Requests at the same time, at each replica.  [default: no limit]")
@click.option("--max-body", type=int, help="Largest request body, bytes.  [default: the service's limit]")
@click.option("--max-points", type=int, help="Largest cloud, points.  [default: the service's limit]")
@click.option("--max-batch", type=int, help="Largest batch, clouds.  [default: the service's limit]")
@json_option
@store_option
def create(name: str, scopes: tuple[Scope, ...], as_json: bool, store: str | None, **limits: Any) -> None:
    """Makes a key for NAME and prints it: it is shown this once.

    A limit above that of the service has no effect.
    """
    text, key = _keys(store).create(name, scopes, **limits)
    if as_json:
        click.echo(json.dumps({"key": text} | _told(key.model_dump(mode="json"))))
    else:
        click.echo(text)
        click.echo(f"Key {key.id} for {name} allows to {', '.join(key.scopes)}. It is not shown again.", err=True)


@keys.command("list", epilog=examples("shape-concepts keys list", "shape-concepts keys list --json"))
@json_option
@store_option
def list_keys(as_json: bool, store: str | None) -> None:
    """Lists the keys, without their secrets."""
    known = _keys(store)
    revoked = known.revoked()
    if as_json:
        found = [_told(key.model_dump(mode="json")) | {"revoked": key.id in revoked} for key in known.all()]
        click.echo(json.dumps({"keys": found}))
    else:
        from service import tables

        tables.show_keys(known.all(), revoked)


@keys.command(epilog=examples("shape-concepts keys revoke 5f2ab90c11d3"))
@click.argument("key_id", metavar="ID")
@json_option
@store_option
def revoke(key_id: str, as_json: bool, store: str | None) -> None:
    """Makes a key worthless, on every replica within seconds.

    ID is the part of the key after "sc_", as `keys list` shows it.
    """
    key = _keys(store).revoke(key_id)
    done({"id": key.id, "revoked": True}, f"The key {key.id} of {key.name} is revoked.", as_json)


def _keys(store: str | None) -> KeyStore:
    from service.keys import KeyStore

    return KeyStore(settings_of(store=store).store)


def _told(key: dict[str, object]) -> dict[str, object]:
    """What may be shown of a key."""
    return {name: value for name, value in key.items() if name != "sha256"}
