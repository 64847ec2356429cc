"""Concepts at any time, and responses to them, against plain versions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from service.engine.concepts import Baseline, Concepts, baseline_of, concepts_at, respond_to_concepts
from service.engine.errors import InvalidParameter
from service.engine.filtration import Filtration
from service.engine.metric import Metric
from service.engine.params import ResponseParams
from service.engine.stimuli import Stimuli


def filtration(seed: int, size: int, steps: int = 8) -> Filtration:
    """A random annexation graph, whose components annex each other in a random order."""
    rng = np.random.default_rng(seed)
    time = np.sort(rng.integers(0, steps + 1, size - 1)) / steps
    order = rng.permutation(size - 1)
    alive, pairs = list(range(size)), []
    for _ in range(size - 1):
        dies, sustains = rng.permutation(len(alive))[:2]
        pairs.append((alive[dies], alive[sustains]))
        alive.pop(dies)
    annexed, annexing = np.array(pairs)[order].T
    return Filtration(time[order], time[order], order, annexed, annexing, float(time[size // 3]))


def groups(f: Filtration, time: float) -> list[set[int]]:
    """Components of at least two of F without its later edges, largest first."""
    parts = [{v} for v in range(len(f.time) + 1)]
    for when, a, b in zip(f.time, f.annexed.tolist(), f.annexing.tolist(), strict=True):
        if when <= time:
            one, other = (next(p for p in parts if v in p) for v in (a, b))
            parts.remove(other)
            one |= other
    return sorted((p for p in parts if len(p) > 1), key=lambda p: (-len(p), min(p)))


TIMES = [*np.linspace(0, 1, 9), 0.3, 0.99]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [2, 3, 12, 40])
def test_concepts_are_the_components_of_f_at_any_time(seed: int, size: int):
    f = filtration(seed, size)
    for time in TIMES:
        concepts, expected = concepts_at(f, time), groups(f, time)
        assert concepts.time == time
        assert [set(np.flatnonzero(concepts.assignment == c).tolist()) for c in range(len(concepts.sizes))] == expected
        assert concepts.sizes.tolist() == [len(g) for g in expected]
        assert (np.bincount(concepts.assignment + 1, minlength=1)[0]) == size - concepts.sizes.sum()


def test_without_a_time_epsilon_max_is_meant():
    f = filtration(0, 20)
    assert concepts_at(f).time == f.epsilon_max
    assert np.array_equal(concepts_at(f).assignment, concepts_at(f, f.epsilon_max).assignment)


def test_concepts_only_grow_and_the_last_holds_all():
    f = filtration(1, 30)
    before: list[set[int]] = []
    for time in np.unique(f.time):
        here = groups(f, time)
        assert all(any(g <= h for h in here) for g in before)
        before = here
    assert concepts_at(f, 1).sizes.tolist() == [30]


@pytest.mark.parametrize("seed", range(6))
def test_a_concept_has_one_id_at_every_time_at_which_it_exists(seed: int):
    f = filtration(seed, 40, steps=30)
    ids: dict[frozenset[int], set[int]] = {}
    members: dict[int, set[frozenset[int]]] = {}
    for time in np.linspace(0, 1, 61):
        concepts = concepts_at(f, time)
        for place, concept_id in enumerate(concepts.ids.tolist()):
            group = frozenset(np.flatnonzero(concepts.assignment == place).tolist())
            ids.setdefault(group, set()).add(concept_id)
            members.setdefault(concept_id, set()).add(group)
    assert all(len(found) == 1 for found in ids.values())
    assert all(len(found) == 1 for found in members.values())
    assert len(ids) > 10
    assert all(40 <= concept_id < 2 * 40 - 1 for concept_id in members)


@pytest.mark.parametrize("time", [-0.01, 1.01, float("nan"), float("inf"), float("-inf")])
def test_a_time_out_of_range_is_refused(time: float):
    with pytest.raises(InvalidParameter, match="from 0"):
        concepts_at(filtration(0, 5), time)


def sparse(row: np.ndarray) -> Stimuli:
    index = np.flatnonzero(row).astype(np.int32)
    return Stimuli(index, row[index].astype(np.float32))


def euclid(vertices: int) -> Metric:
    return Metric(
        np.ones(vertices, np.float32), np.zeros(vertices, np.float32), np.eye(vertices, dtype=np.float32),
        np.ones(vertices), np.inf, False,
    )  # fmt: skip


@pytest.fixture
def known() -> np.ndarray:
    return np.random.default_rng(0).random((10, 6)).astype(np.float32)


CONCEPTS = Concepts(0.0, np.array([12, 11]), np.array([4, 3]), np.array([0, 1, -1, 0, 0, 1, -1, 1, 0, -1]))
USUAL = Baseline(np.array([0.5, -0.5]), np.array([2.0, 3.0]))


def test_responses_are_the_mean_distances_of_eq_4(known: np.ndarray):
    query = np.random.default_rng(1).random(6).astype(np.float32)
    metric = euclid(6)
    params = ResponseParams(metric="identity", hellinger=False, score="distance")
    scored, distances = respond_to_concepts(
        sparse(query), CONCEPTS, metric, metric.embed(csr_array(known)), USUAL, params
    )
    expected = [
        np.mean([np.sqrt(((query - known[p]) ** 2).sum()) for p in np.flatnonzero(CONCEPTS.assignment == c)])
        for c in (0, 1)
    ]
    assert np.allclose(distances, expected, rtol=1e-6)
    assert np.array_equal(scored, distances)


def test_relative_responses_are_mean_squared_distances_less_their_mean(known: np.ndarray):
    query = np.random.default_rng(1).random(6).astype(np.float32)
    metric, params = euclid(6), ResponseParams(metric="identity", hellinger=False, score="relative")
    scored, distances = respond_to_concepts(
        sparse(query), CONCEPTS, metric, metric.embed(csr_array(known)), USUAL, params
    )
    squared = np.array(
        [np.mean([((query - known[p]) ** 2).sum() for p in np.flatnonzero(CONCEPTS.assignment == c)]) for c in (0, 1)]
    )
    assert np.allclose(scored, squared - squared.mean(), atol=1e-6)
    assert not np.allclose(scored, distances)


def test_standard_responses_are_relative_ones_measured_by_what_is_usual(known: np.ndarray):
    query = np.random.default_rng(1).random(6).astype(np.float32)
    metric = euclid(6)
    arguments = (sparse(query), CONCEPTS, metric, metric.embed(csr_array(known)), USUAL)
    relative, distances = respond_to_concepts(*arguments, ResponseParams(score="relative"))
    standard, same = respond_to_concepts(*arguments, ResponseParams(score="standard"))
    assert np.allclose(standard, [(relative[0] - 0.5) / 2, (relative[1] + 0.5) / 3])
    assert np.array_equal(distances, same)


def test_what_is_usual_is_what_the_training_objects_respond(known: np.ndarray):
    metric = euclid(6)
    stored = metric.embed(csr_array(known))
    params = ResponseParams(score="relative")
    each = [respond_to_concepts(sparse(one), CONCEPTS, metric, stored, USUAL, params)[0] for one in known]
    usual = baseline_of(CONCEPTS, stored)
    assert np.allclose(usual.mean, np.mean(each, axis=0), atol=1e-6)
    assert np.allclose(usual.deviation, np.std(each, axis=0), atol=1e-6)
    standard = ResponseParams(score="standard")
    measured = [respond_to_concepts(sparse(one), CONCEPTS, metric, stored, usual, standard)[0] for one in known]
    assert np.allclose(np.mean(measured, axis=0), 0, atol=1e-6)
    assert np.allclose(np.std(measured, axis=0), 1, atol=1e-6)


def test_objects_that_are_all_alike_have_an_answer():
    stored = np.ones((10, 3))
    usual = baseline_of(CONCEPTS, stored)
    assert np.array_equal(usual.deviation, [1, 1])
    assert np.allclose(usual.mean, 0)


@pytest.mark.parametrize("score", ["distance", "relative", "standard"])
def test_without_concepts_there_are_no_responses(known: np.ndarray, score: str):
    none = Concepts(0.0, np.array([], int), np.array([], int), np.full(10, -1))
    params = ResponseParams(score=score)
    scored, distances = respond_to_concepts(
        sparse(known[0]), none, euclid(6), euclid(6).embed(csr_array(known)), USUAL, params
    )
    assert len(scored) == len(distances) == 0


def test_stimuli_of_zeros_have_an_answer(known: np.ndarray):
    for hellinger in (True, False):
        metric = Metric(*vars(euclid(6)).values())
        metric = Metric(**{**vars(metric), "hellinger": hellinger})
        scored, distances = respond_to_concepts(
            sparse(np.zeros(6)), CONCEPTS, metric, metric.embed(csr_array(known)), USUAL, ResponseParams()
        )
        assert np.isfinite(scored).all()
        assert (distances > 0).all()


def test_what_lies_outside_the_subspace_counts_by_its_variance(known: np.ndarray):
    """Components of two of six dimensions; prototypes inside their span, the query anywhere."""
    inside = known * [1, 1, 0, 0, 0, 0]
    metric = Metric(
        np.ones(6, np.float32),
        np.zeros(6, np.float32),
        np.eye(2, 6, dtype=np.float32),
        np.array([4.0, 9.0]),
        0.25,
        False,
    )
    query = np.random.default_rng(2).random(6).astype(np.float32)
    params = ResponseParams(score="distance")
    stored = metric.embed(csr_array(inside.astype(np.float32)))
    _, distances = respond_to_concepts(sparse(query), CONCEPTS, metric, stored, USUAL, params)
    inverse = np.array([1 / 4, 1 / 9, 4, 4, 4, 4])
    each = np.sqrt((((query - inside) ** 2) * inverse).sum(axis=1))
    assert np.allclose(distances, [each[CONCEPTS.assignment == c].mean() for c in (0, 1)], rtol=1e-6)
