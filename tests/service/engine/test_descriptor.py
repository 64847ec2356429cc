"""Descriptions: FPFH as its paper has it, and distributions that see arrangement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import open3d as o3d
import pytest
from numpy.typing import NDArray
from scipy.spatial.distance import jensenshannon

from service.engine.descriptor import describe, fpfh_of_segments
from service.engine.fpfh import FPFH_BINS
from service.engine.params import DescriptorParams
from service.engine.segments import SegmentGraph
from service.engine.shape_distributions import SHAPE_BINS
from tests.service.engine.seen import seen
from tests.shapes import ball, box, can, corner_view, cube, lid_view, look, rotation

RADIUS = 0.125
FPFH_ALONE = DescriptorParams(shape_weight=0)
SHAPE_ALONE = DescriptorParams(shape_weight=1)


@pytest.fixture(scope="module")
def graph() -> SegmentGraph:
    return seen(box(0.1, 0.14, 0.2), corner_view(3, 0.9), "kinect").graph


def everything(graph: SegmentGraph) -> NDArray[np.bool_]:
    """The whole object and each of its segments."""
    return np.concatenate([np.ones((1, graph.count), bool), np.eye(graph.count, dtype=bool)])


def whole(graph: SegmentGraph, params: DescriptorParams = DescriptorParams()) -> NDArray[np.float32]:  # noqa: B008
    """The description of the whole object (D,)."""
    return describe(graph, np.ones((1, graph.count), bool), params)[0]


def shapes(graph: SegmentGraph) -> NDArray[np.float32]:
    """The five shape distributions of the whole object (5, 24)."""
    return whole(graph, SHAPE_ALONE)[33:].reshape(5, SHAPE_BINS)


def fpfh(graph: SegmentGraph, radius: float) -> NDArray[np.float64]:
    """The FPFH of each point (M, 33): that of a segment of its own."""
    return fpfh_of_segments(replace(graph, labels=np.arange(len(graph.points))), radius)


def plain_fpfh(points: NDArray[np.float64], normals: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """FPFH word by word (Rusu et al. 2009), every pair for itself."""
    size = len(points)
    simple = np.zeros((size, 33))
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = [[j for j in range(size) if j != i and distance[i, j] <= radius] for i in range(size)]
    for i in range(size):
        for j in near[i]:
            line = (points[j] - points[i]) / distance[i, j]
            s, t = i, j
            if abs(normals[i] @ line) < abs(normals[j] @ line):
                s, t, line = j, i, -line
            u = normals[s]
            v = np.cross(line, u)
            v /= np.linalg.norm(v)
            w = np.cross(u, v)
            angles = [v @ normals[t], u @ line, np.arctan2(w @ normals[t], u @ normals[t]) / np.pi]
            for block, angle in enumerate(angles):
                simple[i, 11 * block + min(int((angle + 1) / 2 * 11), 10)] += 1
        simple[i] /= simple[i].sum()
    out = simple.copy()
    for i in range(size):
        for j in near[i]:
            out[i] += simple[j] / distance[i, j] / len(near[i])
    return out / out.sum(axis=1, keepdims=True)


def plain_shapes(points: NDArray[np.float64], normals: NDArray[np.float64], draws: int) -> NDArray[np.float64]:
    """The shape distributions (5, 24) word by word, every triple for itself."""
    rms = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean())
    out = np.zeros((5, SHAPE_BINS))
    for i, j, k in (np.random.default_rng(0).random((draws, 3)) * len(points)).astype(int):
        if len({i, j, k}) < 3:
            continue
        a, b, n, m = points[j] - points[i], points[k] - points[i], normals[i], normals[j]
        side = np.linalg.norm(a)
        area = np.linalg.norm(np.cross(a, b)) / 2
        values = [
            side / rms / 4,
            np.sqrt(area) / rms / 2,
            np.arccos(a @ b / side / np.linalg.norm(b)) / np.pi,
            np.arccos(np.clip(n @ m, -1, 1)) / np.pi,
            ((m - n) @ a / side / 2 + 1) / 2,
        ]
        for shape, value in enumerate(values):
            place = min(value, 1) * SHAPE_BINS - 0.5  # of the centres of bins, that of the first is 0
            for bin in (int(np.floor(place)), int(np.floor(place)) + 1):
                out[shape, min(max(bin, 0), SHAPE_BINS - 1)] += 1 - abs(place - bin)
    return out / out.sum()


@pytest.fixture(scope="module")
def few(graph: SegmentGraph) -> SegmentGraph:
    """Sixty points whose normals look anywhere."""
    rng = np.random.default_rng(0)
    points = rng.random((60, 3)) * [1, 1, 0.3]
    normals = rng.standard_normal((60, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return replace(graph, points=points, normals=normals, labels=np.zeros(60, int), share=np.ones(1), voxel=1e-6)


def test_fpfh_is_what_its_paper_says(few: SegmentGraph):
    assert np.allclose(fpfh(few, 0.5), plain_fpfh(few.points, few.normals, 0.5), atol=1e-12)


@pytest.mark.parametrize("draws", [100, 2000])
def test_shape_distributions_are_those_of_all_triples_one_by_one(few: SegmentGraph, draws: int):
    told = whole(few, DescriptorParams(shape_weight=1, draws=draws))[33:].reshape(5, SHAPE_BINS)
    assert np.allclose(told, plain_shapes(few.points, few.normals, draws), atol=1e-7)


def test_fpfh_agrees_with_open3d(graph: SegmentGraph):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(graph.points))
    cloud.normals = o3d.utility.Vector3dVector(graph.normals)
    search = o3d.geometry.KDTreeSearchParamHybrid(radius=RADIUS, max_nn=1000)
    theirs = np.asarray(o3d.pipelines.registration.compute_fpfh_feature(cloud, search).data).T.reshape(-1, 3, 11)
    theirs = theirs[:, [1, 2, 0]].reshape(-1, 33)  # theirs: theta, alpha, phi
    ours = fpfh(graph, RADIUS)
    alike = [np.corrcoef(a, b)[0, 1] for a, b in zip(ours, theirs, strict=True)]
    assert np.median(alike) > 0.95
    assert np.corrcoef(ours.mean(axis=0), theirs.mean(axis=0))[0, 1] > 0.99


def test_each_angle_of_fpfh_has_a_third(graph: SegmentGraph):
    blocks = fpfh(graph, RADIUS).reshape(-1, 3, FPFH_BINS)
    assert np.allclose(blocks.sum(axis=2), 1 / 3)


@pytest.mark.parametrize(("params", "width"), [(FPFH_ALONE, 33), (DescriptorParams(), 33 + 5 * SHAPE_BINS)])
def test_descriptions_are_distributions(graph: SegmentGraph, params: DescriptorParams, width: int):
    rows = describe(graph, everything(graph), params)
    assert rows.dtype == np.float32
    assert rows.shape == (1 + graph.count, width)
    assert (rows >= 0).all()
    assert np.allclose(rows.sum(axis=1), 1, atol=1e-5)


def test_the_weights_are_those_of_the_parameters(graph: SegmentGraph):
    alone = describe(graph, everything(graph), FPFH_ALONE)
    beside = describe(graph, everything(graph), DescriptorParams(shape_weight=0.6))
    assert np.allclose(beside[:, :33], 0.4 * alone, atol=1e-6)
    assert np.allclose(beside[:, 33:].reshape(-1, 5, SHAPE_BINS).sum(axis=2), 0.6 / 5, atol=1e-3)


def test_the_fpfh_of_a_constellation_is_the_mean_over_its_points(graph: SegmentGraph):
    members = np.array([[1, 1, 0], [0, 1, 1], [1, 1, 1]], dtype=bool)
    single = describe(graph, np.eye(3, dtype=bool), FPFH_ALONE)
    weight = members * np.bincount(graph.labels)
    assert np.allclose(describe(graph, members, FPFH_ALONE), weight @ single / weight.sum(axis=1)[:, None], atol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_turning_and_moving_an_object_leaves_its_description(graph: SegmentGraph, seed: int):
    turn = rotation(seed)
    turned = replace(graph, points=graph.points @ turn.T + [0.3, -0.1, 2.0], normals=graph.normals @ turn.T)
    a, b = (describe(g, everything(graph), DescriptorParams()) for g in (graph, turned))
    assert np.abs(a - b).max() < 1e-3  # a vote on the border of two bins may change its side
    assert np.abs(a - b).sum(axis=1).max() < 5e-3


def test_the_distributions_see_the_arrangement_that_fpfh_does_not(graph: SegmentGraph):
    last = (graph.labels == 2)[:, None]
    near, far = (replace(graph, points=np.where(last, graph.points + off, graph.points)) for off in (2.0, 4.0))
    alone, beside = ([whole(g, p) for g in (near, far)] for p in (FPFH_ALONE, SHAPE_ALONE))
    assert np.allclose(*alone)
    assert jensenshannon(*beside) > 0.01


def test_bulges_and_hollows_mirror_each_other():
    here = seen(ball(0.07), look(0, 30, 0.9)).graph
    bulge, dent = shapes(here)[4], shapes(replace(here, normals=-here.normals))[4]
    assert bulge[SHAPE_BINS // 2 :].sum() > 0.95 * bulge.sum()
    assert np.allclose(bulge, dent[::-1], atol=1e-6)


def test_a_plane_has_one_normal_and_no_convexity():
    shape = shapes(seen(cube(0.15), look(0, 0, 0.9)).graph)
    assert shape[3, 0] > 0.99 * shape[3].sum()
    assert shape[4, SHAPE_BINS // 2 - 1 : SHAPE_BINS // 2 + 1].sum() > 0.99 * shape[4].sum()
    assert shape[0].sum() == pytest.approx(shape[2].sum(), rel=1e-4)


def test_boxes_are_like_boxes_and_unlike_cans():
    def whole(graph: SegmentGraph) -> NDArray[np.float32]:
        return describe(graph, np.ones((1, graph.count), bool), DescriptorParams())[0]

    boxes = [
        whole(seen(cube(edge), corner_view(s, 0.9), "kinect", s).graph) for s, edge in enumerate((0.08, 0.12, 0.2))
    ]
    cans = [whole(seen(can(r, 2.5 * r), lid_view(s, 0.9), "kinect", s).graph) for s, r in enumerate((0.04, 0.05, 0.08))]
    within = [jensenshannon(a, b) for group in (boxes, cans) for i, a in enumerate(group) for b in group[:i]]
    between = [jensenshannon(a, b) for a in boxes for b in cans]
    assert max(within) < min(between)


def test_describing_draws_no_random_number_twice_differently(graph: SegmentGraph):
    state = np.random.get_state()[1].copy()  # noqa: NPY002
    first, second = (describe(graph, everything(graph), DescriptorParams()) for _ in range(2))
    assert np.array_equal(first, second)
    assert np.array_equal(state, np.random.get_state()[1])  # noqa: NPY002
