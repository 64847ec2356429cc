"""Objects as the engine sees them, stage by stage, and what is true of them."""

from __future__ import annotations

from typing import NamedTuple

from service.engine.cloud import VoxelCloud, downsample, normalise
from service.engine.params import ModelParams
from service.engine.patches import Patches, extract_patches
from service.engine.segments import SegmentGraph, merge_patches
from tests.shapes import Truth, see, truth
from worker.simulation.camera import View
from worker.simulation.compositions import Composition

PARAMS = ModelParams()


class Seen(NamedTuple):
    """A solid as the first stages see it."""

    voxels: VoxelCloud
    patches: Patches
    graph: SegmentGraph
    truth: Truth


def seen(composition: Composition, view: View, noise: str = "none", seed: int = 0) -> Seen:
    """A solid seen from a view, with "kinect" noise or "none"."""
    observation = see(composition, view, noise, seed)
    voxels = downsample(normalise(observation.cloud, PARAMS.cloud), PARAMS.cloud)
    patches = extract_patches(voxels, PARAMS.patches)
    true = truth(voxels.points, voxels.frame, observation, composition, view)
    return Seen(voxels, patches, merge_patches(patches, PARAMS.segments), true)
