"""What became of a model's concepts as tables, for people at a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from service.carrying import CarriedName
from service.comparing import NewConcept, OldConcept, RelatedConcept, VersionComparison


def show_comparison(compared: VersionComparison) -> None:
    """Prints what became of the concepts of one version in another one."""
    old, new = (f"{version.model}:{version.version}" for version in (compared.old, compared.new))
    console = Console()
    console.print(
        f"{old} and {new}, by {compared.shared} clouds that both learnt from and {compared.asked} that one of them was "
        f"asked for" + (f"; {compared.left_out} could not be asked for" if compared.left_out else ""),
        markup=False,
        highlight=False,
    )
    console.print(_concepts(f"concepts of {old}", "becomes", [(c, c.fate) for c in compared.old_concepts]))
    fresh = [(concept, concept.origin) for concept in compared.new_concepts if concept.origin != "persists"]
    if fresh:
        console.print(_concepts(f"concepts of {new} that do not persist", "origin", fresh))
    console.print(f"of all filtration times, {len(compared.same_concepts)} concepts are the same", highlight=False)


def show_carried(carried: Sequence[CarriedName]) -> None:
    """Prints the names that were carried over."""
    table = Table(caption=None if carried else "no name fits a concept that nobody has named")
    for heading in ("concept", "name", "was concept", "in common"):
        table.add_column(heading, justify="left" if heading == "name" else "right")
    for each in carried:
        table.add_row(str(each.concept), escape(each.name), str(each.before), f"{each.jaccard:.0%}")
    Console().print(table)


def _concepts(title: str, what: str, concepts: Iterable[tuple[OldConcept | NewConcept, str]]) -> Table:
    table = Table(title=title, title_justify="left")
    for heading in ("concept", "name", "prototypes", what, "concepts (objects, in common)"):
        table.add_column(heading, justify="right" if heading in ("concept", "prototypes") else "left")
    for concept, said in concepts:
        related = ", ".join(map(_related, concept.concepts)) or "-"
        table.add_row(str(concept.id), escape(concept.name or "-"), str(concept.prototypes), said, related)
    return table


def _related(concept: RelatedConcept) -> str:
    name = f" {escape(concept.name)}" if concept.name else ""
    return f"{concept.id}{name} ({concept.objects}, {concept.jaccard:.0%})"
