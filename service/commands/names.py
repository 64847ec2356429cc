"""`shape-concepts names`: what people call the concepts of a model."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import click

from service.commands.options import application_of, json_option, store_option
from service.commands.reporting import done, examples
from service.engine.errors import InvalidParameter, ShapeConceptsError


@click.group()
def names() -> None:
    """Gives concepts names, by hand or from labels.

    Names belong to one version of a model: another version has other concepts. Every replica has them within seconds.
    """


@names.command(
    "list", epilog=examples("shape-concepts names list default", "shape-concepts names list default:2 --json")
)
@click.argument("model", metavar="NAME")
@json_option
@store_option
def list_names(model: str, as_json: bool, store: str | None) -> None:
    """Lists the concepts that have names."""
    application = application_of(store)
    name, version = application.which(model)
    names = application.naming.names(name, version)
    named = dict(sorted(names.of.items()))
    if as_json:
        entries = [
            {"concept": concept, "name": called, "carried_from": names.carried.get(concept)}
            for concept, called in named.items()
        ]
        click.echo(json.dumps({"model": name, "version": version, "names": entries}))
    else:
        from service import tables

        tables.show_names(named, names.carried)


@names.command("set", epilog=examples('shape-concepts names set default 14 "tea mug"'))
@click.argument("model", metavar="NAME")
@click.argument("concept", type=click.IntRange(0))
@click.argument("given", metavar="WORDS")
@json_option
@store_option
def set_name(model: str, concept: int, given: str, as_json: bool, store: str | None) -> None:
    """Calls a concept WORDS from now on.

    CONCEPT is its id, as `respond` shows it.
    """
    _rename(model, concept, given, as_json, store)


@names.command(epilog=examples("shape-concepts names remove default 14"))
@click.argument("model", metavar="NAME")
@click.argument("concept", type=click.IntRange(0))
@json_option
@store_option
def remove(model: str, concept: int, as_json: bool, store: str | None) -> None:
    """Takes a concept's name away."""
    _rename(model, concept, None, as_json, store)


@names.command(
    epilog=examples(
        "shape-concepts names propose default --labels labels.csv",
        "shape-concepts names propose default --labels labels.csv --apply",
    )
)
@click.argument("model", metavar="NAME")
@click.option(
    "--labels",
    "labels_file",
    required=True,
    metavar="FILE",
    type=click.Path(path_type=Path, dir_okay=False),
    help="CSV with the columns file (relative to it) and category.",
)
@click.option("--apply", is_flag=True, help="Give the names that are proposed; otherwise nothing is stored.")
@click.option("--time", type=click.FloatRange(0, 1), help="Filtration time of the concepts.  [default: epsilon_max]")
@json_option
@store_option
def propose(model: str, labels_file: Path, apply: bool, time: float | None, as_json: bool, store: str | None) -> None:
    """Proposes names for concepts, from a few labelled clouds.

    A concept might be called what most of the clouds are called of which it is the best one. Where labels tie, none is
    proposed. A cloud that cannot be answered has no say, and the exit code is 1 at the end.
    """
    from service.application import CloudFile
    from service.names import check_concept_name

    labelled = [(file, check_concept_name(label)) for file, label in _labels(labels_file)]
    application = application_of(store)
    name, version = application.prepare(model)
    answers, left_out = [], []
    for file, label in labelled:
        try:
            cloud = CloudFile((labels_file.parent / file).read_bytes(), None, file)
            answers.append((label, application.respond(cloud, model=name, version=version, time=time, top=1)))
        except (ShapeConceptsError, OSError) as error:
            left_out.append({"file": file, "label": label, "detail": str(error)})
    proposals = application.naming.propose(name, version, answers, apply=apply)
    if as_json:
        told = [proposal.model_dump() for proposal in proposals]
        result = {"model": name, "version": version, "applied": apply, "proposals": told, "left_out": left_out}
        click.echo(json.dumps(result))
    else:
        from service import tables

        tables.show_proposals(proposals, applied=apply)
        for entry in left_out:
            click.echo(f"Error: {entry['file']}: {entry['detail']}", err=True)
    if left_out:
        sys.exit(1)


@names.command(epilog=examples("shape-concepts names carry default:3 --from default:2"))
@click.argument("model", metavar="NAME:2")
@click.option("--from", "source", required=True, metavar="NAME:1", help="The version that has names.")
@json_option
@store_option
def carry(model: str, source: str, as_json: bool, store: str | None) -> None:
    """Takes names over from another version, where they still fit.

    Training does so by itself. A concept that somebody has named, or whose name somebody has taken away, stays as it
    is.
    """
    application = application_of(store)
    (name, version), earlier = application.which(model), application.which(source)
    carried = application.naming.carry(earlier, (name, version))
    if as_json:
        told = [each.model_dump() for each in carried]
        result = {"model": name, "version": version, "carried_from": "{}:{}".format(*earlier), "names": told}
        click.echo(json.dumps(result))
    else:
        from service.comparison_tables import show_carried

        show_carried(carried)


def _rename(model: str, concept: int, given: str | None, as_json: bool, store: str | None) -> None:
    application = application_of(store)
    name, version = application.which(model)
    kept = application.naming.rename(name, version, concept, given)
    result = {"model": name, "version": version, "concept": concept, "name": kept}
    called = "has no name" if kept is None else f"is called {kept}"
    done(result, f"Concept {concept} of {name}:{version} {called} now.", as_json)


def _labels(path: Path) -> list[tuple[str, str]]:
    """Files and categories of a CSV.

    Raises:
        InvalidParameter: it is none, or lacks these columns or any row.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as lines:
            rows = list(csv.DictReader(lines))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InvalidParameter(f"{path} is no CSV file in UTF-8: {error}.") from error
    if not rows or not {"file", "category"} <= set(rows[0]):
        raise InvalidParameter(f"{path} should have the columns file and category, and a row for each cloud.")
    return [(row["file"] or "", row["category"] or "") for row in rows]
