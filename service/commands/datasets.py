"""`shape-concepts datasets`: clouds to learn from."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from service.commands.options import application_of, json_option, store_option
from service.commands.record import record
from service.commands.reporting import done, examples

if TYPE_CHECKING:
    from service.dataset_cases import DatasetCases, Reading
    from service.dataset_records import Verdict


@click.group()
def datasets() -> None:
    """Makes, fills, shows and deletes datasets.

    A dataset holds clouds by their keys, and apart from them what people say that they show. Files that are alike are
    stored once, and whatever is sent again is there already: an interrupted command is simply run again.
    """


@datasets.command(
    epilog=examples(
        "shape-concepts datasets create workshop", 'shape-concepts datasets create kitchen --description "of May"'
    )
)
@click.argument("name")
@click.option("--description", default="", help="What its clouds are.")
@json_option
@store_option
def create(name: str, description: str, as_json: bool, store: str | None) -> None:
    """Makes a dataset NAME; one that is there already stays as it is."""
    made = application_of(store).datasets.store.create(name, description)
    done(made.model_dump(mode="json"), f"There is a dataset {name}.", as_json)


@datasets.command(
    epilog=examples(
        "shape-concepts datasets add mugs scans/ --unit mm",
        "shape-concepts datasets add mugs scans.zip",
        "shape-concepts datasets add mugs mug.pcd mug.npy --replace",
    )
)
@click.argument("name")
@click.argument("paths", nargs=-1, required=True, metavar="PATH...", type=click.Path(path_type=Path, exists=True))
@click.option("--unit", help="Unit of the coordinates: m, dm, cm, mm, um, in, ft.  [default: the file's own, or m]")
@click.option(
    "--viewpoint", metavar="POSE", help="Sensor pose in the clouds' frame and unit: x,y,z or x,y,z,qw,qx,qy,qz."
)
@click.option("--replace", is_flag=True, help="Let clouds stand in the place of others of their keys.")
@json_option
@store_option
def add(
    name: str,
    paths: tuple[Path, ...],
    unit: str | None,
    viewpoint: str | None,
    replace: bool,
    as_json: bool,
    store: str | None,
) -> None:
    """Adds clouds: files, folders, and archives.

    Archives are .zip, .tar.gz, .tgz or .tar. The key of a cloud is its name, or its path in the folder or archive; a
    labels.csv there labels the clouds beside it. With --json, each cloud is one line. The exit code is 1 if a cloud was
    refused.
    """
    from service.application import parse_viewpoint
    from service.clouds import UNITS
    from service.dataset_cases import Reading

    if unit not in (None, *UNITS):
        raise click.BadParameter(f"it is one of {', '.join(UNITS)}.", param_hint="--unit")
    how = Reading(unit, parse_viewpoint(viewpoint) if viewpoint else None, replace)
    cases = application_of(store).datasets
    cases.store.about(name)
    _tell(name, (verdict for path in paths for verdict in _added(cases, name, path, how)), as_json)


@datasets.command("list", epilog=examples("shape-concepts datasets list", "shape-concepts datasets list --json"))
@json_option
@store_option
def list_datasets(as_json: bool, store: str | None) -> None:
    """Lists the datasets of the store."""
    held = application_of(store).datasets.store
    found = [held.show(name) for name in held.names()]
    if as_json:
        click.echo(json.dumps({"datasets": [dataset.model_dump(mode="json") for dataset in found]}))
    else:
        from service import dataset_tables

        dataset_tables.show_datasets(found)


@datasets.command(
    epilog=examples(
        "shape-concepts datasets show mugs",
        "shape-concepts datasets show mugs --json",
        "shape-concepts datasets show mugs --after 0100.ply --limit 50",
    )
)
@click.argument("name")
@click.option("--after", default="", metavar="KEY", help="Only clouds whose keys come after this one.")
@click.option("--limit", type=click.IntRange(min=0), default=20, show_default=True, help="How many clouds to list.")
@json_option
@store_option
def show(name: str, after: str, limit: int, as_json: bool, store: str | None) -> None:
    """Shows what a dataset holds, and some of its clouds."""
    held = application_of(store).datasets.store
    about, page = held.show(name), held.page(name, after, limit)
    if as_json:
        clouds = [entry.model_dump(mode="json") for entry in page]
        click.echo(json.dumps(about.model_dump(mode="json") | {"listed": clouds}))
    else:
        from service import dataset_tables

        dataset_tables.show_dataset(about, page)


@datasets.command(
    epilog=examples(
        "shape-concepts datasets download mugs --out mugs.tar.gz",
        "shape-concepts datasets download mugs --out mugs.zip",
        "shape-concepts datasets download mugs --key mug.xyz --out first.xyz",
    )
)
@click.argument("name")
@click.option(
    "--out", required=True, metavar="FILE", type=click.Path(path_type=Path, dir_okay=False), help="File to write."
)
@click.option("--key", metavar="KEY", help="Only this cloud, as it was sent.  [default: all, as .zip or .tar.gz]")
@json_option
@store_option
def download(name: str, out: Path, key: str | None, as_json: bool, store: str | None) -> None:
    """Writes the clouds of a dataset as an archive, or one of them.

    The labels are in the archive, as labels.csv.
    """
    cases = application_of(store).datasets
    if key is not None:
        pieces: Iterable[bytes] = [cases.store.read(name, key)]
    elif out.name.endswith((".zip", ".tar.gz", ".tgz")):
        pieces = cases.pack(cases.snapshot(name), "zip" if out.suffix == ".zip" else "tar.gz")
    else:
        raise click.BadParameter("the archive is FILE.zip or FILE.tar.gz; say --key for one cloud.", param_hint="--out")
    part = out.with_name(f"{out.name}.part")
    try:
        with part.open("wb") as file:
            file.writelines(pieces)
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)
    done({"dataset": name, "key": key, "file": str(out)}, f"Wrote {out}.", as_json)


@datasets.command(epilog=examples("shape-concepts datasets delete mugs", "shape-concepts datasets delete mugs --force"))
@click.argument("name")
@click.option("--force", is_flag=True, help="Even though models learnt from it.")
@json_option
@store_option
def delete(name: str, force: bool, as_json: bool, store: str | None) -> None:
    """Deletes a dataset; files that another one has stay."""
    application_of(store).datasets.delete(name, force=force)
    done({"dataset": name, "deleted": True}, f"The dataset {name} is deleted.", as_json)


@datasets.command(
    epilog=examples("shape-concepts datasets labels mugs", "shape-concepts datasets labels mugs --add labels.csv")
)
@click.argument("name")
@click.option(
    "--add", "table", metavar="FILE", type=click.Path(path_type=Path, dir_okay=False), help="Take the labels of a CSV."
)
@json_option
@store_option
def labels(name: str, table: Path | None, as_json: bool, store: str | None) -> None:
    """Prints the labels of clouds as a CSV, or takes those of one.

    Its columns are file (the cloud's key), category, and if known fine, instance, view, source and group. Labels of
    clouds that it does not name stay. The exit code is 1 if it names clouds that are not there.
    """
    cases = application_of(store).datasets
    if table is None:
        if as_json:
            found = {entry.key: entry.label.model_dump() for entry in cases.store.entries(name) if entry.label}
            click.echo(json.dumps({"dataset": name, "labels": found}))
        else:
            click.echo(cases.table(name), nl=False)
        return
    taken = cases.take_labels(name, table.read_bytes())
    done(taken.model_dump(), f"{taken.labelled} clouds are labelled.", as_json)
    if taken.unknown:
        first = ", ".join(taken.first_unknown[:5])
        click.echo(f"Error: {taken.unknown} rows name clouds that are not there: {first}", err=True)
        sys.exit(1)


datasets.add_command(record)


def _added(cases: DatasetCases, name: str, path: Path, how: Reading) -> Iterator[Verdict]:
    """What becomes of each cloud of a file, a folder or an archive."""
    from service.archives import ENDINGS

    if path.is_dir():
        yield from cases.take_folder(name, path, how)
    elif path.name.lower().endswith(ENDINGS):
        with path.open("rb") as file:
            yield from cases.unpack(name, file, how)
    else:
        yield cases.take_file(name, path.name, path, how)


def _tell(name: str, verdicts: Iterable[Verdict], as_json: bool) -> None:
    """Prints verdicts as they come, and ends with exit code 1 if a cloud was refused."""
    counts: dict[str, int] = {}
    for verdict in verdicts:
        counts[verdict.outcome] = counts.get(verdict.outcome, 0) + 1
        if as_json:
            click.echo(verdict.model_dump_json())
        elif verdict.error and verdict.outcome != "left-out":
            click.echo(f"Error: {verdict.key}: {verdict.error.detail}", err=True)
    if not as_json:
        told = ", ".join(f"{count} {outcome}" for outcome, count in counts.items())
        click.echo(f"{name}: {told or 'no cloud found'}")
    if counts.get("refused"):
        sys.exit(1)
