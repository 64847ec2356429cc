"""A whole scene becomes a supporting plane and the objects that stand on it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.engine.cloud import PointCloud
from service.engine.errors import NoSupportingPlane, TooFewPoints
from service.tabletop.adjacency import BESIDE_VOXELS, hides, near, sights_of
from service.tabletop.image import Image
from service.tabletop.layers import BELOW, BESIDE, HIGH, OVER, PLANE, layer
from service.tabletop.pieces import connect, judge, stand_box
from service.tabletop.planes import find_planes
from service.tabletop.records import REASONS, LeftOut, Plane, Scene, SceneObject, TabletopParams
from service.tabletop.voxels import Voxels, voxelise

IN_PLANE = "The sensor would stand in the plane itself: state the viewpoint from which the scene was seen."
BEHIND = "Nothing stands on the sensor's side of the plane, but something lies beyond it: check the viewpoint."
BEHIND_SHARE = 0.05  # of the scene's points that make it worth a word


class Found(NamedTuple):
    """The objects on a plane, as voxels.

    Attributes:
        plane: that bears them.
        layers: (V,) where each voxel lies about it.
        objects: rows of each object's voxels, nearest to the sensor first.
        refused: reason, and rows of voxels, of each piece that is no object.
    """

    plane: Plane
    layers: NDArray[np.str_]
    objects: list[NDArray[np.int64]]
    refused: list[tuple[str, NDArray[np.int64]]]


def find_objects(
    cloud: PointCloud, params: TabletopParams | None = None, *, width: int | None = None, most: int | None = None
) -> Scene:
    """Finds the largest plane that something stands on, and what stands on it.

    Points in another order give the same objects, to the bit.

    Args:
        cloud: of the whole scene, in the sensor's frame.
        params: what is taken for a table and for an object.
        width: pixels in a row of the image that the cloud is; None if it is none.
        most: how many objects are kept, the nearest ones; None for all.

    Raises:
        TooFewPoints: there are fewer than an object has.
        NoSupportingPlane: no plane is large enough.
    """
    params = params or TabletopParams()
    voxels = voxelise(cloud.points, params)
    if len(voxels.rows) < params.min_points:
        raise TooFewPoints(
            f"The scene has {len(voxels.rows)} points within {params.reach:g} m of the sensor; at least "
            f"{params.min_points} are needed. Check the unit of its coordinates and the viewpoint."
        )
    found = _find(voxels, params)
    kept, beyond = found.objects[:most], found.objects[len(found.objects) if most is None else most :]
    refused = found.refused + [("many", rows) for rows in beyond]
    inliers = int(voxels.counts[found.layers == PLANE].sum())
    return Scene(
        plane=found.plane,
        inliers=inliers,
        objects=_describe(cloud, voxels, found, kept, Image.of(cloud, width), params),
        left_out=_left_out(voxels, found.layers, refused, len(cloud.points) - len(voxels.rows)),
        warnings=_warnings(voxels, found),
    )


def _find(voxels: Voxels, params: TabletopParams) -> Found:
    """What stands on the largest plane that bears something; on the largest of all, if none does."""
    bare = None
    for plane in find_planes(voxels.points, voxels.size, params):
        layers = layer(voxels, plane, params)
        if layers is None:
            continue
        found = _stand(voxels, plane, layers, params)
        if found.objects:
            return found
        bare = bare or found
    if bare is None:
        raise NoSupportingPlane(
            "There is no plane in the scene that could bear objects: none holds "
            f"{params.min_plane:.0%} of it and is {params.min_width:g} m wide. Send the cloud of a lone object without "
            "scene=true, or a view that shows more of the table."
        )
    return bare


def _stand(voxels: Voxels, plane: Plane, layers: NDArray[np.str_], params: TabletopParams) -> Found:
    over = np.flatnonzero(layers == OVER)
    points, counts = voxels.points[over], voxels.counts[over]
    ground = cKDTree(voxels.points[layers == PLANE] @ plane.basis.T)
    objects, refused = [], []
    for rows in connect(points, _gap(voxels, params)):
        few = counts[rows].sum() < params.min_points
        reason = "small" if few else judge(points[rows], ground, plane, params)
        if reason:
            refused.append((reason, over[rows]))
        else:
            objects.append(over[rows])
    objects.sort(key=lambda rows: float(np.linalg.norm(voxels.points[rows].mean(axis=0))))
    return Found(plane, layers, objects, refused)


def _gap(voxels: Voxels, params: TabletopParams) -> float:
    """Metres between pieces that are not one: two voxels at least, or the grid itself would tear them apart."""
    return max(params.gap, 2 * voxels.size)


def _describe(
    cloud: PointCloud,
    voxels: Voxels,
    found: Found,
    objects: list[NDArray[np.int64]],
    image: Image | None,
    params: TabletopParams,
) -> tuple[SceneObject, ...]:
    number = np.full(len(voxels.points), -1)
    for i, rows in enumerate(objects):
        number[rows] = i
    of_row = number[voxels.of_row]
    order = np.argsort(of_row, kind="stable")
    starts = np.searchsorted(of_row[order], np.arange(len(objects) + 1))
    gap = _gap(voxels, params)
    trees = [cKDTree(voxels.points[rows]) for rows in objects]
    sights = [sights_of(voxels.points[rows]) for rows in objects]
    aside = np.isin(found.layers, (BESIDE, HIGH))
    outside = cKDTree(voxels.points[aside]) if aside.any() else None
    described = []
    for i, rows in enumerate(objects):
        indices = voxels.rows[order[starts[i] : starts[i + 1]]]
        points = cloud.points[indices].astype(np.float64)
        heights = found.plane.heights(points)
        described.append(
            SceneObject(
                indices=indices,
                centroid=voxels.points[rows].mean(axis=0),
                box=stand_box(points[np.lexsort(points.T)], found.plane),
                height=np.array([heights.min(), heights.max()]),
                touches=tuple(j for j, tree in enumerate(trees) if j != i and near(tree, trees[i], 2 * gap)),
                hidden_by=tuple(
                    j
                    for j, other in enumerate(sights)
                    if j != i and hides(other, sights[i], BESIDE_VOXELS * voxels.size, gap)
                ),
                at_border=None if image is None else image.at_border(indices),
                beyond_edge=outside is not None and near(outside, trees[i], gap),
            )
        )
    return tuple(described)


def _warnings(voxels: Voxels, found: Found) -> tuple[str, ...]:
    if found.plane.offset <= 2 * found.plane.band:
        return (IN_PLANE,)
    behind = voxels.counts[found.layers == BELOW].sum()
    return (BEHIND,) if not found.objects and behind > BEHIND_SHARE * len(voxels.rows) else ()


def _left_out(
    voxels: Voxels, layers: NDArray[np.str_], refused: list[tuple[str, NDArray[np.int64]]], far: int
) -> tuple[LeftOut, ...]:
    points = dict.fromkeys(REASONS, 0) | {"far": far}
    pieces = dict.fromkeys(REASONS, 0)
    for reason in (BELOW, HIGH, BESIDE):
        points[reason] = int(voxels.counts[layers == reason].sum())
    for reason, rows in refused:
        points[reason] += int(voxels.counts[rows].sum())
        pieces[reason] += 1
    return tuple(LeftOut(reason, points[reason], pieces[reason]) for reason in REASONS if points[reason])
