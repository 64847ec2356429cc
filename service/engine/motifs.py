"""Constellations of segments, and the shape motif hierarchies that memorise them.

Sec. Hierarchical Object Decomposition and Representation.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, vstack

from service.engine.divergence import Distributions, distributions
from service.engine.params import HierarchyParams
from service.engine.segments import SegmentGraph

Motif = tuple[int, tuple[int, ...]]
"""A motif level and the sorted visual words of a constellation: what a motif vertex is unique by."""


class Rank(IntEnum):
    """What a constellation is, however many segments its object has."""

    SEGMENT = 0
    UNION = 1
    WHOLE = 2


@dataclass(frozen=True)
class Constellations:
    """An object's segments, propagated from single ones to the whole object.

    Attributes:
        members: (C, S) bool: the segments of each constellation; each set stands once.
        levels: (L, 2) int64: on which motif level, counted from 1, which constellation occurs; rows (level, c).
        edges: (E, 2) int64: pairs of rows of `levels` that are joined by an edge, on one motif level.
        propagations: (K, 2) int64: rows of `levels`, from a constellation to a union on the next level.
        coverage: (C,) float64: the share of the object's surface that each constellation covers.
        truncated: whether a level held more constellations than are kept.
    """

    members: NDArray[np.bool_]
    levels: NDArray[np.int64]
    edges: NDArray[np.int64]
    propagations: NDArray[np.int64]
    coverage: NDArray[np.float64]
    truncated: bool

    def motifs(self, words: NDArray[np.int64]) -> list[Motif]:
        """The motif of each row of `levels`, for the segments' words (S,) of one description level."""
        of_set = [tuple(sorted(words[m].tolist())) for m in self.members]
        return [(int(level), of_set[c]) for level, c in self.levels]


@dataclass(frozen=True)
class Hierarchy:
    """A shape motif hierarchy H_f.

    Attributes:
        vertices: the motif of each motif vertex.
        prototypes: (V, P) sparse, 1 where a motif prototype is memorised by a vertex (T^v).
        edges: (E, 2) int64: vertices that are joined within a level; sorted, each once.
        propagations: (K, 2) int64: from a vertex to one of the next level; sorted, each once.
    """

    vertices: tuple[Motif, ...]
    prototypes: csr_array
    edges: NDArray[np.int64]
    propagations: NDArray[np.int64]

    @cached_property
    def index(self) -> dict[Motif, int]:
        """The vertex of each motif."""
        return {motif: v for v, motif in enumerate(self.vertices)}


class Memories(NamedTuple):
    """What the motif vertices of one rank memorise.

    Attributes:
        vertices: (W,) int64: the vertices, among all of the ensemble.
        prototypes: the Q motif prototypes of these vertices.
        mean_over_vertex: (Q, W) sparse, as that of the ensemble.
        means_of_vertices: (W, Q) sparse: the same, a row a vertex.
    """

    vertices: NDArray[np.int64]
    prototypes: Distributions
    mean_over_vertex: csr_array
    means_of_vertices: csr_array


@dataclass(frozen=True)
class Ensemble:
    """The shape motif hierarchy ensemble HE: one hierarchy a description level, over shared motif prototypes.

    Attributes:
        hierarchies: H_1 to H_n.
        prototypes: (P, D) float32: the descriptions of the memorised constellations.
        objects: (P,) int64: the training object from which each prototype stems.
        coverage: (P,) float64: the share of that object's surface that its constellation covers.
    """

    hierarchies: tuple[Hierarchy, ...]
    prototypes: NDArray[np.float32]
    objects: NDArray[np.int64]
    coverage: NDArray[np.float64]

    @cached_property
    def vertex_count(self) -> int:
        """Number of motif vertices V of all hierarchies: the dimension of the stimuli vector."""
        return sum(len(h.vertices) for h in self.hierarchies)

    @cached_property
    def vertex_levels(self) -> NDArray[np.int64]:
        """The motif level of each vertex (V,)."""
        return np.array([level for h in self.hierarchies for level, _ in h.vertices], dtype=np.int64)

    @cached_property
    def top_level(self) -> int:
        """The highest motif level."""
        return int(self.vertex_levels.max())

    @cached_property
    def vertex_ranks(self) -> NDArray[np.int64]:
        """The `Rank` of each vertex (V,), by its motif level; the highest of all but the first is that of wholes."""
        level = self.vertex_levels
        above = np.where(level < level.max(), Rank.UNION, Rank.WHOLE)
        return np.where(level == 1, Rank.SEGMENT, above).astype(np.int64)

    @cached_property
    def distributions(self) -> Distributions:
        """The motif prototypes, to be compared with."""
        return distributions(self.prototypes)

    @cached_property
    def mean_over_vertex(self) -> csr_array:
        """(P, V) sparse: a row of kernel values times this is the mean over each vertex's prototypes (Eq. 1)."""
        members = csr_array(vstack([h.prototypes for h in self.hierarchies], format="csr"))
        mean = csr_array(members.multiply(1.0 / np.diff(members.indptr)[:, None]))
        return csr_array(mean.T.tocsr())

    @cached_property
    def memories(self) -> dict[Rank, Memories]:
        """What the vertices of each rank that there is memorise."""
        found = {}
        for rank in Rank:
            vertices = np.flatnonzero(self.vertex_ranks == rank)
            mean = csr_array(self.mean_over_vertex[:, vertices])
            used = np.flatnonzero(np.diff(mean.indptr))
            if len(vertices):
                own = csr_array(mean[used])
                found[rank] = Memories(vertices, distributions(self.prototypes[used]), own, csr_array(own.T.tocsr()))
        return found


def propagate(graph: SegmentGraph, params: HierarchyParams) -> Constellations:
    """Propagates an object's segments through the motif levels.

    Level 1: single segments, with an edge where they are adjacent. Each edge's union is a constellation of the next
    level, where an edge joins constellations that share a segment; and so on, until one is left. The whole object is
    always the last; with `whole_apart` it stands once more, on the level `max_levels` + 1, where there are only wholes.
    Of more than `max_constellations` on a level the largest are kept (of equal ones that of the larger segments).
    """
    whole = (1 << graph.count) - 1
    found = _Found()
    level = [1 << s for s in range(graph.count)]
    pairs = [(1 << a, 1 << b) for a, b in graph.edges.tolist()]
    truncated = False
    for number in range(1, params.max_levels + 1):
        for mask in level:
            found.add(number, mask)
        if number > 1:
            pairs = [(a, b) for i, a in enumerate(level) for b in level[i + 1 :] if a & b]
        unions = sorted({a | b for a, b in pairs}, key=lambda mask: (-_coverage(mask, graph.share), mask))
        truncated |= len(unions) > params.max_constellations
        kept = unions[: params.max_constellations]
        found.join(number, pairs, set(kept))
        if not kept:
            break
        level = kept
    else:
        truncated |= level != [whole]
    return found.record(whole, params.max_levels + 1 if params.whole_apart else None, graph.share, truncated)


def segments_and_whole(graph: SegmentGraph, params: HierarchyParams) -> Constellations:
    """An object's single segments and, apart, the whole: what `propagate` finds without the unions between."""
    found = _Found()
    for segment in range(graph.count):
        found.add(1, 1 << segment)
    return found.record((1 << graph.count) - 1, params.max_levels + 1, graph.share, truncated=False)


class _Found:
    """Collects the constellations, level by level."""

    def __init__(self) -> None:
        self.rows: dict[tuple[int, int], int] = {}
        self.edges: list[tuple[int, int]] = []
        self.unions: list[tuple[tuple[int, int], tuple[int, int]]] = []

    def add(self, level: int, mask: int) -> None:
        self.rows.setdefault((level, mask), len(self.rows))

    def join(self, level: int, pairs: list[tuple[int, int]], kept: set[int]) -> None:
        for a, b in pairs:
            self.edges.append((self.rows[level, a], self.rows[level, b]))
            if a | b in kept:
                self.unions += [((level, a), (level + 1, a | b)), ((level, b), (level + 1, a | b))]

    def record(self, whole: int, top: int | None, share: NDArray[np.float64], truncated: bool) -> Constellations:
        """All that was found, and the whole object: on the level `top`, or, where that is None, as the last."""
        if top is not None:
            self.add(top, whole)
        elif all(mask != whole for _, mask in self.rows):
            self.add(max(level for level, _ in self.rows) + 1, whole)
        masks = list(dict.fromkeys(mask for _, mask in self.rows))
        place = {mask: c for c, mask in enumerate(masks)}
        members = np.array([[bool(mask >> s & 1) for s in range(len(share))] for mask in masks])
        unions = sorted({(self.rows[a], self.rows[b]) for a, b in self.unions if b in self.rows})
        return Constellations(
            members=members,
            levels=np.array([(level, place[mask]) for level, mask in self.rows], dtype=np.int64),
            edges=np.array(self.edges, dtype=np.int64).reshape(-1, 2),
            propagations=np.array(unions, dtype=np.int64).reshape(-1, 2),
            coverage=members @ share,
            truncated=truncated,
        )


def _coverage(mask: int, share: NDArray[np.float64]) -> float:
    return sum(s for i, s in enumerate(share.tolist()) if mask >> i & 1)
