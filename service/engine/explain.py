"""Why a response is what it is: the segments seen, the motif vertices that fired, the training objects behind it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.engine.concepts import Spectrum
from service.engine.divergence import jsd_matrix
from service.engine.motifs import Ensemble, Hierarchy
from service.engine.perception import Perception
from service.engine.prototypes import Prototypes
from service.engine.stimuli import Excitation, Stimuli

VERTICES = 8  # motif vertices that are told of
CONCEPTS = 3  # concepts that are told of
NEAREST = 3  # training objects that are told of in each place
HOLDS = 0.98  # share of a segment's points within its extent


class Likeness(NamedTuple):
    """A training object, and how far the object, or a part of it, is from it.

    Attributes:
        object: its place among the N training objects.
        key: what its cloud was called.
        hash: SHA-256 of its cloud's points, in hexadecimal.
        distance: in the unit of what is compared.
    """

    object: int
    key: str
    hash: str
    distance: float


class SeenSegment(NamedTuple):
    """One segment of the object.

    Attributes:
        share: of the surface seen, (0, 1].
        adjacent: numbers of the segments beside it.
        words: its visual word on each level of the dictionary.
        centroid_m: (x, y, z), in the sensor's frame, metres.
        extent_m: the diameter about the centroid that holds 98 % of its points, metres.
        nearest: the training objects with a motif prototype most like it, by JSD in nats.
    """

    share: float
    adjacent: tuple[int, ...]
    words: tuple[int, ...]
    centroid_m: tuple[float, float, float]
    extent_m: float
    nearest: tuple[Likeness, ...]


class FiredVertex(NamedTuple):
    """A motif vertex, and what fired it.

    Attributes:
        vertex: its place in the stimuli vector.
        hierarchy: f of H_f.
        also_in: further hierarchies where a vertex of the very same motif prototypes fired; it is not told again.
        level: its motif level.
        words: of its motif, on level f of the dictionary.
        stimulus: gamma of Eq. 1, scaled by rank where the model is balanced.
        segments: of the constellation that excites it most.
        prototypes: how many motif prototypes it memorises, |T^v|.
        nearest: the training objects of the motif prototypes most like that constellation, by JSD in nats.
    """

    vertex: int
    hierarchy: int
    also_in: tuple[int, ...]
    level: int
    words: tuple[int, ...]
    stimulus: float
    segments: tuple[int, ...]
    prototypes: int
    nearest: tuple[Likeness, ...]


class NearConcept(NamedTuple):
    """One of the best concepts.

    Attributes:
        id: node of the concept in the merge tree.
        nearest: its prototypes nearest to the object, by the Mahalanobis distance of Eq. 4.
    """

    id: int
    nearest: tuple[Likeness, ...]


class Explanation(NamedTuple):
    """What a person needs to check a response.

    Attributes:
        segments: of the object, by number.
        vertices: the motif vertices that fired most, by how many times the
            mean of their motif level; of equal ones the first.
        concepts: the best concepts, as ranked.
        wholes: the training objects most like the object as a whole, by JSD in nats: its novelty is by the first.
    """

    segments: tuple[SeenSegment, ...]
    vertices: tuple[FiredVertex, ...]
    concepts: tuple[NearConcept, ...]
    wholes: tuple[Likeness, ...]


class Evidence(NamedTuple):
    """What a response was made of.

    Attributes:
        seen: the object.
        words: (S, n) of the segments.
        excitation: of the vertices by the constellations.
        stimuli: *gamma^o.
        distances: (N,): Mahalanobis distances from the training objects.
        divergences: (N,): JSD of the whole from those of the training objects, nats.
        ranking: (K,): places of the concepts, best first.
    """

    seen: Perception
    words: NDArray[np.int64]
    excitation: Excitation
    stimuli: Stimuli
    distances: NDArray[np.float64]
    divergences: NDArray[np.float32]
    ranking: NDArray[np.int64]


def explain_response(evidence: Evidence, ensemble: Ensemble, spectrum: Spectrum, prototypes: Prototypes) -> Explanation:
    """Tells why a response is what it is.

    Args:
        evidence: what it was made of.
        ensemble: HE.
        spectrum: the concepts that were responded to.
        prototypes: the training objects.
    """
    everything = np.arange(len(prototypes.cloud_keys))
    return Explanation(
        segments=_segments(evidence, ensemble, prototypes),
        vertices=_fired(evidence, ensemble, prototypes),
        concepts=tuple(
            NearConcept(
                int(spectrum.ids[c]),
                _nearest(evidence.distances, spectrum.members(c), prototypes),
            )
            for c in evidence.ranking[:CONCEPTS].tolist()
        ),
        wholes=_nearest(evidence.divergences, everything, prototypes),
    )


def _segments(evidence: Evidence, ensemble: Ensemble, prototypes: Prototypes) -> tuple[SeenSegment, ...]:
    graph, everything = evidence.seen.graph, np.arange(len(ensemble.prototypes))
    seen = []
    for s in range(graph.count):
        points = graph.frame.to_sensor(graph.points[graph.labels == s])
        x, y, z = points.mean(axis=0).tolist()
        radius = np.quantile(np.linalg.norm(points - [x, y, z], axis=1), HOLDS)
        seen.append(
            SeenSegment(
                share=float(graph.share[s]),
                adjacent=tuple(sorted(int(a + b - s) for a, b in graph.edges.tolist() if s in (a, b))),
                words=tuple(evidence.words[s].tolist()),
                centroid_m=(x, y, z),
                extent_m=float(2 * radius),
                nearest=_most_alike(evidence.seen.descriptors[s], everything, ensemble, prototypes),
            )
        )
    return tuple(seen)


def _fired(evidence: Evidence, ensemble: Ensemble, prototypes: Prototypes) -> tuple[FiredVertex, ...]:
    """The strongest vertices; those of other hierarchies with the same motif prototypes are told of together."""
    places: dict[bytes, list[int]] = {}  # in the stimuli, by motif prototypes
    for k in np.argsort(-_strength(evidence.stimuli, ensemble), kind="stable").tolist():
        same = places.setdefault(_memories(int(evidence.stimuli.indices[k]), ensemble).tobytes(), [])
        same.append(k)
        if len(places) > VERTICES:
            break
    return tuple(_account(same, evidence, ensemble, prototypes) for same in list(places.values())[:VERTICES])


def _strength(stimuli: Stimuli, ensemble: Ensemble) -> NDArray[np.float64]:
    """How many times the mean stimulus of its motif level each one is: levels of few vertices have larger ones."""
    level = ensemble.vertex_levels
    total = np.bincount(level[stimuli.indices], stimuli.values, minlength=int(level.max()) + 1)
    mean = total / np.maximum(np.bincount(level), 1)
    return np.asarray(stimuli.values / mean[level[stimuli.indices]])


def _account(same: list[int], evidence: Evidence, ensemble: Ensemble, prototypes: Prototypes) -> FiredVertex:
    """What is told of the vertices at these places of the stimuli."""
    vertex, *others = evidence.stimuli.indices[same].tolist()
    f, hierarchy, place = _locate(vertex, ensemble)
    level, words = hierarchy.vertices[place]
    memories = _memories(vertex, ensemble)
    constellation = int(np.argmax(evidence.excitation.alpha[:, vertex]))
    seen = evidence.seen
    return FiredVertex(
        vertex=vertex,
        hierarchy=f,
        also_in=tuple(sorted(_locate(other, ensemble)[0] for other in others)),
        level=level,
        words=words,
        stimulus=float(evidence.stimuli.values[same[0]]),
        segments=tuple(np.flatnonzero(seen.constellations.members[constellation]).tolist()),
        prototypes=len(memories),
        nearest=_most_alike(seen.descriptors[constellation], memories, ensemble, prototypes),
    )


def _locate(vertex: int, ensemble: Ensemble) -> tuple[int, Hierarchy, int]:
    """f, H_f and the place in it, of a place in the stimuli vector."""
    for f, hierarchy in enumerate(ensemble.hierarchies, start=1):
        if vertex < len(hierarchy.vertices):
            return f, hierarchy, vertex
        vertex -= len(hierarchy.vertices)
    raise AssertionError("a stimulus is that of a vertex")


def _memories(vertex: int, ensemble: Ensemble) -> NDArray[np.int64]:
    """T^v: the motif prototypes at a place of the stimuli vector."""
    _, hierarchy, place = _locate(vertex, ensemble)
    first, last = hierarchy.prototypes.indptr[place : place + 2]
    return np.asarray(hierarchy.prototypes.indices[first:last], dtype=np.int64)


def _most_alike(
    descriptor: NDArray[np.float32], memories: NDArray[np.int64], ensemble: Ensemble, prototypes: Prototypes
) -> tuple[Likeness, ...]:
    """The training objects of the motif prototypes, of those given, that are most like a description (D,)."""
    divergences = np.full(len(prototypes.cloud_keys), np.inf, np.float32)
    owners = ensemble.objects[memories]
    np.minimum.at(divergences, owners, jsd_matrix(descriptor[None], ensemble.distributions.of(memories))[0])
    return _nearest(divergences, np.unique(owners), prototypes)


def _nearest(
    distance: NDArray[np.floating], objects: NDArray[np.int64], prototypes: Prototypes
) -> tuple[Likeness, ...]:
    """The nearest of these training objects, for distances from all of them (N,); of equal ones the first."""
    order = objects[np.argsort(distance[objects], kind="stable")[:NEAREST]]
    return tuple(
        Likeness(o, prototypes.cloud_keys[o], prototypes.cloud_hashes[o], float(distance[o])) for o in order.tolist()
    )
