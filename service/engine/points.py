"""Which segment each point of a cloud is part of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from service.engine.segments import SegmentGraph

ROUNDING = 0.01  # voxels by which a point may lie outside its voxel, as points are snapped to a lattice
CHUNK = 65_536  # points that are looked up at a time: bounds the memory


def segments_of_points(cloud: PointCloud, graph: SegmentGraph) -> NDArray[np.int32]:
    """The segment of each point that a file held (M,), or of each point of a cloud that is of no file (N,).

    -1 stands for points that are part of none: those not measured, strays and scattered returns. A point belongs to
    the segment of the voxel in which it was averaged. As it is found by its place alone, neither the order nor the
    number of points matters.

    Args:
        cloud: in which the segments were seen.
        graph: the segments.
    """
    from scipy.spatial import cKDTree  # a tenth of a second, which answers without points do not need

    centres = (np.floor(graph.points / graph.voxel) + 0.5) * graph.voxel
    tree = cKDTree(centres)
    labels = np.append(graph.labels, -1).astype(np.int32)  # the tree says M for what is out of reach
    out = np.full(len(cloud.points), -1, np.int32)
    reach = (0.5 + ROUNDING) * graph.voxel
    for start in range(0, len(out), CHUNK):
        points = cloud.points[start : start + CHUNK].astype(np.float64)
        finite = np.flatnonzero(np.isfinite(points).all(axis=1))
        own = (points[finite] - graph.frame.centre) @ graph.frame.axes / graph.frame.extent
        out[start + finite] = labels[tree.query(own, p=np.inf, distance_upper_bound=reach)[1]]
    if cloud.measured is None:
        return out
    of_file = np.full(len(cloud.measured), -1, np.int32)
    of_file[cloud.measured] = out
    return of_file
