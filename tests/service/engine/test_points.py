"""The segment of each point, as somebody who colours the cloud by it would check."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from service.engine.cloud import PointCloud
from service.engine.params import ModelParams
from service.engine.perception import perceive
from service.engine.points import segments_of_points
from service.engine.segments import SegmentGraph
from tests.learnt import objects
from tests.shapes import box, can, cloud_of, corner_view, lid_view, see

SOLIDS = {
    "a box": (box(0.1, 0.15, 0.22), corner_view(0, 0.9)),
    "a can": (can(0.05, 0.14), lid_view(1, 0.9)),
}
solids = pytest.mark.parametrize("solid", SOLIDS)


def segmented(cloud: PointCloud) -> tuple[SegmentGraph, NDArray[np.int32]]:
    graph = perceive(cloud, ModelParams()).graph
    return graph, segments_of_points(cloud, graph)


@solids
@pytest.mark.parametrize("noise", ["none", "kinect"])
def test_the_points_of_a_face_have_its_segment(solid: str, noise: str):
    observation = see(*SOLIDS[solid], noise)
    graph, labels = segmented(observation.cloud)
    faces = np.unique(observation.faces)
    assert graph.count == len(faces)
    most = {np.bincount(labels[observation.faces == face] + 1).argmax() - 1 for face in faces}
    assert most == set(range(graph.count))
    for face in faces:
        of_face = labels[observation.faces == face]
        assert np.mean(of_face == np.bincount(of_face + 1).argmax() - 1) > 0.85


def test_every_segment_has_about_its_share_of_the_points():
    for simulated in objects(6, 11, "none"):
        graph, labels = segmented(simulated.cloud)
        assert labels.dtype == np.int32
        assert len(labels) == len(simulated.cloud.points)
        assert np.mean(labels >= 0) > 0.97
        share = np.bincount(labels[labels >= 0], minlength=graph.count) / len(labels)
        assert (share > 0).all()
        assert np.abs(share - graph.share).max() < 0.25  # points lie denser where the surface faces the sensor


def test_the_segment_of_a_point_does_not_depend_on_the_order():
    cloud = objects(6, 11)[2].cloud
    order = np.random.default_rng(0).permutation(len(cloud.points))
    assert np.array_equal(segmented(PointCloud(cloud.points[order]))[1], segmented(cloud)[1][order])


def test_a_voxels_points_have_one_segment():
    cloud = objects(6, 11)[3].cloud
    graph, labels = segmented(cloud)
    own = (cloud.points - graph.frame.centre) @ graph.frame.axes / graph.frame.extent / graph.voxel
    inside = (np.abs(own - np.rint(own)) > 0.02).all(
        axis=1
    )  # as points are snapped, those at a border may be in either
    _, voxel = np.unique(np.floor(own[inside]).astype(int), axis=0, return_inverse=True)
    for v in range(voxel.max() + 1):
        assert len(set(labels[inside][voxel == v])) == 1


def test_strays_and_scattered_returns_are_part_of_no_segment():
    points = see(*SOLIDS["a box"]).cloud.points.astype(np.float64)
    scattered = points.mean(axis=0) + np.array([[0.5, 0, 0], [0, 0.14, -0.12], [0, 0, 30]])
    _, labels = segmented(cloud_of(np.concatenate([scattered, points])))
    assert (labels[:3] == -1).all()
    assert (labels[3:] >= 0).mean() > 0.99


def test_points_that_were_not_measured_stand_in_their_places_as_part_of_none():
    cloud = objects(6, 11)[0].cloud
    measured = np.zeros(2 * len(cloud.points) + 5, bool)
    measured[5::2] = True
    _, labels = segmented(PointCloud(cloud.points, measured))
    assert (labels[~measured] == -1).all()
    assert np.array_equal(labels[measured], segmented(cloud)[1])


def test_points_of_a_cloud_that_are_not_finite_are_part_of_none():
    cloud = objects(6, 11)[0].cloud
    points = np.insert(cloud.points, [0, 7], np.float32([[np.nan, 0, 0], [0, np.inf, 0]]), axis=0)
    _, labels = segmented(PointCloud(points))
    assert labels[0] == labels[8] == -1
    assert np.array_equal(np.delete(labels, [0, 8]), segmented(cloud)[1])
