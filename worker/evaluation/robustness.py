"""Disturbances of clouds, as they befall real ones, and what becomes of the best concept.

Every draw follows from the cloud's content, and is the same at all strengths of a disturbance: more of it only adds to
less of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from service.engine.cloud import PointCloud
from service.engine.segments import SegmentGraph
from worker.evaluation.report import Curve, Robustness, Strength
from worker.simulation.params import SensorParams
from worker.simulation.sensor import axial_sigma

GRAZING = np.radians(SensorParams().grazing)  # beyond, a sensor returns nothing
REFUSED = -1  # stands for a best concept where there is none

Apply = Callable[[PointCloud, SegmentGraph, float, np.random.Generator], PointCloud]


@dataclass(frozen=True)
class Disturbance:
    """Something that befalls a cloud.

    Attributes:
        name: short.
        description: what is done to the cloud.
        unit: of the strength; empty for a plain factor.
        neutral: the strength that leaves a cloud as it is.
        strengths: at which clouds are answered.
        apply: does it.
    """

    name: str
    description: str
    unit: str
    neutral: float
    strengths: tuple[float, ...]
    apply: Apply


def rescale(cloud: PointCloud, whole: SegmentGraph, factor: float, rng: np.random.Generator) -> PointCloud:
    """An object `factor` times as large, as many times as far away."""
    return PointCloud((cloud.points * np.float32(factor)).astype(np.float32))


def thin(cloud: PointCloud, whole: SegmentGraph, factor: float, rng: np.random.Generator) -> PointCloud:
    """One of `factor` points, drawn at random."""
    kept = rng.permutation(len(cloud.points))[: round(len(cloud.points) / factor)]
    return PointCloud(cloud.points[np.sort(kept)])


def blur(cloud: PointCloud, whole: SegmentGraph, factor: float, rng: np.random.Generator) -> PointCloud:
    """Noise along the line of sight, `factor` times what the cloud already has, which is taken for the sensor's own.

    Variances add up: a cloud with the deviation s has f s after sqrt(f^2 - 1) s more.
    """
    points = cloud.points.astype(np.float64)
    depth = np.maximum(np.abs(points[:, 2]), 1e-3)
    deviation = axial_sigma(depth, np.minimum(_angles(points, whole), GRAZING))
    more = np.sqrt(factor**2 - 1)
    read = 1 + more * deviation * rng.standard_normal(len(points)) / depth
    return PointCloud((points * read[:, None]).astype(np.float32))


def hide(cloud: PointCloud, whole: SegmentGraph, share: float, rng: np.random.Generator) -> PointCloud:
    """A share of the points hidden by a straight edge in front of them, which comes in from a random side."""
    azimuth = rng.uniform(0, 2 * np.pi)
    depth = np.where(np.abs(cloud.points[:, 2]) > 1e-6, cloud.points[:, 2], np.float32(1e-6))
    image = cloud.points[:, :2] / depth[:, None]
    order = np.argsort(image @ np.array([np.cos(azimuth), np.sin(azimuth)]), kind="stable")
    return PointCloud(cloud.points[np.sort(order[: round(len(order) * (1 - share))])])


def _angles(points: NDArray[np.float64], whole: SegmentGraph) -> NDArray[np.float64]:
    """Between each point's line of sight and the normal of the surface about it, radians (N,)."""
    near = cKDTree(whole.frame.to_sensor(whole.points)).query(points)[1]
    normals = whole.normals[near] @ whole.frame.axes.T
    cosine = np.abs(np.einsum("ij,ij->i", normals, points)) / np.maximum(np.linalg.norm(points, axis=1), 1e-12)
    return np.arccos(np.minimum(cosine, 1.0))


DISTURBANCES = (
    Disturbance(
        "rescaled", "the object is as many times as large, and as far away", "", 1, (0.3, 0.5, 0.75, 1.5, 2, 3), rescale
    ),
    Disturbance("thinned", "one of so many points is left, drawn at random", "", 1, (2, 3, 5, 10), thin),
    Disturbance(
        "noisier",
        "noise is added along the line of sight until there is as many times as much as a Kinect has at that distance "
        "and angle (Nguyen et al. 2012)",
        "",
        1,
        (1.25, 1.5, 2),
        blur,
    ),
    Disturbance(
        "hidden",
        "so much of the points is hidden by a straight edge, from a random side of the image",
        "share",
        0,
        (0.1, 0.2, 0.3),
        hide,
    ),
)


def disturbed(cloud: PointCloud, whole: SegmentGraph, digest: str) -> list[PointCloud]:
    """The cloud under each strength of each disturbance, in the order of `DISTURBANCES`.

    Args:
        cloud: undisturbed.
        whole: the cloud and its normals.
        digest: of the cloud's content, hexadecimal: what all draws follow from.
    """
    return [
        kind.apply(cloud, whole, strength, np.random.default_rng([int(digest, 16), place]))
        for place, kind in enumerate(DISTURBANCES)
        for strength in kind.strengths
    ]


def curves(best: NDArray[np.int64], under: Sequence[NDArray[np.int64]]) -> Robustness:
    """What becomes of the best concepts.

    Args:
        best: (n,) ids of the undisturbed clouds' best concepts.
        under: for each cloud (S,), the ids under what `disturbed` gives, `REFUSED` where there is none.
    """
    ids = np.stack(under)
    rows, column = [], 0
    for kind in DISTURBANCES:
        strengths = [Strength(strength=kind.neutral, kept=1.0, in_use=len(np.unique(best)), refused=0)]
        for strength in kind.strengths:
            strengths.append(_strength(strength, best, ids[:, column]))
            column += 1
        rows.append(
            Curve(
                name=kind.name,
                description=kind.description,
                unit=kind.unit,
                strengths=sorted(strengths, key=lambda each: each.strength),
            )
        )
    return Robustness(clouds=len(best), in_use=len(np.unique(best)), curves=rows)


def _strength(strength: float, best: NDArray[np.int64], found: NDArray[np.int64]) -> Strength:
    answered = found != REFUSED
    return Strength(
        strength=strength,
        kept=float(np.mean(found == best)),
        in_use=len(np.unique(found[answered])),
        refused=int((~answered).sum()),
    )
