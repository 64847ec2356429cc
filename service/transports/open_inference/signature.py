"""What every model takes and gives as tensors, and how the service says so."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from service import __version__
from service.answer import Answer
from service.application import ConceptOrder

CLOUD = "cloud"
DATATYPE = "FP32"
PLATFORM = "shape-concepts"
SERVER: dict[str, Any] = {
    "name": "shape-concepts",
    "version": __version__,
    "extensions": ["binary_tensor_data"],
}


class Told(NamedTuple):
    """An answer, and the order of the concepts in it."""

    answer: Answer
    order: ConceptOrder


class Output(NamedTuple):
    """A tensor that a model gives.

    Attributes:
        name: of the tensor.
        datatype: of its values.
        size: how many values it has; -1 where that depends.
        values: takes them from an answer.
        asked: whether it is given only to those who ask for it by name.
    """

    name: str
    datatype: str
    size: int
    values: Callable[[Told], ArrayLike]
    asked: bool = False


def _ranking(told: Told) -> ArrayLike:
    places = {number: place for place, number in enumerate(told.order.ids.tolist())}
    return [places[concept.id] for concept in told.answer.concepts]


def _stimulus(told: Told, part: str) -> ArrayLike:
    values: ArrayLike = getattr(told.answer.stimuli, part)
    return values


STIMULI = ("stimuli_index", "stimuli_value")
POINT_SEGMENTS = "point_segments"
OUTPUTS = {
    output.name: output
    for output in (
        Output("responses", "FP64", -1, lambda told: told.answer.responses),
        Output("distances", "FP64", -1, lambda told: told.answer.distances),
        Output("concept_ids", "INT64", -1, lambda told: told.order.ids),
        Output("concept_times", "FP64", -1, lambda told: told.order.times),
        Output("ranking", "INT64", -1, _ranking),
        Output("novelty", "FP64", 1, lambda told: [told.answer.novelty]),
        Output("time", "FP64", 1, lambda told: [told.answer.time], asked=True),
        Output("segments", "INT64", 1, lambda told: [told.answer.segments], asked=True),
        Output("extent_m", "FP64", 1, lambda told: [told.answer.extent_m], asked=True),
        Output("truncated", "BOOL", 1, lambda told: [told.answer.truncated], asked=True),
        Output("warnings", "BYTES", -1, lambda told: told.answer.warnings, asked=True),
        Output(STIMULI[0], "INT64", -1, lambda told: _stimulus(told, "index"), asked=True),
        Output(STIMULI[1], "FP32", -1, lambda told: _stimulus(told, "value"), asked=True),
        Output(POINT_SEGMENTS, "INT64", -1, lambda told: told.answer.point_segments or [], asked=True),
    )
}


def describe(name: str, versions: list[int]) -> dict[str, Any]:
    """The metadata of a model."""
    outputs = [{"name": each.name, "datatype": each.datatype, "shape": [each.size]} for each in OUTPUTS.values()]
    return {
        "name": name,
        "versions": [str(version) for version in versions],
        "platform": PLATFORM,
        "inputs": [{"name": CLOUD, "datatype": DATATYPE, "shape": [-1, 3]}],
        "outputs": outputs,
    }
