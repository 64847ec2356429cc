"""Descriptors of whole clouds: what they do not depend on, and that they are as strong as they are known to be."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from service import clouds
from service.engine.cloud import PointCloud
from service.engine.errors import TooFewPoints
from service.engine.params import CloudParams
from tests.learnt import objects
from tests.shapes import about_optical_axis, cloud_of
from worker.evaluation.baselines import DESCRIPTIONS, describe_whole, see_whole
from worker.evaluation.labels import judged, read_labels
from worker.evaluation.measures import balanced_accuracy
from worker.evaluation.protocols import Samples, nearest_neighbour, support_vectors


def described(cloud: PointCloud, limits: CloudParams | None = None) -> dict[str, NDArray[np.float64]]:
    return describe_whole(see_whole(cloud, limits or CloudParams()))


@cache
def some() -> tuple[PointCloud, ...]:
    return tuple(simulated.cloud for simulated in objects()[:4])


def apart(first: dict[str, NDArray[np.float64]], second: dict[str, NDArray[np.float64]], name: str) -> float:
    return float(np.abs(first[name] - second[name]).sum())


def test_each_vector_is_a_distribution_of_its_length() -> None:
    vectors = described(some()[0])
    assert {name: len(vector) for name, vector in vectors.items()} == dict(
        zip(DESCRIPTIONS, (33, 153, 640), strict=True)
    )
    for vector in vectors.values():
        assert vector.sum() == pytest.approx(1, abs=1e-5)
        assert vector.min() >= 0


@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_order_size_and_attitude_matter_less_than_the_object(name: str) -> None:
    cloud, other = some()[:2]
    vectors, different = described(cloud), described(other)
    order = np.random.default_rng(0).permutation(len(cloud.points))
    changed = (
        cloud_of(cloud.points[order]),
        cloud_of(cloud.points * 2.5),
        cloud_of(cloud.points @ about_optical_axis(50).T),
    )
    assert described(changed[0])[name] == pytest.approx(vectors[name], abs=1e-12)
    for each in changed:
        assert apart(described(each), vectors, name) < 0.25 * apart(different, vectors, name)


def test_how_finely_the_model_looks_does_not_matter() -> None:
    coarse = described(some()[0], CloudParams(voxel=1 / 12, max_voxels=500))
    assert all((coarse[name] == vector).all() for name, vector in described(some()[0]).items())


def test_what_the_model_refuses_is_refused() -> None:
    with pytest.raises(TooFewPoints):
        described(some()[0], CloudParams(min_points=10**7))


@pytest.mark.data
@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "known"),
    [
        ("scans", {"mean FPFH": (0.82, 0.79), "shape distributions": (0.93, 0.86), "ESF": (0.85, 0.87)}),
        ("rendered", {"shape distributions": (0.67, 0.67), "ESF": (0.62, 0.68)}),
    ],
)
def test_baselines_are_no_weaker_than_others_measured_them(
    scans: Path, folder: str, known: dict[str, tuple[float, float]]
) -> None:
    """The nearest neighbour's and the machine's mean recall; ESF's are those of the Point Cloud Library."""
    table = scans / folder / "labels.csv"
    labelled = read_labels(table)
    kept = [labelled[place] for place in judged(labelled)]
    vectors = [described(clouds.read(row.path.read_bytes(), name=row.file)) for row in kept]
    labels, groups = np.array([row.category for row in kept]), np.array([row.group for row in kept])
    for name, (knn, svm) in known.items():
        samples = Samples(np.stack([each[name] for each in vectors]), labels, groups)
        machines = [balanced_accuracy(labels, predicted) for predicted in support_vectors(samples)]
        assert balanced_accuracy(labels, nearest_neighbour(samples)) > knn - 0.02
        assert np.mean(machines) > svm - 0.02
