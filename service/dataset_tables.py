"""Datasets as tables, for people at a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from service.dataset_records import Dataset, Entry


def show_datasets(datasets: list[Dataset]) -> None:
    """Prints the datasets of a store."""
    table = Table()
    table.add_column("dataset")
    for heading in ("clouds", "MB", "labelled"):
        table.add_column(heading, justify="right")
    table.add_column("description")
    for held in datasets:
        labelled = sum(held.categories.values())
        numbers = (str(held.clouds), f"{held.bytes / 1e6:.1f}", str(labelled))
        table.add_row(held.name, *numbers, escape(held.description))
    Console().print(table)


def show_dataset(held: Dataset, page: list[Entry]) -> None:
    """Prints what a dataset holds, and some of its clouds."""
    table = Table(title=held.name, title_justify="left", title_style="bold", show_header=False)
    rows = {
        "description": escape(held.description) or "-",
        "created": f"{held.created:%Y-%m-%d %H:%M:%S} UTC",
        "clouds": f"{held.clouds}, {held.bytes / 1e6:.1f} MB",
        "formats": _counted(held.formats),
        "categories": _counted(held.categories),
        "digest": held.digest,
    }
    for what, said in rows.items():
        table.add_row(what, said)
    console = Console()
    console.print(table)
    if page:
        console.print(_clouds(page))
    if len(page) < held.clouds:
        console.print(f"{len(page)} of {held.clouds} clouds; --after {page[-1].key if page else 'KEY'} lists others")


def _clouds(page: list[Entry]) -> Table:
    table = Table()
    table.add_column("cloud", overflow="fold")
    table.add_column("format")
    for heading in ("points", "kB"):
        table.add_column(heading, justify="right")
    table.add_column("category")
    for entry in page:
        numbers = (str(entry.points), f"{entry.bytes / 1e3:.1f}")
        table.add_row(escape(entry.key), entry.format, *numbers, escape(entry.label.category) if entry.label else "-")
    return table


def _counted(counts: dict[str, int]) -> str:
    return escape(", ".join(f"{name} {count}" for name, count in counts.items())) or "-"
