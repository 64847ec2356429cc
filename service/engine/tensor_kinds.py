"""Which tensors a model file has, and of which kind each is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from service.engine.errors import ModelDamaged
from service.engine.fpfh import FPFH_BINS
from service.engine.params import ModelParams
from service.engine.shape_distributions import SHAPE_BINS, SHAPES

Tensors = Mapping[str, NDArray[Any]]


class Kind(NamedTuple):
    """What a tensor holds: its type, and for each axis its length, or the name of a length that tensors share."""

    dtype: type
    shape: tuple[str | int, ...]


LAYOUT = {
    "stimuli.data": Kind(np.float32, ("non-zero stimuli",)),
    "stimuli.indices": Kind(np.int32, ("non-zero stimuli",)),
    "stimuli.indptr": Kind(np.int64, ("objects + 1",)),
    "space.edges": Kind(np.int64, ("edges", 2)),
    "space.distance": Kind(np.float64, ("edges",)),
    "space.geodesic_sum": Kind(np.int64, ("objects",)),
    "space.vertex_heat": Kind(np.float64, ("objects",)),
    "filtration.distance": Kind(np.float64, ("edges",)),
    "filtration.time": Kind(np.float64, ("edges",)),
    "filtration.order": Kind(np.int64, ("edges",)),
    "filtration.annexed": Kind(np.int64, ("edges",)),
    "filtration.annexing": Kind(np.int64, ("edges",)),
    "filtration.epsilon_max": Kind(np.float64, (1,)),
    "concepts.assignment": Kind(np.int64, ("objects",)),
    "metric.weights": Kind(np.float32, ("vertices",)),
    "metric.mean": Kind(np.float32, ("vertices",)),
    "metric.components": Kind(np.float32, ("components", "vertices")),
    "metric.variance": Kind(np.float64, ("components",)),
    "metric.residual_variance": Kind(np.float64, (1,)),
    "metric.power": Kind(np.float64, (1,)),
    "ensemble.prototypes": Kind(np.float32, ("motif prototypes", "bins")),
    "ensemble.objects": Kind(np.int64, ("motif prototypes",)),
    "ensemble.coverage": Kind(np.float64, ("motif prototypes",)),
    "novelty.wholes": Kind(np.int64, ("objects",)),
    "novelty.divergences": Kind(np.float32, ("objects",)),
    "prototypes.cloud_keys": Kind(np.uint8, ("letters of keys",)),
    "prototypes.cloud_hashes": Kind(np.uint8, ("letters of hashes",)),
    "prototypes.thumbnails": Kind(np.uint8, ("objects", 48, 48)),
    "prototypes.map": Kind(np.float32, ("objects", 2)),
    "notes": Kind(np.uint8, ("letters of notes",)),
}
"""The tensors of every model. Each level f has those of `of_level` beside."""


def of_level(f: int) -> dict[str, Kind]:
    """The tensors of the dictionary's level f and of the hierarchy over it."""
    return {
        f"dictionary.level_{f}": Kind(np.float32, (2**f, "bins")),
        f"hierarchy_{f}.level": Kind(np.int32, (f"vertices of {f}",)),
        f"hierarchy_{f}.words": Kind(np.int32, (f"words of {f}",)),
        f"hierarchy_{f}.words_indptr": Kind(np.int64, (f"vertices of {f} + 1",)),
        f"hierarchy_{f}.prototypes_indices": Kind(np.int64, (f"memories of {f}",)),
        f"hierarchy_{f}.prototypes_indptr": Kind(np.int64, (f"vertices of {f} + 1",)),
        f"hierarchy_{f}.edges": Kind(np.int64, (f"edges of {f}", 2)),
        f"hierarchy_{f}.propagations": Kind(np.int64, (f"propagations of {f}", 2)),
    }


def check_kinds(tensors: Tensors, params: ModelParams) -> None:
    """Refuses tensors that are missing, of another type or shape than the parameters ask for, or not finite.

    Raises:
        ModelDamaged: naming the tensor.
    """
    bins = 3 * FPFH_BINS + (SHAPES * SHAPE_BINS if params.descriptor.shape_weight else 0)
    lengths: dict[str | int, int] = {"bins": bins}
    levels = range(1, params.dictionary.levels + 1)
    for name, (dtype, shape) in (LAYOUT | {n: k for f in levels for n, k in of_level(f).items()}).items():
        if name not in tensors:
            raise ModelDamaged(f"The model has no tensor '{name}': it is incomplete, or not a shape model.")
        array = np.asarray(tensors[name])
        if array.dtype != dtype or array.ndim != len(shape):
            raise ModelDamaged(
                f"The tensor '{name}' is {array.dtype} of {array.ndim} axes, not {np.dtype(dtype)} of {len(shape)}."
            )
        for axis, length in zip(shape, array.shape, strict=True):
            if length != (axis if isinstance(axis, int) else lengths.setdefault(axis, length)):
                raise ModelDamaged(f"The tensor '{name}' has the shape {array.shape}, which does not fit the others.")
        if name != "metric.residual_variance" and not np.isfinite(array).all():
            raise ModelDamaged(f"The tensor '{name}' holds numbers that are not finite.")
