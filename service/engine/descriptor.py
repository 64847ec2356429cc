"""Descriptions of segments and constellations: FPFH, and distributions that see how parts are arranged."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from service.engine.fpfh import sum_fpfh
from service.engine.neighbours import Neighbourhood, neighbourhood
from service.engine.params import DescriptorParams
from service.engine.segments import SegmentGraph
from service.engine.shape_distributions import shape_distributions

CLOSEST = 0.25  # voxels: nearer points weigh no more in FPFH


def describe(
    graph: SegmentGraph, members: NDArray[np.bool_], params: DescriptorParams, near: Neighbourhood | None = None
) -> NDArray[np.float32]:
    """Describes constellations of an object's segments.

    The FPFH of a constellation is the mean over its points. Beside it stand, where `shape_weight` is not 0, five
    histograms over random pairs and triples of its points.

    Args:
        graph: the object's segments.
        members: (C, S): which segments are united in each constellation, at least one.
        params: weights, radius and draws.
        near: what is around each point, within the radius of FPFH at least; None: it is looked for.

    Returns:
        (C, D) float32, each row a distribution that sums to 1; D is 33, or 153 with the shape distributions.
    """
    mean = members @ fpfh_of_segments(graph, fpfh_radius(graph.voxel, params), near)
    mean /= mean.sum(axis=1, keepdims=True)
    if params.shape_weight == 0:
        return mean.astype(np.float32)
    shape = shape_distributions(graph.points, graph.normals, graph.labels, members, params.draws)
    return np.hstack([(1 - params.shape_weight) * mean, params.shape_weight * shape]).astype(np.float32)


def fpfh_radius(voxel: float, params: DescriptorParams) -> float:
    """Of the neighbourhood of FPFH, extents, for voxels of this edge."""
    return max(params.fpfh_radius, 3 * voxel)


def fpfh_of_segments(graph: SegmentGraph, radius: float, near: Neighbourhood | None = None) -> NDArray[np.float64]:
    """The sum of the fast point feature histograms of each segment's points (S, 33).

    Args:
        graph: points, normals and their segments.
        radius: of the neighbourhood, extents.
        near: what is around each point, within the radius at least; None: it is looked for.
    """
    around = near.within(radius) if near else neighbourhood(graph.points, radius, graph.voxel)
    return sum_fpfh(graph.points, graph.normals, graph.labels, around, CLOSEST * graph.voxel)
