"""The minimum spanning tree of distributions by their JSD: Boruvka's algorithm over lower bounds.

Boruvka (1926): the shortest edge out of each component is one of the tree, and components that it joins are one
henceforth; after a few rounds one is left. It is found by three distances, each used where those before leave a doubt:
of boxes and points by few coordinates (`coarse`), in single precision (`fine`), exact. March, Ram and Gray, "Fast
Euclidean minimum spanning tree", KDD 2010, look into boxes in the same way.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.divergence import LN2, sparse_jsd
from worker.learning.boxes import Boxes, of_one, squared_from
from worker.learning.coarse import at_least
from worker.learning.fine import nearly

ROUNDING = 1e-9  # relative, of a coarse bound
SMALLEST = 1e-12  # and absolute: distances are sums that cancel to about 1e-15
DOUBT = 1.01  # fine bounds that differ by less say nothing
SHARES = 8  # pieces of work for each thread
DEEPEST = 128  # boxes that wait to be looked into: two a level


class Rows(NamedTuple):
    """Vectors as the rows of a sparse matrix, and what to divide each by so that it sums to 1."""

    indptr: NDArray[np.integer]
    indices: NDArray[np.integer]
    data: NDArray[np.floating]
    total: NDArray[np.float64]


class _Known(NamedTuple):
    """What is known of each place (N,), whatever component it is in.

    Attributes:
        nearest: the place that is nearest of those outside its component; -1 where that is unknown.
        distance: of that one; where it is unknown a lower bound of it.
    """

    nearest: NDArray[np.int64]
    distance: NDArray[np.float64]


class _Desk(NamedTuple):
    """What a thread works with.

    Attributes:
        dense: (V,) the vector that is compared exactly with others, zeros elsewhere.
        single: (V,) float32: the one that is compared in single precision.
        held: (2,) the places of these two; -1 for none.
        candidates: room for N places.
        bounds: and for their fine bounds.
    """

    dense: NDArray[np.float64]
    single: NDArray[np.float32]
    held: NDArray[np.int64]
    candidates: NDArray[np.int64]
    bounds: NDArray[np.float64]


class _Forest(NamedTuple):
    """Components, and for each the places in it.

    Attributes:
        component: (N,) of each place.
        of_box: (T,) of each box, -1 where it has several.
        places: (N,) component by component.
        first: (C + 1,) where each component's begin.
    """

    component: NDArray[np.int64]
    of_box: NDArray[np.int64]
    places: NDArray[np.int64]
    first: NDArray[np.int64]


def spanning_tree(
    rows: Rows, dimensions: int, boxes: Boxes, threads: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Edges (N - 1, 2), the smaller vertex first, and their lengths (N - 1,), in no order.

    Edges are compared by (distance, smaller vertex, larger vertex), so that there is but one tree: however many threads
    look for it and whatever the bounds spare, it is the one that all exact distances give, bit for bit.

    Args:
        rows: the vectors.
        dimensions: V.
        boxes: the coarse coordinates of N of them; the others are left out.
        threads: at least 1.
    """
    size = len(boxes.vertex)
    known = _Known(np.full(size, -1), np.zeros(size))
    component = np.arange(size)
    edges, lengths = [np.empty((0, 2), np.int64)], [np.empty(0)]
    with ThreadPoolExecutor(threads) as pool:
        while (count := int(component.max()) + 1) > 1:
            forest = _forest(component, count, boxes)
            found = np.full((count, 2), -1)
            length = np.full(count, np.inf)
            shares = _shares(forest.first, threads)
            work = [
                pool.submit(_leave, forest, first, last, rows, dimensions, boxes, known, found, length)
                for first, last in shares
            ]
            for each in work:
                each.result()
            component, chosen = _join(component, found, count)
            edges.append(np.sort(boxes.vertex[found[chosen]], axis=1))
            lengths.append(length[chosen])
    return np.concatenate(edges), np.concatenate(lengths)


def _forest(component: NDArray[np.int64], count: int, boxes: Boxes) -> _Forest:
    places = np.argsort(component, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(component, minlength=count))])
    return _Forest(component, of_one(component, boxes.start, boxes.stop), places, first)


def _shares(first: NDArray[np.int64], threads: int) -> list[tuple[int, int]]:
    """Ranges of components of about equally many places, without the largest: the others find their ways to it."""
    largest = int(np.diff(first).argmax())
    target = max(int(first[-1]) // (SHARES * threads), 1)
    cuts = np.unique(np.searchsorted(first, np.arange(0, int(first[-1]), target)))
    ends = np.unique(np.concatenate([cuts, [largest, largest + 1, len(first) - 1]]))
    return [(a, b) for a, b in pairwise(ends.tolist()) if a != largest]


@njit(cache=True, nogil=True)
def _join(
    component: NDArray[np.int64], found: NDArray[np.int64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Components once the edges that were found are in, numbered by their first places; and which edges are new."""
    root = np.arange(count)
    chosen = np.empty(count, np.int64)
    new = 0
    for c in range(count):
        if found[c, 0] < 0:
            continue
        a, b = _root(root, component[found[c, 0]]), _root(root, component[found[c, 1]])
        if a != b:
            root[max(a, b)] = min(a, b)
            chosen[new] = c
            new += 1
    number = np.full(count, -1)
    out = np.empty_like(component)
    fresh = 0
    for place in range(len(component)):
        r = _root(root, component[place])
        if number[r] < 0:
            number[r] = fresh
            fresh += 1
        out[place] = number[r]
    return out, chosen[:new]


@njit(cache=True, nogil=True)
def _root(root: NDArray[np.int64], c: int) -> int:
    while root[c] != c:
        root[c] = root[root[c]]
        c = root[c]
    return c


@njit(cache=True, nogil=True)
def _leave(
    forest: _Forest,
    first: int,
    last: int,
    rows: Rows,
    dimensions: int,
    boxes: Boxes,
    known: _Known,
    found: NDArray[np.int64],
    length: NDArray[np.float64],
) -> None:
    """The shortest edge out of each component from `first` to before `last`, written to `found` and `length`."""
    size = len(boxes.vertex)
    desk = _Desk(
        np.zeros(dimensions), np.zeros(dimensions, np.float32), np.full(2, -1), np.empty(size, np.int64), np.empty(size)
    )
    hint, hinted = np.full(size, -1), np.full(size, np.inf)
    for c in range(first, last):
        places = forest.places[forest.first[c] : forest.first[c + 1]]
        a, b, best = -1, -1, np.inf
        for i in places:
            j = known.nearest[i]
            if j >= 0 and forest.component[j] == c:
                known.nearest[i] = -1
                j = -1
            if j < 0:
                j = hint[i]
                if j < 0 or forest.component[j] == c:
                    continue
                if _shorter(hinted[i], i, j, best, a, b, boxes.vertex):
                    a, b, best = i, j, hinted[i]
            elif _shorter(known.distance[i], i, j, best, a, b, boxes.vertex):
                a, b, best = i, j, known.distance[i]
        for i in places:
            if known.nearest[i] >= 0 or known.distance[i] > best:
                continue
            j, d = _nearest_outside(i, a, b, best, c, forest, rows, boxes, desk)
            known.distance[i] = d
            if j >= 0:
                known.nearest[i] = j
                hint[j], hinted[j] = i, d
                a, b, best = i, j, d
            elif a == i:
                known.nearest[i] = b
        found[c, 0], found[c, 1], length[c] = a, b, best


@njit(cache=True, nogil=True)
def _nearest_outside(
    i: int,
    a: int,
    b: int,
    best: float,
    own: int,
    forest: _Forest,
    rows: Rows,
    boxes: Boxes,
    desk: _Desk,
) -> tuple[int, float]:
    """Which place outside component `own` is nearest to place i, and its distance, if that edge is before a-b.

    Otherwise -1, and the distance of a-b.
    """
    candidates, bounds = desk.candidates, desk.bounds
    nearest, limit, again = -1, best, False
    likely = _likely(i, limit, own, forest, boxes)
    if likely >= 0:
        limit = min(limit, _nearly(i, likely, rows, boxes.vertex, desk) * DOUBT + SMALLEST)
    while True:
        count, limit = _look_around(i, limit, again, own, forest, rows, boxes, desk)
        first = np.argmin(bounds[:count]) if count else 0
        for turn in range(-1 if count else 0, count):  # the most promising first: it spares most of the others
            k = first if turn < 0 else turn
            j = candidates[k]
            if turn == first or bounds[k] > best or (i == a and j == b):
                continue
            d = _exact(i, j, rows, boxes.vertex, desk)
            if _shorter(d, i, j, best, a, b, boxes.vertex):
                a, b, best, nearest = i, j, d, j
        if best <= limit or again:
            break
        limit, again = best, True
    return nearest, best


@njit(cache=True, nogil=True)
def _likely(i: int, limit: float, own: int, forest: _Forest, boxes: Boxes) -> int:
    """The place outside component `own` that is nearest to place i by its coordinates; -1 if none is within the limit.

    It tells how far to look for the one that is nearest in truth.
    """
    stack = np.empty(DEEPEST, np.int64)
    stack[0], waiting, likely = 0, 1, -1
    point, start = boxes.points[i], boxes.start
    while waiting:
        waiting -= 1
        t = stack[waiting]
        if forest.of_box[t] == own or _rounded(squared_from(boxes.low, boxes.high, t, point)) > limit:
            continue
        if 2 * t + 2 < len(start):
            waiting = _look_into(t, point, boxes, stack, waiting)
            continue
        for j in range(start[t], boxes.stop[t]):
            if forest.component[j] != own:
                bound = at_least(boxes.points, i, j)
                if bound < limit or (likely < 0 and bound <= limit):
                    likely, limit = j, bound
    return likely


@njit(cache=True, nogil=True)
def _look_into(t: int, point: NDArray[np.float64], boxes: Boxes, stack: NDArray[np.int64], waiting: int) -> int:
    """Has the two boxes in box t wait, the nearer as the next; how many wait then."""
    left, right = 2 * t + 1, 2 * t + 2
    if squared_from(boxes.low, boxes.high, left, point) < squared_from(boxes.low, boxes.high, right, point):
        left, right = right, left
    stack[waiting], stack[waiting + 1] = left, right
    return waiting + 2


@njit(cache=True, nogil=True)
def _look_around(
    i: int,
    limit: float,
    fixed: bool,
    own: int,
    forest: _Forest,
    rows: Rows,
    boxes: Boxes,
    desk: _Desk,
) -> tuple[int, float]:
    """Places outside component `own` whose fine bound of the distance from place i is at most `limit`; how many.

    And the limit: unless it is fixed, it comes down to little above the smallest bound on the way.
    """
    stack = np.empty(DEEPEST, np.int64)
    stack[0], waiting, count = 0, 1, 0
    point, start = boxes.points[i], boxes.start
    while waiting:
        waiting -= 1
        t = stack[waiting]
        if forest.of_box[t] == own or _rounded(squared_from(boxes.low, boxes.high, t, point)) > limit:
            continue
        if 2 * t + 2 < len(start):
            waiting = _look_into(t, point, boxes, stack, waiting)
            continue
        for j in range(start[t], boxes.stop[t]):
            if forest.component[j] == own or at_least(boxes.points, i, j) * (1 - ROUNDING) - SMALLEST > limit:
                continue
            bound = _nearly(i, j, rows, boxes.vertex, desk)
            if bound <= limit:
                desk.candidates[count], desk.bounds[count] = j, bound
                count += 1
                if not fixed:
                    limit = min(limit, bound * DOUBT + SMALLEST)
    return count, limit


@njit(cache=True, nogil=True)
def _rounded(squared: float) -> float:
    """The lower bound of a divergence that a squared distance of coarse coordinates tells, in spite of rounding."""
    return 0.5 * LN2 * squared * (1 - ROUNDING) - SMALLEST


@njit(cache=True, nogil=True)
def _nearly(i: int, j: int, rows: Rows, vertex: NDArray[np.int64], desk: _Desk) -> float:
    """The fine bound of the distance between places i and j."""
    v, w = vertex[i], vertex[j]
    if desk.held[1] != i:
        _exchange(desk.single, desk.held[1], i, rows, vertex)
        desk.held[1] = i
    filled = rows.indptr[v + 1] > rows.indptr[v]
    return nearly(desk.single, filled, rows.indices, rows.data, rows.indptr[w], rows.indptr[w + 1], rows.total[w])


@njit(cache=True, nogil=True)
def _exact(i: int, j: int, rows: Rows, vertex: NDArray[np.int64], desk: _Desk) -> float:
    """The distance between places i and j."""
    v, w = vertex[i], vertex[j]
    if desk.held[0] != i:
        _exchange(desk.dense, desk.held[0], i, rows, vertex)
        desk.held[0] = i
    filled = rows.indptr[v + 1] > rows.indptr[v]
    return sparse_jsd(desk.dense, filled, rows.indices, rows.data, rows.indptr[w], rows.indptr[w + 1], rows.total[w])


@njit(cache=True, nogil=True)
def _exchange(dense: NDArray[np.floating], before: int, i: int, rows: Rows, vertex: NDArray[np.int64]) -> None:
    """Lays the vector of place i where that of place `before` lies, if one does."""
    if before >= 0:
        for k in range(rows.indptr[vertex[before]], rows.indptr[vertex[before] + 1]):
            dense[rows.indices[k]] = 0.0
    for k in range(rows.indptr[vertex[i]], rows.indptr[vertex[i] + 1]):
        dense[rows.indices[k]] = rows.data[k] / rows.total[vertex[i]]


@njit(cache=True, nogil=True)
def _shorter(d: float, i: int, j: int, best: float, a: int, b: int, vertex: NDArray[np.int64]) -> bool:
    """Whether the edge of places i and j goes before that of a and b, which may be none."""
    if d != best or a < 0:
        return d < best
    low, high = min(vertex[i], vertex[j]), max(vertex[i], vertex[j])
    other = min(vertex[a], vertex[b])
    return low < other or (low == other and high < max(vertex[a], vertex[b]))
