"""Novelty: what its numbers mean, and that what nobody learnt is told from what was."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import kstest

from service import clouds
from service.engine.cloud import PointCloud
from service.engine.motifs import Ensemble
from service.engine.novelty import NoveltyScale, divergences_from, whole_of
from service.engine.params import ModelParams
from service.engine.perception import perceive
from tests.learnt import PRESETS, learnt, named_clouds, objects, perceived
from tests.shapes import cloud_of, rotation
from worker.learning.novelty import learn_novelty
from worker.learning.observations import NamedCloud, Observation, observe

presets = pytest.mark.parametrize("preset", PRESETS)
Points = NDArray[np.float64]


def scale(*divergences: float) -> NoveltyScale:
    return NoveltyScale(np.arange(len(divergences)), np.sort(np.float32(divergences)))


def test_novelty_is_the_share_of_training_objects_that_are_less_apart():
    assert [scale(0.1, 0.2, 0.3, 0.4).novelty(d) for d in (0.0, 0.1, 0.15, 0.3, 0.35, 0.69)] == [
        0,
        0,
        0.25,
        0.5,
        0.75,
        1,
    ]


def test_two_training_objects_tell_nearer_from_farther_than_they_are_from_each_other():
    assert [scale(0.2, 0.2).novelty(d) for d in (0.0, 0.1, 0.2, 0.3)] == [0, 0, 0, 1]


def test_what_is_a_repetition_of_repetitions_is_not_novel():
    assert [scale(0, 0, 0).novelty(d) for d in (0.0, 0.1)] == [0, 1]


@presets
def test_the_whole_is_the_constellation_of_all_segments(preset: str):
    for seen in perceived(preset):
        assert seen.constellations.members[whole_of(seen.constellations)].all()
        assert seen.constellations.coverage[whole_of(seen.constellations)] == pytest.approx(1)


@presets
def test_what_was_learnt_is_not_novel(preset: str):
    for named in named_clouds():
        assert learnt(preset).respond(named.cloud).novelty == 0


@presets
def test_novelty_follows_from_the_nearest_whole(preset: str):
    model = learnt(preset)
    seen = perceived(preset)[0]
    divergences = divergences_from(seen.descriptors[whole_of(seen.constellations)], model.wholes)
    assert divergences.argmin() == 0
    assert divergences[0] < 1e-6
    for i, other in enumerate(perceived(preset)):
        whole = other.descriptors[whole_of(other.constellations)]
        assert np.array_equal(model.ensemble.prototypes[model.novelty_scale.wholes[i]], whole)


def test_novelty_does_not_depend_on_the_filtration_time():
    cloud = objects(8, 11)[0].cloud
    assert len({learnt().respond(cloud, time=time).novelty for time in (0.0, 0.5, 1.0, None)}) == 1


def helix(rng: np.random.Generator) -> Points:
    turn = np.linspace(0, 2 * np.pi * rng.integers(3, 8), 5000)
    wire = np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), np.linspace(-1, 1, len(turn))], axis=1)
    return wire + 0.008 * rng.standard_normal(wire.shape)


def filled_ball(rng: np.random.Generator) -> Points:
    direction = rng.standard_normal((6000, 3))
    return direction / np.linalg.norm(direction, axis=1, keepdims=True) * rng.random((6000, 1)) ** (1 / 3)


def blob(rng: np.random.Generator) -> Points:
    return rng.standard_normal((6000, 3)) * rng.uniform(0.6, 1, 3)


def cage(rng: np.random.Generator) -> Points:
    """The twelve edges of a box, of wire."""
    edges = []
    for axis, u, v in ((axis, u, v) for axis in range(3) for u in (-1, 1) for v in (-1, 1)):
        edges.append(np.insert(np.tile([[u, v]], (600, 1)), axis, rng.uniform(-1, 1, 600), axis=1))
    return np.concatenate(edges) * rng.uniform(0.5, 1, 3) + 0.015 * rng.standard_normal((7200, 3))


@cache
def learnt_sixty() -> tuple[Ensemble, NoveltyScale]:
    """All that novelty needs of a model of 60 objects."""
    seen = observe((NamedCloud(str(o.index), o.cloud) for o in objects(60, 21)), ModelParams())
    known = [o for o in seen if isinstance(o, Observation)]
    owners = np.repeat(np.arange(len(known)), [len(o.descriptors) for o in known])
    ensemble = Ensemble((), np.concatenate([o.descriptors for o in known]), owners, np.ones(len(owners)))
    return ensemble, learn_novelty(known, ensemble)


def novelty(cloud: PointCloud) -> float:
    seen = perceive(cloud, ModelParams())
    ensemble, scale = learnt_sixty()
    wholes = ensemble.distributions.of(scale.wholes)
    return scale.novelty(divergences_from(seen.descriptors[whole_of(seen.constellations)], wholes).min())


@pytest.mark.parametrize("shape", [helix, filled_ball, blob, cage])
def test_what_nobody_could_have_learnt_is_novel(shape: Callable[[np.random.Generator], Points]):
    """No composition of a few solids looks like any of these, from any side."""
    for seed in range(4):
        points = 0.1 * shape(np.random.default_rng(seed)) @ rotation(seed) + [0, 0, 0.9]
        assert novelty(cloud_of(points)) > 0.95


def test_objects_like_the_learnt_ones_have_novelties_of_all_kinds():
    """Held-out objects of the same simulation: their novelties are as those of a uniform draw would be."""
    novelties = [novelty(o.cloud) for o in objects(30, 22)]
    assert kstest(novelties, "uniform").pvalue > 0.01


@pytest.mark.data
def test_a_table_full_of_things_is_novel(scans: Path):
    for file in sorted((scans / "scenes").glob("*.pcd"))[:3]:
        assert novelty(clouds.read(file.read_bytes())) > 0.95
