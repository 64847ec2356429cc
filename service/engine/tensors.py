"""A shape model as named arrays, and back: the layout of the model file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from service.engine.concepts import Metric
from service.engine.dictionary import Dictionary
from service.engine.errors import ModelDamaged
from service.engine.filtration import Filtration
from service.engine.motifs import Ensemble, Hierarchy, Motif
from service.engine.prototypes import Prototypes
from service.engine.space import TopologicalSpace

if TYPE_CHECKING:
    from service.engine.model import ShapeModel

Tensors = Mapping[str, NDArray[Any]]


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
        "metric.hellinger": np.array([metric.hellinger], dtype=np.uint8),
        "ensemble.prototypes": model.ensemble.prototypes,
        "ensemble.objects": model.ensemble.objects,
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


def from_tensors(tensors: Tensors) -> dict[str, Any]:
    """The parts of a model, by the names of `ShapeModel`'s attributes.

    Raises:
        ModelDamaged: tensors are missing, of the wrong kind, or do not fit together.
    """
    try:
        parts = _parts(tensors)
    except KeyError as missing:
        raise ModelDamaged(f"The model has no tensor {missing}: it is incomplete, or not a shape model.") from missing
    except (ValueError, IndexError, TypeError, UnicodeDecodeError) as error:
        raise ModelDamaged(f"The model's tensors do not fit together: {error}.") from error
    _check(parts, np.asarray(tensors["concepts.assignment"]))
    return parts


def _parts(tensors: Tensors) -> dict[str, Any]:
    levels = sum(name.startswith("dictionary.level_") for name in tensors)
    prototypes = tensors["ensemble.prototypes"]
    ensemble = Ensemble(
        tuple(_hierarchy(tensors, f"hierarchy_{f}.", len(prototypes)) for f in range(1, levels + 1)),
        prototypes,
        tensors["ensemble.objects"],
    )
    data, indices, indptr = (tensors[f"stimuli.{name}"] for name in ("data", "indices", "indptr"))
    stimuli = csr_array((data, indices, indptr), shape=(len(indptr) - 1, ensemble.vertex_count))
    stimuli.check_format(full_check=True)
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
            hellinger=bool(tensors["metric.hellinger"][0]),
        ),
        "prototypes": Prototypes(
            _lines(tensors["prototypes.cloud_keys"]),
            _lines(tensors["prototypes.cloud_hashes"]),
            tensors["prototypes.thumbnails"],
            tensors["prototypes.map"],
        ),
        "notes": _lines(tensors["notes"]),
    }


def _check(parts: Mapping[str, Any], assignment: NDArray[np.int64]) -> None:
    """Refuses arrays whose shapes or indices contradict each other.

    Raises:
        ModelDamaged: naming what does not fit.
    """
    ensemble, metric, filtration, space = (parts[name] for name in ("ensemble", "metric", "filtration", "space"))
    levels = parts["dictionary"].levels
    size, vertices = parts["stimuli"].shape
    kept = len(metric.variance)
    rules: list[tuple[str, Callable[[], bool]]] = [
        ("there are at least 2 training objects", lambda: size >= 2),
        ("there is a dictionary level", lambda: len(levels) >= 1),
        ("level f has 2^f words", lambda: all(len(w) == 2 << f for f, w in enumerate(levels))),
        ("words and prototypes have one dimension", lambda: _widths([*levels, ensemble.prototypes]) == 1),
        ("every prototype has an object", lambda: _within(ensemble.objects, len(ensemble.prototypes), size)),
        ("the tree has N - 1 edges", lambda: space.edges.shape == (size - 1, 2) and _inside(space.edges, size)),
        ("every vertex has a heat", lambda: space.geodesic_sum.shape == (size,)),
        ("every edge has a distance", lambda: space.distance.shape == (size - 1,)),
        ("every edge has a time", lambda: filtration.time.shape == filtration.distance.shape == (size - 1,)),
        ("every edge has a place", lambda: np.array_equal(np.sort(filtration.order), np.arange(size - 1))),
        ("F joins the training objects", lambda: _within(filtration.annexed, size - 1, size)),
        ("F joins the training objects", lambda: _within(filtration.annexing, size - 1, size)),
        ("epsilon_max is a time", lambda: 0 <= filtration.epsilon_max <= 1),
        ("the metric fits the stimuli", lambda: metric.components.shape == (kept, vertices)),
        ("the metric fits the stimuli", lambda: metric.mean.shape == metric.weights.shape == (vertices,)),
        ("variances are positive", lambda: bool((metric.variance > 0).all()) and metric.residual_variance > 0),
        ("every object is a prototype", lambda: len(parts["prototypes"].cloud_keys) == size),
        ("every prototype has a concept or none", lambda: assignment.shape == (size,)),
    ]
    for rule, holds in rules:
        if not holds():
            raise ModelDamaged(f"The model's tensors contradict each other: it does not hold that {rule}.")


def _widths(arrays: Sequence[NDArray[Any]]) -> int:
    return len({array.shape[1:] for array in arrays})


def _inside(index: NDArray[Any], size: int) -> bool:
    return len(index) == 0 or bool(index.min() >= 0 and index.max() < size)


def _within(index: NDArray[Any], length: int, size: int) -> bool:
    return index.shape == (length,) and _inside(index, size)


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


def _hierarchy(tensors: Tensors, prefix: str, prototypes: int) -> Hierarchy:
    level, words, ends = (tensors[prefix + name].tolist() for name in ("level", "words", "words_indptr"))
    motifs: tuple[Motif, ...] = tuple(
        (number, tuple(words[a:b])) for number, (a, b) in zip(level, pairwise(ends), strict=True)
    )
    indices, indptr = tensors[prefix + "prototypes_indices"], tensors[prefix + "prototypes_indptr"]
    members = csr_array((np.ones(len(indices), np.int8), indices, indptr), shape=(len(motifs), prototypes))
    members.check_format(full_check=True)
    if len(motifs) == 0 or np.diff(members.indptr).min() < 1:
        raise ValueError("a motif vertex has no prototype")
    return Hierarchy(motifs, members, tensors[prefix + "edges"], tensors[prefix + "propagations"])


def _text(lines: Sequence[str]) -> NDArray[np.uint8]:
    return np.frombuffer("\n".join(lines).encode(), dtype=np.uint8).copy()


def _lines(array: NDArray[np.uint8]) -> tuple[str, ...]:
    return tuple(array.tobytes().decode().split("\n")) if len(array) else ()
