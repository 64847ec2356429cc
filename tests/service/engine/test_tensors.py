"""A model as tensors, and back; and whatever may have happened to the tensors between."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from service.engine.errors import ModelDamaged
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from tests.learnt import PRESETS, learnt, named_clouds

Tensors = dict[str, NDArray[Any]]
presets = pytest.mark.parametrize("preset", PRESETS)
NAMES = sorted(learnt().to_tensors())


@presets
def test_writing_and_reading_is_identity(preset: str):
    model = learnt(preset)
    tensors = model.to_tensors()
    again = ShapeModel.from_tensors(tensors, model.params)
    for name, array in again.to_tensors().items():
        assert array.dtype == tensors[name].dtype
        assert array.shape == tensors[name].shape
        assert array.tobytes() == tensors[name].tobytes()
    assert again.notes == model.notes
    assert again.prototypes.cloud_keys == model.prototypes.cloud_keys
    assert again.facts() == model.facts()
    assert [h.vertices for h in again.ensemble.hierarchies] == [h.vertices for h in model.ensemble.hierarchies]
    for named in named_clouds()[:3]:
        a, b = model.respond(named.cloud), again.respond(named.cloud)
        assert np.array_equal(a.responses, b.responses)
        assert np.array_equal(a.stimuli.values, b.stimuli.values)


@presets
def test_tensors_stand_alone(preset: str):
    """Contiguous arrays of plain types, which nobody else holds in a way that changes them."""
    for name, array in learnt(preset).to_tensors().items():
        assert array.flags.c_contiguous, name
        assert array.dtype in (np.float32, np.float64, np.int32, np.int64, np.uint8), name


def test_the_documented_tensors_are_there_and_mean_what_is_documented():
    model, tensors = learnt(), learnt().to_tensors()
    size = model.stimuli.shape[0]
    assert tensors["metric.power"].tolist() == [model.params.response.power]
    for f in range(1, 1 + model.params.dictionary.levels):
        assert tensors[f"dictionary.level_{f}"].shape == (2**f, model.ensemble.prototypes.shape[1])
    assert tensors["stimuli.data"].dtype == np.float32
    assert tensors["space.edges"].shape == (size - 1, 2)
    assert np.array_equal(tensors["space.vertex_heat"], tensors["space.geodesic_sum"] / size)
    assert tensors["concepts.assignment"].tolist() == model.concepts().assignment.tolist()
    assert tensors["filtration.epsilon_max"].tolist() == [model.filtration.epsilon_max]


def refused(tensors: Tensors, preset: str = "default") -> None:
    with pytest.raises(ModelDamaged) as refusal:
        ShapeModel.from_tensors(tensors, ModelParams.preset(preset))
    assert len(str(refusal.value)) > 30


@presets
def test_a_model_that_lacks_a_tensor_is_refused_by_name(preset: str):
    whole = learnt(preset).to_tensors()
    for name in whole:
        rest = {other: array for other, array in whole.items() if other != name}
        with pytest.raises(ModelDamaged, match=name):
            ShapeModel.from_tensors(rest, ModelParams.preset(preset))
    refused({}, preset)


LENGTHS = ("nothing", "one less", "one more")


def damages(array: NDArray[Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    """What a wrong writer might have made of an array; every one of them is to be noticed."""
    yield "another type", array.astype(np.float64 if array.dtype != np.float64 else np.float32)
    yield "bytes", array.astype(array.dtype.newbyteorder("S")) if array.dtype.itemsize > 1 else array.astype("S1")
    yield "text", array.astype(str)
    yield "objects", array.astype(object)
    yield "an axis more", array[None]
    yield "one axis of several", array.reshape(-1, 1)[:, :, None]
    yield "a single number", np.array(0, dtype=array.dtype)
    if array.size:
        yield "nothing", array[:0]
        yield "one less", array[:-1]
        yield "one more", np.concatenate([array, array[-1:]])
    if array.dtype.kind == "f" and array.size:
        broken = array.copy()
        broken.flat[array.size // 2] = np.nan
        yield "NaN", broken


@pytest.mark.parametrize("name", NAMES)
def test_a_tensor_of_another_kind_is_refused(name: str):
    whole = learnt().to_tensors()
    free = {"notes", *(n for n in NAMES if n.startswith("prototypes.cloud"))}  # text may have any length,
    shorter = {
        n for n in NAMES if n.startswith("hierarchy") and n.endswith(("edges", "propagations"))
    }  # edges may lack
    for what, damaged in damages(whole[name]):
        if (name in free and what in LENGTHS) or (name in shorter and what in LENGTHS[:2]):
            continue
        with pytest.raises(ModelDamaged):
            pytest.fail(f"{what} passed: {ShapeModel.from_tensors({**whole, name: damaged}, ModelParams())}")


@pytest.mark.parametrize("number", [-1, 2**30])
@pytest.mark.parametrize("name", [n for n in NAMES if learnt().to_tensors()[n].dtype.kind == "i"])
def test_an_index_out_of_range_is_refused_wherever_it_is(name: str, number: int):
    whole = learnt().to_tensors()
    for place in (0, whole[name].size // 2, whole[name].size - 1):
        damaged = whole[name].copy()
        damaged.flat[place] = number
        if np.array_equal(damaged, whole[name]):
            continue  # a prototype of no concept
        if name.endswith(".level") and number > 0:
            continue  # a motif level may be any
        refused({**whole, name: damaged})


CONTRADICTIONS: dict[str, Callable[[Tensors], None]] = {
    "a negative stimulus": lambda t: t["stimuli.data"].__setitem__(0, -0.5),
    "a stimulus of nothing": lambda t: t["stimuli.data"].__setitem__(0, 0.0),
    "a stimulus twice": lambda t: t["stimuli.indices"].__setitem__(1, t["stimuli.indices"][0]),
    "a loop in the tree": lambda t: t["space.edges"].__setitem__(-1, t["space.edges"][0]),
    "an edge from its larger end": lambda t: t["space.edges"].__setitem__(0, t["space.edges"][0][::-1].copy()),
    "edges in another order": lambda t: t["space.edges"].__setitem__(slice(None), t["space.edges"][::-1].copy()),
    "a negative distance": lambda t: t["space.distance"].__setitem__(0, -1),
    "another heat": lambda t: t["space.vertex_heat"].__setitem__(0, 1.0),
    "another sum": lambda t: t["space.geodesic_sum"].__setitem__(0, 1),
    "a time after the end": lambda t: t["filtration.time"].__setitem__(0, 1.5),
    "an annexation in two places": lambda t: t["filtration.order"].__setitem__(0, t["filtration.order"][1]),
    "a loop in F": lambda t: t["filtration.annexed"].__setitem__(0, t["filtration.annexing"][0]),
    "an end after the end": lambda t: t["filtration.epsilon_max"].__setitem__(0, 1.5),
    "another concept": lambda t: t["concepts.assignment"].__setitem__(0, t["concepts.assignment"][0] ^ 1),
    "a variance of nothing": lambda t: t["metric.variance"].__setitem__(0, 0.0),
    "a negative variance": lambda t: t["metric.residual_variance"].__setitem__(0, -1.0),
    "no variance": lambda t: t["metric.residual_variance"].__setitem__(0, np.nan),
    "another geometry": lambda t: t["metric.power"].__setitem__(0, 0.75 * t["metric.power"][0]),
    "another object's whole": lambda t: t["novelty.wholes"].__setitem__(0, t["novelty.wholes"][1]),
    "divergences in another order": lambda t: t["novelty.divergences"].__setitem__(0, 1.0),
    "a negative divergence": lambda t: t["novelty.divergences"].__setitem__(0, -0.1),
    "a negative description": lambda t: t["ensemble.prototypes"].__setitem__((0, 0), -0.1),
    "an edge between motif levels": lambda t: t["hierarchy_1.level"].__setitem__(t["hierarchy_1.edges"][-1, 0], 9),
    "an edge twice": lambda t: t["hierarchy_1.edges"].__setitem__(1, t["hierarchy_1.edges"][0]),
    "a prototype twice": lambda t: t["hierarchy_1.prototypes_indices"].__setitem__(
        1, t["hierarchy_1.prototypes_indices"][0]
    ),
    "no object's name": lambda t: t.__setitem__("prototypes.cloud_keys", np.zeros(0, np.uint8)),
    "a name too many": lambda t: t.__setitem__(
        "prototypes.cloud_keys", np.append(t["prototypes.cloud_keys"], np.uint8([10, 65]))
    ),
    "a hash too few": lambda t: t.__setitem__("prototypes.cloud_hashes", t["prototypes.cloud_hashes"][:64]),
    "names that are no text": lambda t: t["prototypes.cloud_keys"].__setitem__(0, 0xFF),
    "notes that are no text": lambda t: t.__setitem__("notes", np.uint8([0xC3, 0x28])),
}  # fmt: skip


def test_a_motif_that_stands_twice_is_refused():
    tensors = {name: array.copy() for name, array in learnt().to_tensors().items()}
    single = np.flatnonzero(tensors["hierarchy_2.level"] == 1)
    assert len(single) > 1
    tensors["hierarchy_2.words"][tensors["hierarchy_2.words_indptr"][single]] = 3
    refused(tensors)


@pytest.mark.parametrize("what", CONTRADICTIONS)
def test_contradictions_are_refused(what: str):
    tensors = {name: array.copy() for name, array in learnt().to_tensors().items()}
    CONTRADICTIONS[what](tensors)
    refused(tensors)


def test_tensors_of_other_parameters_are_refused():
    default, paper = learnt("default").to_tensors(), learnt("paper").to_tensors()
    refused(default, "paper")
    refused(paper, "default")
    one_more = ModelParams().dictionary.levels + 1
    with pytest.raises(ModelDamaged, match=f"level_{one_more}"):
        ShapeModel.from_tensors(default, ModelParams(dictionary={"levels": one_more}))


@pytest.mark.parametrize("seed", range(40))
def test_whatever_happens_to_the_numbers_a_model_answers_or_is_refused(seed: int):
    """Random numbers of a random tensor are replaced: what is not refused must still answer."""
    rng = np.random.default_rng(seed)
    tensors = {name: array.copy() for name, array in learnt().to_tensors().items()}
    name = NAMES[seed % len(NAMES)]
    array = tensors[name]
    for _ in range(int(rng.integers(1, 4))):
        if array.size:
            wild = [0, 1, -1, 7, 255, 1e30] if array.dtype.kind == "f" else [0, 1, 2, 7, 255]
            array.flat[rng.integers(array.size)] = rng.choice(wild)
    try:
        model = ShapeModel.from_tensors(tensors, ModelParams())
    except ModelDamaged:
        return
    assert model.respond(named_clouds()[0].cloud).ranking.shape == model.spectrum().sizes.shape
