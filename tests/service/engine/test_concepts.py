"""Concepts at any time, and responses to them, against plain versions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from service.engine.concepts import (
    Concepts,
    Spectrum,
    concepts_at,
    is_concept,
    rank_concepts,
    respond_to_concepts,
    spectrum_at,
    spread_of,
    squared_distances,
)
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


SCALES = [1, 2, 3, 10]


def members_at(f: Filtration, time: float | None) -> dict[int, set[int]]:
    """Node and prototypes of each concept of one time."""
    concepts = concepts_at(f, time)
    return {
        node: set(np.flatnonzero(concepts.assignment == c).tolist()) for c, node in enumerate(concepts.ids.tolist())
    }


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("size", [2, 3, 12, 40])
@pytest.mark.parametrize("scales", SCALES)
def test_a_spectrum_has_its_own_concepts_and_then_each_further_one_once(seed: int, size: int, scales: int):
    f = filtration(seed, size)
    spectrum, own = spectrum_at(f, None, scales), concepts_at(f)
    ids = spectrum.ids.tolist()
    assert np.array_equal(spectrum.concepts.assignment, own.assignment)
    assert spectrum.concepts.time == f.epsilon_max
    assert ids[: len(own.ids)] == own.ids.tolist()
    assert len(set(ids)) == len(ids) == len(spectrum.sizes) == len(spectrum.times)
    everywhere = [members_at(f, None), *(members_at(f, step / scales) for step in range(1, scales))]
    assert set(ids) == set().union(*everywhere)
    for c, (node, time) in enumerate(zip(ids, spectrum.times.tolist(), strict=True)):
        assert spectrum.members(c).tolist() == sorted(members_at(f, time)[node])
        assert spectrum.sizes[c] == len(spectrum.members(c)) >= 2


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("scales", SCALES)
def test_further_concepts_are_of_the_earliest_time_that_has_them_and_in_the_order_of_these(seed: int, scales: int):
    f = filtration(seed, 40)
    spectrum = spectrum_at(f, None, scales)
    own = len(spectrum.concepts.sizes)
    assert (spectrum.times[:own] == f.epsilon_max).all()
    grid = [step / scales for step in range(1, scales)]
    for node, time in zip(spectrum.ids[own:].tolist(), spectrum.times[own:].tolist(), strict=True):
        assert time == min(moment for moment in grid if node in members_at(f, moment))
    assert (np.diff(spectrum.times[own:]) >= 0).all()


@pytest.mark.parametrize("scales", SCALES)
@pytest.mark.parametrize("time", TIMES)
def test_a_time_that_is_asked_for_stands_alone(time: float, scales: int):
    f = filtration(2, 30)
    spectrum, concepts = spectrum_at(f, time, scales), concepts_at(f, time)
    assert np.array_equal(spectrum.ids, concepts.ids)
    assert np.array_equal(spectrum.sizes, concepts.sizes)
    assert (spectrum.times == time).all()
    assert {c: set(spectrum.members(c).tolist()) for c in range(len(concepts.ids))} == dict(enumerate(groups(f, time)))


def test_one_scale_is_epsilon_max_alone():
    f = filtration(3, 30)
    assert np.array_equal(spectrum_at(f, None, 1).ids, concepts_at(f).ids)


@pytest.mark.parametrize("scales", SCALES)
def test_membership_is_the_mean_over_a_concepts_prototypes(scales: int):
    spectrum = spectrum_at(filtration(1, 25), None, scales)
    membership = spectrum.membership.toarray()
    assert membership.shape == (len(spectrum.ids), 25)
    assert np.allclose(membership.sum(axis=1), 1)
    values = np.random.default_rng(0).random(25)
    expected = [values[spectrum.members(c)].mean() for c in range(len(spectrum.ids))]
    assert np.allclose(spectrum.membership @ values, expected)


def test_a_spectrum_of_a_time_out_of_range_is_refused():
    with pytest.raises(InvalidParameter, match="from 0"):
        spectrum_at(filtration(0, 5), 1.5, 4)


def late() -> Filtration:
    """Nothing is annexed before the end."""
    f = filtration(0, 10)
    return Filtration(f.distance, np.ones(9), f.order, f.annexed, f.annexing, 1.0)


def test_a_time_without_concepts_is_an_empty_spectrum():
    spectrum = spectrum_at(late(), 0.5, 10)
    assert spectrum.membership.shape == (0, 10)
    assert len(spectrum.ids) == len(spectrum.sizes) == len(spectrum.times) == 0
    assert len(spread_of(spectrum, np.ones((10, 3)))) == 0
    assert len(rank_concepts(np.zeros(0), spectrum)) == 0


def sparse(row: np.ndarray) -> Stimuli:
    index = np.flatnonzero(row).astype(np.int32)
    return Stimuli(index, row[index].astype(np.float32))


def euclid(vertices: int, power: float = 1.0) -> Metric:
    return Metric(
        np.ones(vertices, np.float32), np.zeros(vertices, np.float32), np.eye(vertices, dtype=np.float32),
        np.ones(vertices), np.inf, power,
    )  # fmt: skip


SIZE, VERTICES = 24, 6


@pytest.fixture
def known() -> np.ndarray:
    return np.random.default_rng(0).random((SIZE, VERTICES)).astype(np.float32)


@pytest.fixture
def query() -> np.ndarray:
    return np.random.default_rng(1).random(VERTICES).astype(np.float32)


several_scales = pytest.mark.parametrize("scales", [1, 6])


def respond(
    query: np.ndarray, known: np.ndarray, spectrum: Spectrum, score: str, metric: Metric | None = None
) -> tuple[np.ndarray, np.ndarray]:
    metric = metric or euclid(VERTICES)
    stored = metric.embed(csr_array(known))
    squared = squared_distances(sparse(query), metric, stored)
    return respond_to_concepts(squared, spectrum, spread_of(spectrum, stored), ResponseParams(score=score))


def over_members(values: np.ndarray, spectrum: Spectrum) -> np.ndarray:
    """The plain mean over each concept's prototypes."""
    return np.array([np.mean([values[p] for p in spectrum.members(c)]) for c in range(len(spectrum.ids))])


@several_scales
def test_responses_are_the_mean_distances_of_eq_4(known: np.ndarray, query: np.ndarray, scales: int):
    spectrum = spectrum_at(filtration(4, SIZE), None, scales)
    scored, distances = respond(query, known, spectrum, "distance")
    apart = np.array([np.sqrt(sum((query - one) ** 2)) for one in known.astype(float)])
    assert np.allclose(distances, over_members(apart, spectrum), rtol=1e-6)
    assert np.array_equal(scored, distances)


@several_scales
def test_the_spread_is_the_mean_squared_distance_from_a_concepts_mean(known: np.ndarray, scales: int):
    spectrum = spectrum_at(filtration(4, SIZE), None, scales)
    stored = known.astype(float)
    expected = [
        np.mean([((stored[p] - stored[spectrum.members(c)].mean(axis=0)) ** 2).sum() for p in spectrum.members(c)])
        for c in range(len(spectrum.ids))
    ]
    assert np.allclose(spread_of(spectrum, stored), expected)
    alike = np.ones((SIZE, 3))
    assert np.allclose(spread_of(spectrum, alike), 0)


@several_scales
def test_discriminants_are_squared_distances_to_the_means_of_concepts_less_their_log_sizes(
    known: np.ndarray, query: np.ndarray, scales: int
):
    spectrum = spectrum_at(filtration(4, SIZE), None, scales)
    scored, distances = respond(query, known, spectrum, "discriminant")
    members = [known[spectrum.members(c)].astype(float) for c in range(len(spectrum.ids))]
    expected = np.array([((query - own.mean(axis=0)) ** 2).sum() - 2 * np.log(len(own)) for own in members])
    assert np.allclose(scored, expected - expected.mean(), atol=1e-6)
    assert np.array_equal(distances, respond(query, known, spectrum, "distance")[1])


def test_a_wide_concept_around_an_object_comes_before_a_tight_one_beside_it_only_by_discriminants():
    """Two prototypes 2 to the left and right of the object, two others 1.5 above it."""
    places = np.array([[-2.0, 0], [2, 0], [0, 1.5], [0, 1.5]])
    f = Filtration(
        np.array([0.1, 0.1, 1]), np.array([0.0, 0.0, 1.0]), np.arange(3), np.array([1, 3, 2]), np.array([0, 2, 0]), 0.0
    )
    spectrum = spectrum_at(f, None, 1)
    assert [spectrum.members(c).tolist() for c in range(2)] == [[0, 1], [2, 3]]
    squared, spread = (places**2).sum(axis=1), spread_of(spectrum, places)
    first = {
        score: int(np.argmin(respond_to_concepts(squared, spectrum, spread, ResponseParams(score=score))[0]))
        for score in ("distance", "discriminant")
    }
    assert first == {"distance": 1, "discriminant": 0}


def test_of_two_concepts_as_near_the_larger_comes_first_only_by_discriminants():
    """Three prototypes 1 to the left of the object, two others 0.9 to the right."""
    places = np.array([[-1.0], [-1], [-1], [0.9], [0.9]])
    f = Filtration(
        np.array([0.1, 0.1, 0.1, 1]),
        np.array([0.0, 0.0, 0.0, 1.0]),
        np.arange(4),
        np.array([1, 2, 4, 3]),
        np.array([0, 0, 3, 0]),
        0.0,
    )
    spectrum = spectrum_at(f, None, 1)
    assert spectrum.sizes.tolist() == [3, 2]
    squared, spread = (places**2).sum(axis=1), spread_of(spectrum, places)
    first = {
        score: int(np.argmin(respond_to_concepts(squared, spectrum, spread, ResponseParams(score=score))[0]))
        for score in ("distance", "discriminant")
    }
    assert first == {"distance": 1, "discriminant": 0}


@pytest.mark.parametrize("score", ["distance", "discriminant"])
def test_without_concepts_there_are_no_responses(score: str):
    spectrum = spectrum_at(late(), 0.5, 1)
    scored, distances = respond_to_concepts(np.ones(10), spectrum, np.zeros(0), ResponseParams(score=score))
    assert len(scored) == len(distances) == 0


@pytest.mark.parametrize("power", [1.0, 0.5, 0.25])
def test_stimuli_of_zeros_have_an_answer(known: np.ndarray, power: float):
    spectrum = spectrum_at(filtration(4, SIZE), None, 6)
    scored, distances = respond(np.zeros(VERTICES), known, spectrum, "discriminant", euclid(VERTICES, power))
    assert np.isfinite(scored).all()
    assert (distances > 0).all()


def test_what_lies_outside_the_subspace_counts_by_its_variance(known: np.ndarray):
    """Components of two of six dimensions; prototypes inside their span, the query anywhere."""
    inside = (known * [1, 1, 0, 0, 0, 0]).astype(np.float32)
    metric = Metric(
        np.ones(VERTICES, np.float32),
        np.zeros(VERTICES, np.float32),
        np.eye(2, VERTICES, dtype=np.float32),
        np.array([4.0, 9.0]),
        0.25,
        1.0,
    )
    query = np.random.default_rng(2).random(VERTICES).astype(np.float32)
    spectrum = spectrum_at(filtration(4, SIZE), None, 6)
    inverse = np.array([1 / 4, 1 / 9, 4, 4, 4, 4])
    each = np.sqrt((((query - inside) ** 2) * inverse).sum(axis=1))
    assert np.allclose(respond(query, inside, spectrum, "distance", metric)[1], over_members(each, spectrum), rtol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_concepts_of_the_answers_time_rank_before_all_others_and_of_equal_ones_the_first(seed: int):
    spectrum = spectrum_at(filtration(seed, 40), None, 10)
    own, all_ = len(spectrum.concepts.sizes), len(spectrum.ids)
    assert own < all_
    responses = np.random.default_rng(seed).integers(0, 4, all_).astype(float)  # many are equal
    expected = sorted(range(all_), key=lambda c: (c >= own, responses[c], c))
    assert rank_concepts(responses, spectrum).tolist() == expected
    assert sorted(expected[:own]) == list(range(own))
    assert rank_concepts(-np.arange(all_, dtype=float), spectrum)[0] == own - 1  # though all others respond less


def test_ranks_of_one_time_are_those_of_the_responses():
    concepts: Concepts = concepts_at(filtration(5, 40), 0.5)
    responses = np.random.default_rng(0).random(len(concepts.sizes))
    ranking = rank_concepts(responses, spectrum_at(filtration(5, 40), 0.5, 10))
    assert np.array_equal(ranking, np.argsort(responses))


@pytest.mark.parametrize("seed", range(5))
def test_the_nodes_that_are_concepts_are_those_of_some_time(seed: int) -> None:
    f = filtration(seed, 20, steps=6)
    nodes = {int(node) for time in f.time for node in concepts_at(f, time).ids}
    assert {node for node in range(-2, 42) if is_concept(f, node)} == nodes
    assert len(nodes) < 19
