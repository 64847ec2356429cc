"""Descriptors of whole clouds that need no learning: what responses must beat to be worth having.

They are a fixed yardstick: their parameters stand here, and do not follow those of the model that is judged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from service.engine.cloud import PointCloud, downsample, normalise
from service.engine.descriptor import describe
from service.engine.fpfh import FPFH_BINS
from service.engine.params import CloudParams, DescriptorParams
from service.engine.patches import estimate_normals
from service.engine.segments import SegmentGraph
from worker.evaluation.esf import ensemble_of_shape_functions

VOXEL = 1 / 32  # edge, share of the object's extent
NORMAL_RADIUS = 0.1  # neighbourhood of a normal, share of the extent
DESCRIPTOR = DescriptorParams(fpfh_radius=0.125, shape_weight=0.7, draws=2000)

DESCRIPTIONS = {
    "mean FPFH": "mean fast point feature histogram of the whole cloud (Rusu et al. 2009)",
    "shape distributions": "0.3 x mean FPFH beside 0.7 x five distributions over random pairs and triples of the whole "
    "cloud's points (after Osada et al. 2002): the best single histogram that is known here",
    "ESF": "ensemble of shape functions of the whole cloud (Wohlkinger and Vincze 2011), of our own making",
}


def see_whole(cloud: PointCloud, limits: CloudParams) -> SegmentGraph:
    """The whole cloud as one segment, with the normals and at the fineness that all baselines see.

    Args:
        cloud: of one object.
        limits: which clouds are answered; how finely they are looked at is not taken from there.

    Raises:
        InvalidCloud: the cloud cannot be described; a child says why.
    """
    params = CloudParams(
        voxel=VOXEL, min_points=limits.min_points, min_extent=limits.min_extent, max_extent=limits.max_extent
    )
    voxels = downsample(normalise(cloud, params), params)
    return SegmentGraph(
        points=voxels.points,
        normals=estimate_normals(voxels, max(NORMAL_RADIUS, 2 * voxels.size)),
        labels=np.zeros(len(voxels.points), np.int64),
        share=np.ones(1),
        edges=np.zeros((0, 2), np.int64),
        voxel=voxels.size,
        frame=voxels.frame,
    )


def describe_whole(whole: SegmentGraph) -> dict[str, NDArray[np.float64]]:
    """The baselines' vectors of a cloud, in the order of `DESCRIPTIONS`."""
    shape = describe(whole, np.ones((1, 1), bool), DESCRIPTOR)[0].astype(np.float64)
    fpfh = shape[: 3 * FPFH_BINS]
    vectors = (fpfh / fpfh.sum(), shape, ensemble_of_shape_functions(whole.points))
    return dict(zip(DESCRIPTIONS, vectors, strict=True))
