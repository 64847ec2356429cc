"""A shape model as named arrays, and back: the layout of the model file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from service.engine.concepts import concepts_at
from service.engine.dictionary import Dictionary
from service.engine.errors import ModelDamaged
from service.engine.filtration import Filtration
from service.engine.metric import Metric
from service.engine.motifs import Ensemble, Hierarchy, Motif
from service.engine.novelty import NoveltyScale
from service.engine.params import ModelParams
from service.engine.prototypes import Prototypes
from service.engine.space import TopologicalSpace
from service.engine.tensor_kinds import Tensors, check_kinds

if TYPE_CHECKING:
    from service.engine.model import ShapeModel

ROUNDING = 1e-9  # of shares that sum to 1


def to_tensors(model: ShapeModel) -> dict[str, NDArray[Any]]:
    """Names and arrays of everything that was learnt."""
    space, filtration, metric, prototypes = model.space, model.filtration, model.metric, model.prototypes
    tensors: dict[str, NDArray[Any]] = {
        "stimuli.data": model.stimuli.data.astype(np.float32),
        "stimuli.indices": model.stimuli.indices.astype(np.int32),
        "stimuli.indptr": model.stimuli.indptr.astype(np.int64),
        "space.edges": space.edges,
        "space.distance": space.distance,
        "space.geodesic_sum": space.geodesic_sum,
        "space.vertex_heat": space.vertex_heat,
        "filtration.distance": filtration.distance,
        "filtration.time": filtration.time,
        "filtration.order": filtration.order,
        "filtration.annexed": filtration.annexed,
        "filtration.annexing": filtration.annexing,
        "filtration.epsilon_max": np.array([filtration.epsilon_max]),
        "concepts.assignment": model.concepts().assignment,
        "metric.weights": metric.weights,
        "metric.mean": metric.mean,
        "metric.components": metric.components,
        "metric.variance": metric.variance,
        "metric.residual_variance": np.array([metric.residual_variance]),
        "metric.power": np.array([metric.power]),
        "ensemble.prototypes": model.ensemble.prototypes,
        "ensemble.objects": model.ensemble.objects,
        "ensemble.coverage": model.ensemble.coverage,
        "novelty.wholes": model.novelty_scale.wholes,
        "novelty.divergences": model.novelty_scale.divergences,
        "prototypes.cloud_keys": _text(prototypes.cloud_keys),
        "prototypes.cloud_hashes": _text(prototypes.cloud_hashes),
        "prototypes.thumbnails": prototypes.thumbnails,
        "prototypes.map": prototypes.map,
        "notes": _text(model.notes),
    }
    for f, level in enumerate(model.dictionary.levels, start=1):
        tensors[f"dictionary.level_{f}"] = level
    for f, hierarchy in enumerate(model.ensemble.hierarchies, start=1):
        tensors |= {f"hierarchy_{f}.{name}": array for name, array in _of_hierarchy(hierarchy).items()}
    return {name: np.ascontiguousarray(array) for name, array in tensors.items()}


def from_tensors(tensors: Tensors, params: ModelParams) -> dict[str, Any]:
    """The parts of a model with these parameters, by the names of `ShapeModel`'s attributes.

    Raises:
        ModelDamaged: tensors are missing, of the wrong kind, or do not fit together.
    """
    check_kinds(tensors, params)
    try:
        parts = _parts(tensors, params.dictionary.levels)
    except (ValueError, UnicodeDecodeError) as error:
        raise ModelDamaged(f"The model's tensors do not fit together: {error}.") from error
    _check(parts, tensors, params)
    return parts


def _parts(tensors: Tensors, levels: int) -> dict[str, Any]:
    prototypes = tensors["ensemble.prototypes"]
    ensemble = Ensemble(
        tuple(_hierarchy(tensors, f, len(prototypes)) for f in range(1, levels + 1)),
        prototypes,
        tensors["ensemble.objects"],
        tensors["ensemble.coverage"],
    )
    data, indices, indptr = (tensors[f"stimuli.{name}"] for name in ("data", "indices", "indptr"))
    stimuli = _rows(data, indices, indptr, ensemble.vertex_count)
    filtration = {name: tensors[f"filtration.{name}"] for name in ("distance", "time", "order", "annexed", "annexing")}
    metric = {name: tensors[f"metric.{name}"] for name in ("weights", "mean", "components", "variance")}
    return {
        "dictionary": Dictionary(tuple(tensors[f"dictionary.level_{f}"] for f in range(1, levels + 1))),
        "ensemble": ensemble,
        "stimuli": stimuli,
        "space": TopologicalSpace(*(tensors[f"space.{name}"] for name in ("edges", "distance", "geodesic_sum"))),
        "filtration": Filtration(**filtration, epsilon_max=float(tensors["filtration.epsilon_max"][0])),
        "metric": Metric(
            **metric,
            residual_variance=float(tensors["metric.residual_variance"][0]),
            power=float(tensors["metric.power"][0]),
        ),
        "novelty_scale": NoveltyScale(tensors["novelty.wholes"], tensors["novelty.divergences"]),
        "prototypes": Prototypes(
            _lines(tensors["prototypes.cloud_keys"]),
            _lines(tensors["prototypes.cloud_hashes"]),
            tensors["prototypes.thumbnails"],
            tensors["prototypes.map"],
        ),
        "notes": _lines(tensors["notes"]),
    }


def _check(parts: Mapping[str, Any], tensors: Tensors, params: ModelParams) -> None:
    """Refuses numbers that contradict each other.

    Raises:
        ModelDamaged: naming what does not hold.
    """
    ensemble, metric, filtration, space = (parts[name] for name in ("ensemble", "metric", "filtration", "space"))
    scale = parts["novelty_scale"]
    size, vertices = parts["stimuli"].shape
    rules: list[tuple[str, Callable[[], bool]]] = [
        ("there are at least 2 training objects", lambda: size >= 2),
        ("stimuli are positive", lambda: bool((parts["stimuli"].data > 0).all())),
        ("every training object has a heat", lambda: len(space.geodesic_sum) == size),
        ("the tree spans the training objects", lambda: _is_tree(space.edges.T, size)),
        ("edges begin at their smaller end", lambda: bool((space.edges[:, 0] < space.edges[:, 1]).all())),
        ("edges are in order", lambda: _in_order(space.edges)),
        ("distances are not negative", lambda: space.distance.min() >= 0 and filtration.distance.min() >= 0),
        ("heats are mean distances", lambda: np.array_equal(tensors["space.vertex_heat"], space.vertex_heat)),
        ("times are in [0, 1]", lambda: filtration.time.min() >= 0 and filtration.time.max() <= 1),
        ("every annexation has a place", lambda: np.array_equal(np.sort(filtration.order), np.arange(size - 1))),
        ("F spans the training objects", lambda: _is_tree((filtration.annexed, filtration.annexing), size)),
        ("epsilon_max is a time", lambda: 0 <= filtration.epsilon_max <= 1),
        ("concepts are those of F", lambda: _same_concepts(filtration, tensors["concepts.assignment"])),
        ("the metric fits the stimuli", lambda: len(metric.weights) == vertices and len(metric.variance) > 0),
        ("variances are positive", lambda: metric.variance.min() > 0 and metric.residual_variance > 0),
        ("the metric is the parameters'", lambda: float(tensors["metric.power"][0]) == params.response.power),
        ("every motif prototype has an object", lambda: _inside(ensemble.objects, size)),
        ("coverages are shares", lambda: ensemble.coverage.min() > 0 and ensemble.coverage.max() <= 1 + ROUNDING),
        ("every training object has its whole", lambda: _are_wholes(scale.wholes, ensemble)),
        ("divergences ascend", lambda: scale.divergences[0] >= 0 and bool((np.diff(scale.divergences) >= 0).all())),
        ("descriptions are not negative", lambda: ensemble.prototypes.min() >= 0),
        ("motif vertices are unique", lambda: all(len(h.index) == len(h.vertices) for h in ensemble.hierarchies)),
        ("every object has a key", lambda: len(parts["prototypes"].cloud_keys) == size),
        ("every object has a hash", lambda: len(parts["prototypes"].cloud_hashes) == size),
    ]
    for rule, holds in rules:
        if not holds():
            raise ModelDamaged(f"The model's tensors contradict each other: it does not hold that {rule}.")


def _inside(index: NDArray[Any], size: int) -> bool:
    return len(index) == 0 or bool(index.min() >= 0 and index.max() < size)


def _are_wholes(wholes: NDArray[np.int64], ensemble: Ensemble) -> bool:
    """Whether these are motif prototypes, one of each training object in turn."""
    own = np.arange(len(wholes))
    return _inside(wholes, len(ensemble.objects)) and np.array_equal(ensemble.objects[wholes], own)


def _in_order(pairs: NDArray[np.int64]) -> bool:
    """Whether pairs stand in lexicographic order, each once."""
    return bool(np.array_equal(pairs, np.unique(pairs, axis=0)))


def _is_tree(ends: Sequence[NDArray[np.int64]], size: int) -> bool:
    """Whether edges between these ends, one fewer than there are vertices, join them all."""
    a, b = ends
    if len(a) != size - 1 or not _inside(a, size) or not _inside(b, size):
        return False
    graph = csr_array((np.ones(len(a), np.int8), (a, b)), shape=(size, size))
    return bool(connected_components(graph, directed=False)[0] == 1)


def _same_concepts(filtration: Filtration, assignment: NDArray[np.int64]) -> bool:
    return np.array_equal(concepts_at(filtration).assignment, assignment)


def _of_hierarchy(hierarchy: Hierarchy) -> dict[str, NDArray[Any]]:
    words = [motif[1] for motif in hierarchy.vertices]
    return {
        "level": np.array([motif[0] for motif in hierarchy.vertices], dtype=np.int32),
        "words": np.array([word for motif in words for word in motif], dtype=np.int32),
        "words_indptr": np.cumsum([0, *map(len, words)], dtype=np.int64),
        "prototypes_indices": hierarchy.prototypes.indices.astype(np.int64),
        "prototypes_indptr": hierarchy.prototypes.indptr.astype(np.int64),
        "edges": hierarchy.edges,
        "propagations": hierarchy.propagations,
    }


def _hierarchy(tensors: Tensors, f: int, prototypes: int) -> Hierarchy:
    """H_f.

    Raises:
        ValueError: its vertices, words or prototypes are not there.
    """
    level, words, ends, indices, indptr, edges, propagations = (
        tensors[f"hierarchy_{f}.{name}"]
        for name in (
            "level", "words", "words_indptr", "prototypes_indices", "prototypes_indptr", "edges", "propagations",
        )
    )  # fmt: skip
    size = len(level)
    members = _rows(np.ones(len(indices), np.int8), indices, indptr, prototypes)
    if size == 0 or np.diff(indptr).min() < 1:
        raise ValueError(f"a motif vertex of hierarchy {f} has no prototype")
    if ends[0] != 0 or ends[-1] != len(words) or np.diff(ends).min() < 1:
        raise ValueError(f"a motif vertex of hierarchy {f} has no words")
    if level.min() < 1 or not _inside(words, 2**f):
        raise ValueError(f"hierarchy {f} has levels or words out of range")
    for pairs, rise in ((edges, 0), (propagations, 1)):
        if not _inside(pairs, size) or not _in_order(pairs) or (np.diff(level[pairs], axis=1) != rise).any():
            raise ValueError(f"edges or propagations of hierarchy {f} join what they cannot join")
    motifs: tuple[Motif, ...] = tuple(
        (number, tuple(words[a:b].tolist())) for number, (a, b) in zip(level.tolist(), pairwise(ends), strict=True)
    )
    return Hierarchy(motifs, members, edges, propagations)


def _rows(data: NDArray[Any], indices: NDArray[Any], indptr: NDArray[Any], columns: int) -> csr_array:
    """A sparse matrix.

    Raises:
        ValueError: rows are not where they should be, or their columns do not ascend.
    """
    if len(indptr) < 1 or indptr[0] != 0 or indptr[-1] != len(indices) or (np.diff(indptr) < 0).any():
        raise ValueError("the rows of a sparse matrix are not where they should be")
    rows = csr_array((data, indices, indptr), shape=(len(indptr) - 1, columns))
    if not _inside(indices, columns) or not rows.has_canonical_format:
        raise ValueError("the columns of a sparse matrix are out of range or order")
    return rows


def _text(lines: Sequence[str]) -> NDArray[np.uint8]:
    return np.frombuffer("\n".join(lines).encode(), dtype=np.uint8).copy()


def _lines(array: NDArray[np.uint8]) -> tuple[str, ...]:
    return tuple(array.tobytes().decode().split("\n")) if len(array) else ()
