"""What learning and answering share: a cloud becomes described constellations of segments."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.engine.cloud import PointCloud, VoxelCloud, downsample, normalise
from service.engine.descriptor import describe, fpfh_radius
from service.engine.motifs import Constellations, propagate, segments_and_whole
from service.engine.neighbours import Neighbourhood, neighbourhood
from service.engine.params import ModelParams
from service.engine.patches import extract_patches, normal_radius
from service.engine.segments import BAND, SegmentGraph, merge_patches

OnStage = Callable[[str], None]
"""Called with the name of each stage as it begins; may raise to stop the work."""


def ignore_stage(_: str) -> None:
    """An `OnStage` that does nothing."""


@dataclass(frozen=True)
class Perception:
    """An object as the method sees it.

    Attributes:
        graph: the segment graph g^o.
        constellations: C of them; the first S are the single segments, in the graph's order.
        descriptors: (C, D) float32.
        warnings: what is odd about the cloud, in sentences.
    """

    graph: SegmentGraph
    constellations: Constellations
    descriptors: NDArray[np.float32]
    warnings: tuple[str, ...]

    @property
    def segment_descriptors(self) -> NDArray[np.float32]:
        """(S, D): what visual words are made of."""
        return self.descriptors[: self.graph.count]


def perceive(
    cloud: PointCloud, params: ModelParams, on_stage: OnStage = ignore_stage, *, unions: bool = True
) -> Perception:
    """Segments an object, propagates its segments into constellations and describes these.

    Args:
        cloud: of one object, in the sensor's frame.
        params: of all stages.
        on_stage: called as each stage begins.
        unions: whether unions of segments are looked at; else single segments and the whole alone.

    Raises:
        InvalidCloud: the cloud is not one that can be described; a child says why.
    """
    on_stage("normalise")
    normalised = normalise(cloud, params.cloud)
    voxels = downsample(normalised, params.cloud)

    on_stage("patches")
    near = _surroundings(voxels, params)
    patches = extract_patches(voxels, params.patches, near)

    on_stage("segments")
    graph = merge_patches(patches, params.segments, near)

    on_stage("constellations")
    constellations = (propagate if unions else segments_and_whole)(graph, params.hierarchy)

    on_stage("descriptors")
    descriptors = describe(graph, constellations.members, params.descriptor, near)
    return Perception(graph, constellations, descriptors, normalised.warnings)


def _surroundings(voxels: VoxelCloud, params: ModelParams) -> Neighbourhood:
    """What is around each voxel, as widely as any stage looks: they share one search."""
    reaches = (
        normal_radius(voxels, params.patches),
        BAND * voxels.size,
        fpfh_radius(voxels.size, params.descriptor),
    )
    return neighbourhood(voxels.points, max(reaches), voxels.size)
