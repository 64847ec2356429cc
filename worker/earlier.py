"""The sources of a model that was published, again: what an incremental job learns from before what is new."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydantic import ValidationError

from service.datasets import Datasets
from service.engine.errors import DatasetNotFound, InvalidParameter
from service.model_file import Manifest
from worker.simulation.params import SimulationParams
from worker.sources import Dataset, Simulation, Source


def earlier_sources(manifest: Manifest, datasets: Datasets, note: Callable[[str], None]) -> list[Source]:
    """The sources that a model learnt from, in their order.

    Args:
        manifest: of the model.
        datasets: of the store.
        note: is told of a dataset that has changed since: it is learnt from as it is now.

    Raises:
        InvalidParameter: one of them is not there any more, or cannot be read again; the message says what to do.
    """
    called = f"{manifest.name}:{manifest.version}"
    return [_source(part, called, datasets, note) for part in _parts(manifest.source)]


def join(earlier: list[Source], new: list[Source], called: str) -> list[Source]:
    """The earlier sources and those that are new; a dataset that is among the earlier ones already is not learnt twice.

    Args:
        earlier: sources of a model.
        new: what shall be learnt from beside.
        called: the model.

    Raises:
        InvalidParameter: a simulation would make objects of which the model has learnt.
    """
    datasets = {source.name for source in earlier if isinstance(source, Dataset)}
    seeds = {source.seed for source in earlier if isinstance(source, Simulation)}
    if known := [source.seed for source in new if isinstance(source, Simulation) and source.seed in seeds]:
        raise InvalidParameter(
            f"{called} learnt from objects of seed {known[0]} already: for others, give another seed, as "
            f"{max(seeds) + 1}."
        )
    return [*earlier, *(source for source in new if not (isinstance(source, Dataset) and source.name in datasets))]


def _parts(source: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The single sources of what may be a joined one."""
    if source.get("kind") == "joined":
        for part in source.get("parts", []):
            yield from _parts(part)
    else:
        yield source


def _source(told: Mapping[str, Any], called: str, datasets: Datasets, note: Callable[[str], None]) -> Source:
    kind = told.get("kind")
    if kind == "simulation":
        try:
            return Simulation(int(told["clouds"]), int(told["seed"]), SimulationParams(**told["parameters"]))
        except (ValidationError, KeyError, TypeError, ValueError) as error:
            raise InvalidParameter(
                f"The objects that {called} learnt from were simulated in a way that this software does not know "
                f"({str(error).splitlines()[0]}): train anew, with simulate in the place of extend."
            ) from error
    if kind == "dataset":
        return _dataset(told, called, datasets, note)
    if kind == "folder":
        raise InvalidParameter(
            f"{called} learnt from {told.get('clouds', 'the')} clouds of a folder, which its manifest does not name: "
            "upload them as a dataset, and train from that and what is new."
        )
    raise InvalidParameter(
        f"The manifest of {called} does not say what it learnt from in a way that can be done again: train from "
        "datasets or simulation in the place of extend."
    )


def _dataset(told: Mapping[str, Any], called: str, datasets: Datasets, note: Callable[[str], None]) -> Dataset:
    name = str(told.get("name"))
    try:
        source = Dataset(datasets, name)
    except DatasetNotFound as error:
        raise InvalidParameter(
            f"{called} learnt from the dataset '{name}', which is not there any more: upload it again under that name, "
            "or train from the datasets that there are in the place of extend."
        ) from error
    if source.describe()["digest"] != told.get("digest"):
        note(f"the dataset '{name}' has changed since {called} learnt from it: it is learnt from as it is now")
    return source
