"""Stimuli against Eq. 1, word by word."""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import jensenshannon

from service.engine.divergence import distributions, jsd_matrix
from service.engine.motifs import Ensemble
from service.engine.params import HierarchyParams, ModelParams, StimuliParams
from service.engine.perception import Perception, perceive
from service.engine.stimuli import Stimuli, accumulate, excite, gaussian_of_jsd, stimulate
from tests.learnt import PRESETS, learnt, named_clouds, perceived
from tests.shapes import ball, look, see
from worker.learning.hierarchy import grow_ensemble

GATINGS, POOLINGS = ("words", "rank", "kernel"), ("sum", "mean", "max")


def jsd(p: NDArray[np.float32], q: NDArray[np.float32]) -> float:
    """The divergence itself, nats: scipy gives its root."""
    return float(jensenshannon(p.astype(float), q.astype(float)) ** 2)


def dense(stimuli: Stimuli, size: int) -> NDArray[np.float64]:
    vector = np.zeros(size)
    vector[stimuli.indices] = stimuli.values
    return vector


def sparse_distributions(seed: int, count: int, bins: int, fill: float) -> NDArray[np.float32]:
    rng = np.random.default_rng(seed)
    rows = rng.exponential(size=(count, bins)) * (rng.random((count, bins)) < fill)
    rows[:, 0] += 1e-3
    return (rows / rows.sum(axis=1, keepdims=True)).astype(np.float32)


@pytest.mark.parametrize(("bins", "fill"), [(33, 1.0), (153, 0.3), (153, 0.02), (7, 0.5), (1, 1.0)])
def test_the_divergence_is_that_of_scipy(bins: int, fill: float):
    p, q = sparse_distributions(0, 12, bins, fill), sparse_distributions(1, 9, bins, fill)
    ours = jsd_matrix(p, distributions(q))
    assert np.abs(ours - [[jsd(a, b) for b in q] for a in p]).max() < 2e-6


def test_the_divergence_of_descriptions_is_that_of_scipy():
    rows = perceived()[0].descriptors
    assert np.abs(jsd_matrix(rows, distributions(rows)) - [[jsd(a, b) for b in rows] for a in rows]).max() < 2e-6


def test_the_divergence_is_symmetric_bounded_and_nothing_between_equals():
    rows = sparse_distributions(2, 30, 64, 0.4)
    ours = jsd_matrix(rows, distributions(rows))
    assert np.abs(ours - ours.T).max() < 2e-6
    assert (ours >= 0).all()
    assert ours.max() <= np.log(2) + 2e-6
    assert np.diag(ours).max() < 2e-6
    apart = np.eye(2, 8, dtype=np.float32)
    assert jsd_matrix(apart[:1], distributions(apart[1:]))[0, 0] == pytest.approx(np.log(2), abs=2e-6)


@pytest.mark.parametrize("sigma", [0.025, 0.08])
def test_the_kernel_squares_the_divergence(sigma: float):
    p, q = sparse_distributions(0, 6, 33, 0.9), sparse_distributions(1, 5, 33, 0.9)
    expected = [[np.exp(-(jsd(a, b) ** 2) / (2 * sigma**2)) for b in q] for a in p]
    assert np.allclose(gaussian_of_jsd(p, distributions(q), sigma), expected, rtol=1e-3, atol=1e-5)


@cache
def single() -> Perception:
    """An object of one segment: it has no union of segments."""
    seen = perceive(see(ball(0.1), look(20, 35, 0.9)).cloud, ModelParams())
    assert seen.graph.count == 1
    return seen


@cache
def seen_objects() -> tuple[Perception, ...]:
    """Of one, two and three segments."""
    return (single(), *(next(p for p in perceived() if p.graph.count == count) for count in (2, 3)))


@cache
def plain_divergences(which: int) -> NDArray[np.float64]:
    """Of the constellations of one of those objects from all motif prototypes (C, P), by scipy."""
    return np.array([[jsd(a, b) for b in learnt().ensemble.prototypes] for a in seen_objects()[which].descriptors])


def rank_of(level: int, top: int) -> str:
    return "segment" if level == 1 else "whole" if level == top else "union"


def plain_stimuli(which: int, words: NDArray[np.int64], ensemble: Ensemble, params: StimuliParams) -> list[float]:
    """Eq. 1 for each vertex of each hierarchy, and the pooling of what several constellations excite."""
    constellations, gamma, rank = seen_objects()[which].constellations, [], []
    kernel = np.exp(-(plain_divergences(which) ** 2) / (2 * params.sigma**2))
    weight = [covered**params.coverage_power for covered in constellations.coverage.tolist()]
    top = max(level for h in ensemble.hierarchies for level, _ in h.vertices)
    for f, hierarchy in enumerate(ensemble.hierarchies):
        occurs: dict[tuple[int, tuple[int, ...]], set[int]] = {}
        of_rank = {"segment": set(), "union": {int(constellations.members.all(axis=1).argmax())}, "whole": set()}
        for level, c in constellations.levels.tolist():
            members = np.flatnonzero(constellations.members[c])
            occurs.setdefault((level, tuple(sorted(words[members, f].tolist()))), set()).add(c)
            of_rank[rank_of(level, top)].add(c)
        memory = hierarchy.prototypes.toarray()
        for v, motif in enumerate(hierarchy.vertices):
            exciting = {
                "words": occurs.get(motif, set()),
                "rank": of_rank[rank_of(motif[0], top)],
                "kernel": set(range(len(weight))),
            }[params.gating]
            alphas = [weight[c] * np.mean([kernel[c, t] for t in np.flatnonzero(memory[v])]) for c in exciting]
            total = {"sum": sum, "mean": sum, "max": max}[params.pooling](alphas or [0.0])
            if params.pooling == "mean" and exciting:
                total /= sum(weight[c] for c in exciting)
            gamma.append(float(total))
            rank.append(rank_of(motif[0], top))
    if params.balanced:
        for name in ("segment", "union", "whole"):
            total = sum(g for g, r in zip(gamma, rank, strict=True) if r == name)
            share = getattr(params, f"{name}_weight") * len(gamma)
            gamma = [g * share / total if r == name and total else g for g, r in zip(gamma, rank, strict=True)]
    return gamma


def stimulated(seen: Perception, params: StimuliParams) -> NDArray[np.float64]:
    ensemble, words = learnt().ensemble, learnt().dictionary.words(seen.segment_descriptors)
    return dense(
        stimulate(ensemble, seen.constellations, seen.descriptors, words, params), learnt().ensemble.vertex_count
    )


WEIGHTS = {"segment_weight": 1.0, "union_weight": 0.5, "whole_weight": 2.0}


@pytest.mark.parametrize(("gating", "pooling", "balanced"), list(product(GATINGS, POOLINGS, (False, True))))
def test_stimuli_are_those_of_eq_1(gating: str, pooling: str, balanced: bool):
    model, answered = learnt(), 0
    for which, power in enumerate((2.0, 0.0, 2.0)):
        params = StimuliParams(
            sigma=0.08, gating=gating, pooling=pooling, cutoff=0, coverage_power=power, balanced=balanced, **WEIGHTS
        )
        words = model.dictionary.words(seen_objects()[which].segment_descriptors)
        expected = plain_stimuli(which, words, model.ensemble, params)
        assert np.allclose(stimulated(seen_objects()[which], params), expected, rtol=2e-4, atol=1e-6)
        answered += max(expected) > 0
    assert answered >= 2


@pytest.mark.parametrize("power", [0.0, 2.0])
def test_stimuli_pooled_before_they_are_distributed_over_the_vertices_are_the_same(power: float):
    params, ensemble = StimuliParams(coverage_power=power, cutoff=0, **WEIGHTS), learnt().ensemble
    for seen in seen_objects():
        words = learnt().dictionary.words(seen.segment_descriptors)
        slowly = accumulate(excite(ensemble, seen.constellations, seen.descriptors, words, params), ensemble, params)
        assert np.allclose(stimulated(seen, params), dense(slowly, ensemble.vertex_count), rtol=1e-6)


@pytest.mark.parametrize("power", [0.0, 2.0])
def test_with_the_gate_of_ranks_a_constellation_excites_no_vertex_of_another_rank(power: float):
    ensemble, refused = learnt().ensemble, 0
    top = int(ensemble.vertex_levels.max())
    for seen in seen_objects():
        words = learnt().dictionary.words(seen.segment_descriptors)
        gated, free = (
            excite(
                ensemble,
                seen.constellations,
                seen.descriptors,
                words,
                StimuliParams(sigma=0.08, gating=g, coverage_power=power, union_weight=1),
            )
            for g in ("rank", "kernel")
        )
        occurs = {(rank_of(level, top), c) for level, c in seen.constellations.levels.tolist()}
        occurs.add(("union", int(seen.constellations.members.all(axis=1).argmax())))
        for c, row in enumerate(gated.alpha):
            allowed = np.array([(rank_of(level, top), c) in occurs for level in ensemble.vertex_levels.tolist()])
            assert not row[~allowed].any()
            assert np.array_equal(row[allowed], free.alpha[c][allowed])
            refused += int((free.alpha[c][~allowed] > 0).sum())
    assert refused > 0


@pytest.mark.parametrize("name", ["segment_weight", "union_weight", "whole_weight"])
def test_a_rank_that_weighs_nothing_is_spared_and_changes_nothing_of_the_others(name: str):
    ensemble = learnt().ensemble
    top = int(ensemble.vertex_levels.max())
    spared = np.array([f"{rank_of(level, top)}_weight" == name for level in ensemble.vertex_levels.tolist()])
    for seen in seen_objects()[:4]:
        words = learnt().dictionary.words(seen.segment_descriptors)
        without, with_all = (
            excite(ensemble, seen.constellations, seen.descriptors, words, StimuliParams(**(WEIGHTS | {name: weight})))
            for weight in (0.0, 1.0)
        )
        assert not without.alpha[:, spared].any()
        assert with_all.alpha[:, spared].any()
        assert np.array_equal(without.alpha[:, ~spared], with_all.alpha[:, ~spared])


def test_every_object_excites_unions_as_much_as_any_other_that_of_one_segment_by_its_whole():
    params = StimuliParams(sigma=0.08, cutoff=0, segment_weight=0, union_weight=1, whole_weight=0)
    for seen in seen_objects():
        assert stimulated(seen, params).sum() == pytest.approx(learnt().ensemble.vertex_count, rel=1e-5)


def test_each_rank_is_balanced_to_its_weight():
    level = learnt().ensemble.vertex_levels
    ranks = {"segment_weight": level == 1, "union_weight": (level > 1) & (level < level.max())}
    ranks["whole_weight"] = level == level.max()
    assert all(rank.any() for rank in ranks.values())
    for weights in (WEIGHTS, {"segment_weight": 3.0, "union_weight": 0.0, "whole_weight": 0.25}):
        params = StimuliParams(sigma=0.08, cutoff=0, **weights)
        for seen in seen_objects():
            vector = stimulated(seen, params)
            for name, rank in ranks.items():
                assert vector[rank].sum() == pytest.approx(weights[name] * len(level), rel=1e-5)


def test_where_all_that_was_learnt_is_single_segments_they_are_segments_and_not_wholes():
    """Without wholes apart, an object of one segment has one motif level: the first, which is the last too."""
    params = ModelParams(hierarchy=HierarchyParams(whole_apart=False))
    seen = perceive(see(ball(0.1), look(20, 35, 0.9)).cloud, params)
    dictionary = learnt().dictionary
    ensemble = grow_ensemble([seen], dictionary)
    assert set(ensemble.vertex_levels.tolist()) == {1}
    words = dictionary.words(seen.segment_descriptors)
    for gating in GATINGS:
        weighed = StimuliParams(gating=gating, balanced=True, **WEIGHTS)
        values = stimulate(ensemble, seen.constellations, seen.descriptors, words, weighed).values
        assert values.sum() == pytest.approx(WEIGHTS["segment_weight"] * ensemble.vertex_count, rel=1e-5)


def test_balance_changes_no_proportion_within_a_rank():
    level = learnt().ensemble.vertex_levels
    loud, plain = (
        stimulated(seen_objects()[2], StimuliParams(pooling="max", cutoff=0, balanced=b, **WEIGHTS))
        for b in (True, False)
    )
    for rank in (level == 1, (level > 1) & (level < level.max()), level == level.max()):
        assert np.allclose(loud[rank] * plain[rank].sum(), plain[rank] * loud[rank].sum(), rtol=1e-5)


@pytest.mark.parametrize("preset", PRESETS)
def test_a_training_object_finds_its_own_stimuli_again(preset: str):
    model = learnt(preset)
    for row, named in enumerate(named_clouds()):
        again = model.respond(named.cloud).stimuli
        start, stop = model.stimuli.indptr[row : row + 2]
        assert np.array_equal(again.indices, model.stimuli.indices[start:stop])
        assert np.array_equal(again.values, model.stimuli.data[start:stop])


def test_a_training_object_excites_its_own_vertices_most_of_all():
    """With the paper's gate, a vertex known from a single constellation answers it with the kernel's largest value."""
    model = learnt("paper")
    memory = [(h, row) for h in model.ensemble.hierarchies for row in h.prototypes.toarray().astype(bool)]
    checked = 0
    for v, (_, row) in enumerate(memory):
        if row.sum() == 1:
            own = model.ensemble.objects[row][0]
            assert model.stimuli[[int(own)], [v]][0] == pytest.approx(1, abs=1e-5)
            checked += 1
    assert checked > 5


@pytest.mark.parametrize("pooling", ["sum", "max"])
def test_a_narrower_gate_takes_stimuli_away_and_with_that_of_words_only_known_motifs_fire(pooling: str):
    model = learnt()
    for seen in perceived()[:5]:
        words = model.dictionary.words(seen.segment_descriptors)
        by_words, by_level, by_kernel = (
            stimulated(seen, StimuliParams(gating=g, pooling=pooling, balanced=False, cutoff=0)) for g in GATINGS
        )
        known, first = set(), 0
        for f, hierarchy in enumerate(model.ensemble.hierarchies):
            known |= {
                first + hierarchy.index[m] for m in seen.constellations.motifs(words[:, f]) if m in hierarchy.index
            }
            first += len(hierarchy.vertices)
        assert set(np.flatnonzero(by_words).tolist()) <= known
        assert (by_words <= by_level).all()
        assert (by_level <= by_kernel).all()


@pytest.mark.parametrize("cutoff", [0.01, 0.05, 0.09])
def test_what_is_at_most_the_cutoff_is_no_stimulus(cutoff: float):
    everything, kept = (
        stimulated(
            perceived()[0],
            StimuliParams(sigma=0.02, gating="kernel", pooling="max", coverage_power=2, balanced=False, cutoff=c),
        )
        for c in (0, cutoff)
    )
    assert np.array_equal(kept, np.where(everything > np.float32(cutoff), everything, 0))
    assert (kept == 0).sum() > (everything == 0).sum()


def test_stimuli_are_sorted_positive_and_small():
    for named in named_clouds()[:3]:
        stimuli = learnt().respond(named.cloud).stimuli
        assert stimuli.indices.dtype == np.int32
        assert stimuli.values.dtype == np.float32
        assert (np.diff(stimuli.indices) > 0).all()
        assert (stimuli.values > 0).all()


def test_answering_does_not_change_the_ensemble():
    model = learnt("paper")
    before = {name: array.tobytes() for name, array in model.to_tensors().items()}
    for named in named_clouds()[:4]:
        model.respond(named.cloud)
    assert {name: array.tobytes() for name, array in model.to_tensors().items()} == before
