"""Explanations: that what they tell is true, and enough to check a response by."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.distance import jensenshannon

from service.engine.cloud import PointCloud
from service.engine.explain import CONCEPTS, NEAREST, VERTICES, Explanation, FiredVertex, Likeness
from service.engine.model import Response, ShapeModel
from service.engine.motifs import Hierarchy
from service.engine.params import StimuliParams
from service.engine.perception import Perception
from tests.learnt import PRESETS, learnt, named_clouds, objects, perceived
from tests.shapes import can, cloud_of, lid_view, see

presets = pytest.mark.parametrize("preset", PRESETS)


def explained(model: ShapeModel, cloud: PointCloud, time: float | None = None) -> tuple[Response, Explanation]:
    response = model.respond(cloud, time=time, explain=True)
    assert response.explanation is not None
    return response, response.explanation


def memories(hierarchy: Hierarchy, place: int) -> list[int]:
    return np.flatnonzero(hierarchy.prototypes[[place]].toarray()).tolist()


def place_of(fired: FiredVertex, model: ShapeModel) -> tuple[Hierarchy, int]:
    first = sum(len(h.vertices) for h in model.ensemble.hierarchies[: fired.hierarchy - 1])
    return model.ensemble.hierarchies[fired.hierarchy - 1], fired.vertex - first


def likenesses(explanation: Explanation) -> list[tuple[Likeness, ...]]:
    told = (*explanation.segments, *explanation.vertices, *explanation.concepts)
    return [explanation.wholes, *(part.nearest for part in told)]


@presets
def test_what_is_named_is_a_training_object_and_the_nearest_comes_first(preset: str):
    model = learnt(preset)
    for simulated in objects(5, 11):
        for nearest in likenesses(explained(model, simulated.cloud)[1]):
            assert 1 <= len(nearest) <= NEAREST
            assert len({near.object for near in nearest}) == len(nearest)
            assert [near.distance for near in nearest] == sorted(near.distance for near in nearest)
            for near in nearest:
                assert near.key == model.prototypes.cloud_keys[near.object]
                assert near.hash == model.prototypes.cloud_hashes[near.object]
                assert near.distance >= 0


@presets
def test_a_training_object_is_explained_by_itself(preset: str):
    model = learnt(preset)
    assignment = model.concepts().assignment
    for i, named in enumerate(named_clouds()):
        response, explanation = explained(model, named.cloud)
        assert explanation.wholes[0].object == i
        assert explanation.wholes[0].distance < 1e-6
        for segment in explanation.segments:
            assert segment.nearest[0].distance < 1e-6
        for concept in explanation.concepts:
            if assignment[i] >= 0 and concept.id == response.concept_ids[assignment[i]]:
                assert concept.nearest[0].object == i
                assert concept.nearest[0].distance == pytest.approx(0, abs=5e-3)  # of roots of rounding


@presets
def test_segments_are_those_that_were_seen(preset: str):
    model = learnt(preset)
    for named, seen in zip(named_clouds(), perceived(preset), strict=True):
        segments = explained(model, named.cloud)[1].segments
        assert [segment.share for segment in segments] == seen.graph.share.tolist()
        assert [segment.words for segment in segments] == [
            tuple(words) for words in model.dictionary.words(seen.segment_descriptors).tolist()
        ]
        pairs = {(s, other) for s, segment in enumerate(segments) for other in segment.adjacent}
        assert pairs == {pair for a, b in seen.graph.edges.tolist() for pair in ((a, b), (b, a))}


def test_segments_lie_where_they_were_measured_and_are_as_large():
    """A can's side is a cylinder's front, its lid a disc of 10 cm above it."""
    observation = see(can(0.05, 0.14), lid_view(1, 0.9))
    points = observation.cloud.points
    segments = explained(learnt(), observation.cloud)[1].segments
    assert len(segments) == 2
    for face in np.unique(observation.faces):
        own = points[observation.faces == face]
        near = min(segments, key=lambda segment: np.linalg.norm(own.mean(axis=0) - segment.centroid_m))
        assert np.linalg.norm(own.mean(axis=0) - near.centroid_m) < 0.012
        assert near.extent_m == pytest.approx(np.linalg.norm(own - own.mean(axis=0), axis=1).max() * 2, rel=0.15)


@presets
def test_vertices_are_the_strongest_each_motif_prototypes_told_once(preset: str):
    model = learnt(preset)
    for named in [*named_clouds()[:5]]:
        response, explanation = explained(model, named.cloud)
        stimulus = dict(zip(*(part.tolist() for part in response.stimuli), strict=True))
        assert 0 < len(explanation.vertices) <= VERTICES
        strength = compared_with_its_level(stimulus, model)
        assert strength[explanation.vertices[0].vertex] > max(strength.values()) * (1 - 1e-6)
        told: set[tuple[int, ...]] = set()
        for fired in explanation.vertices:
            hierarchy, place = place_of(fired, model)
            assert (fired.level, fired.words) == hierarchy.vertices[place]
            assert fired.stimulus == stimulus[fired.vertex]
            own = memories(hierarchy, place)
            assert fired.prototypes == len(own)
            assert {near.object for near in fired.nearest} <= set(model.ensemble.objects[own].tolist())
            assert tuple(own) not in told
            told.add(tuple(own))
            for other in fired.also_in:
                further = model.ensemble.hierarchies[other - 1]
                assert any(memories(further, v) == own for v in range(len(further.vertices)))
        weakest, first = strength[explanation.vertices[-1].vertex], 0
        for hierarchy in model.ensemble.hierarchies:
            for place in range(len(hierarchy.vertices)):
                if strength.get(first + place, 0) > weakest * (1 + 1e-6):
                    assert tuple(memories(hierarchy, place)) in told
            first += len(hierarchy.vertices)


def compared_with_its_level(stimulus: dict[int, float], model: ShapeModel) -> dict[int, float]:
    """Each stimulus over the mean of all vertices of its motif level."""
    levels = [level for h in model.ensemble.hierarchies for level, _ in h.vertices]
    mean = {
        level: sum(stimulus.get(v, 0.0) for v, other in enumerate(levels) if other == level) / levels.count(level)
        for level in {levels[v] for v in stimulus}
    }
    return {v: value / mean[levels[v]] for v, value in stimulus.items()}


@cache
def taking_the_largest() -> ShapeModel:
    """The default model, but that a vertex's stimulus is the largest of those of all constellations."""
    kernel = StimuliParams(sigma=0.08, gating="kernel", pooling="max", coverage_power=2, balanced=False)
    return replace(learnt(), params=learnt().params.model_copy(update={"stimuli": kernel}))


def fired_by(fired: FiredVertex, seen: Perception) -> int:
    """The constellation that is said to have fired a vertex."""
    members = np.isin(np.arange(seen.graph.count), fired.segments)
    (c,) = np.flatnonzero((seen.constellations.members == members).all(axis=1))
    return int(c)


def test_a_vertex_is_fired_by_the_constellation_that_excites_it_most():
    """Eq. 1 for that constellation alone gives the stimulus, where stimuli are the maximum over constellations."""
    model = taking_the_largest()
    params = model.params.stimuli
    for named, seen in list(zip(named_clouds(), perceived(), strict=True))[:5]:
        for fired in explained(model, named.cloud)[1].vertices:
            c, own = fired_by(fired, seen), memories(*place_of(fired, model))
            jsd = np.array([jensenshannon(seen.descriptors[c], model.ensemble.prototypes[p]) ** 2 for p in own])
            alpha = np.exp(-(jsd**2) / (2 * params.sigma**2)).mean()
            alpha *= seen.constellations.coverage[c] ** params.coverage_power
            assert fired.stimulus == pytest.approx(alpha, rel=1e-3)
            assert fired.nearest[0].distance == pytest.approx(jsd.min(), abs=3e-6)


@pytest.mark.parametrize("pooling", ["mean", "max", "sum"])
@pytest.mark.parametrize("loud", ["segment_weight", "union_weight", "whole_weight"])
def test_with_the_gate_of_ranks_a_vertex_is_fired_by_a_constellation_of_its_own_rank(pooling: str, loud: str):
    weights = {"segment_weight": 0.0, "union_weight": 0.0, "whole_weight": 0.0, loud: 1.0}
    of_rank = learnt().params.stimuli.model_copy(update={"gating": "rank", "pooling": pooling, **weights})
    model = replace(learnt(), params=learnt().params.model_copy(update={"stimuli": of_rank}))
    top, told = int(model.ensemble.vertex_levels.max()), 0
    for named, seen in list(zip(named_clouds(), perceived(), strict=True))[:5]:
        for fired in explained(model, named.cloud)[1].vertices:
            segments, told = len(fired.segments), told + 1
            if loud == "segment_weight":
                assert (fired.level, segments) == (1, 1)
            elif loud == "union_weight":
                assert 1 < fired.level < top
                assert segments > 1 or seen.graph.count == 1
            else:
                assert (fired.level, segments) == (top, seen.graph.count)
    assert told >= 5


@presets
@pytest.mark.parametrize("time", [None, 0.5, 1.0])
def test_concepts_are_the_best_and_their_prototypes_the_nearest_of_them(preset: str, time: float | None):
    model = learnt(preset)
    spectrum = model.spectrum(time)
    for simulated in objects(4, 11):
        response, explanation = explained(model, simulated.cloud, time)
        assert [concept.id for concept in explanation.concepts] == response.concept_ids[response.ranking][
            :CONCEPTS
        ].tolist()
        for place, concept in zip(response.ranking, explanation.concepts, strict=False):
            members = spectrum.members(place)
            assert {near.object for near in concept.nearest} <= set(members.tolist())
            assert concept.nearest[0].distance <= response.distances[place]
            if len(members) <= NEAREST:
                mean = np.mean([near.distance for near in concept.nearest])
                assert response.distances[place] == pytest.approx(mean)


@presets
def test_novelty_is_by_the_first_of_the_wholes(preset: str):
    model = learnt(preset)
    for simulated in objects(5, 11):
        response, explanation = explained(model, simulated.cloud)
        assert response.novelty == model.novelty_scale.novelty(explanation.wholes[0].distance)


def test_points_in_another_order_have_the_same_explanation():
    cloud = objects(5, 11)[1].cloud
    order = np.random.default_rng(0).permutation(len(cloud.points))
    assert explained(learnt(), PointCloud(cloud.points[order]))[1] == explained(learnt(), cloud)[1]


def test_asking_why_changes_no_answer_and_is_a_stage_of_its_own():
    cloud = objects(5, 11)[0].cloud
    plain, told = learnt().respond(cloud), list[str]()
    response = learnt().respond(cloud, explain=True, segments=True, on_stage=told.append)
    assert told[-2:] == ["explanation", "points"]
    assert plain.explanation is None
    assert plain.point_segments is None
    assert plain.responses.tobytes() == response.responses.tobytes()


def test_where_there_is_no_concept_or_nothing_fired_the_rest_is_told():
    late = replace(learnt(), filtration=replace(learnt().filtration, time=np.ones_like(learnt().filtration.time)))
    assert explained(late, objects(5, 11)[0].cloud, 0.5)[1].concepts == ()
    blob = cloud_of(np.random.default_rng(0).standard_normal((5000, 3)) * 0.05 + [0, 0, 1])
    stimuli = learnt("paper").params.stimuli.model_copy(update={"cutoff": 0.09})
    deaf = replace(learnt("paper"), params=learnt("paper").params.model_copy(update={"stimuli": stimuli}))
    response, explanation = explained(deaf, blob)
    assert len(response.stimuli.indices) == len(explanation.vertices) == 0
    assert explanation.segments
    assert explanation.wholes
