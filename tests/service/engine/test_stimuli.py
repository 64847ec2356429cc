"""Stimuli against Eq. 1, word by word."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import jensenshannon

from service.engine.motifs import Ensemble
from service.engine.params import StimuliParams
from service.engine.perception import Perception
from service.engine.stimuli import Stimuli, gaussian_of_jsd, jsd_matrix, stimulate
from tests.learnt import learnt, named_clouds, perceived

GATINGS, POOLINGS = ("words", "kernel"), ("sum", "mean", "max")


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
    ours = jsd_matrix(p, q)
    assert np.abs(ours - [[jsd(a, b) for b in q] for a in p]).max() < 2e-6


def test_the_divergence_of_descriptions_is_that_of_scipy():
    rows = perceived()[0].descriptors
    assert np.abs(jsd_matrix(rows, rows) - [[jsd(a, b) for b in rows] for a in rows]).max() < 2e-6


def test_the_divergence_is_symmetric_bounded_and_nothing_between_equals():
    rows = sparse_distributions(2, 30, 64, 0.4)
    ours = jsd_matrix(rows, rows)
    assert np.abs(ours - ours.T).max() < 2e-6
    assert (ours >= 0).all()
    assert ours.max() <= np.log(2) + 2e-6
    assert np.diag(ours).max() < 2e-6
    apart = np.eye(2, 8, dtype=np.float32)
    assert jsd_matrix(apart[:1], apart[1:])[0, 0] == pytest.approx(np.log(2), abs=2e-6)


@pytest.mark.parametrize("sigma", [0.025, 0.08])
def test_the_kernel_squares_the_divergence(sigma: float):
    p, q = sparse_distributions(0, 6, 33, 0.9), sparse_distributions(1, 5, 33, 0.9)
    expected = [[np.exp(-(jsd(a, b) ** 2) / (2 * sigma**2)) for b in q] for a in p]
    assert np.allclose(gaussian_of_jsd(p, q, sigma), expected, rtol=1e-3, atol=1e-5)


def plain_stimuli(seen: Perception, words: NDArray[np.int64], ensemble: Ensemble, params: StimuliParams) -> list[float]:
    """Eq. 1 for each vertex of each hierarchy, and the pooling of what several constellations excite."""
    constellations, gamma = seen.constellations, []
    for f, hierarchy in enumerate(ensemble.hierarchies):
        occurs: dict[tuple[int, tuple[int, ...]], set[int]] = {}
        for level, c in constellations.levels.tolist():
            members = np.flatnonzero(constellations.members[c])
            occurs.setdefault((level, tuple(sorted(words[members, f].tolist()))), set()).add(c)
        memory = hierarchy.prototypes.toarray()
        for v, motif in enumerate(hierarchy.vertices):
            exciting = occurs.get(motif, set()) if params.gating == "words" else range(len(seen.descriptors))
            alphas = [
                constellations.coverage[c] ** params.coverage_power
                * np.mean([
                    np.exp(-(jsd(seen.descriptors[c], ensemble.prototypes[t]) ** 2) / (2 * params.sigma**2))
                    for t in np.flatnonzero(memory[v])
                ])
                for c in exciting
            ]  # fmt: skip
            pool = {"sum": sum, "mean": np.mean, "max": max}[params.pooling]
            gamma.append(float(pool(alphas)) if alphas else 0.0)
    return gamma


@pytest.mark.parametrize(("gating", "pooling"), list(product(GATINGS, POOLINGS)))
def test_stimuli_are_those_of_eq_1(gating: str, pooling: str):
    model = learnt()
    for seen, power in zip([p for p in perceived() if p.graph.count <= 3][:2], (0.0, 2.0), strict=True):
        params = StimuliParams(gating=gating, pooling=pooling, cutoff=0, coverage_power=power)
        words = model.dictionary.words(seen.segment_descriptors)
        ours = stimulate(model.ensemble, seen.constellations, seen.descriptors, words, params)
        expected = plain_stimuli(seen, words, model.ensemble, params)
        assert max(expected) > 0
        assert np.allclose(dense(ours, len(expected)), expected, rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize("preset", ["default", "paper"])
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


def test_with_the_gate_only_known_motifs_fire():
    model = learnt()
    for seen in perceived()[:5]:
        words = model.dictionary.words(seen.segment_descriptors)
        stimuli = [
            stimulate(model.ensemble, seen.constellations, seen.descriptors, words, StimuliParams(gating=g, cutoff=0))
            for g in GATINGS
        ]
        known, first = set(), 0
        for f, hierarchy in enumerate(model.ensemble.hierarchies):
            known |= {
                first + hierarchy.index[m] for m in seen.constellations.motifs(words[:, f]) if m in hierarchy.index
            }
            first += len(hierarchy.vertices)
        assert set(stimuli[0].indices.tolist()) <= known
        assert set(stimuli[0].indices.tolist()) <= set(stimuli[1].indices.tolist())


@pytest.mark.parametrize("cutoff", [0.01, 0.05, 0.09])
def test_what_is_at_most_the_cutoff_is_no_stimulus(cutoff: float):
    model, seen = learnt(), perceived()[0]
    words = model.dictionary.words(seen.segment_descriptors)
    everything, kept = (
        dense(
            stimulate(
                model.ensemble, seen.constellations, seen.descriptors, words, StimuliParams(sigma=0.02, cutoff=c)
            ),
            model.ensemble.vertex_count,
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
