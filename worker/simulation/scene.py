"""Renders compositions with SAPIEN. `python -m worker.simulation.scene` says whether it can, by its exit code."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from functools import lru_cache
from threading import Lock
from typing import Any

import numpy as np

from service.engine.errors import RendererUnavailable
from worker.simulation.camera import DepthImage, View, window_of
from worker.simulation.compositions import Composition, Prototype
from worker.simulation.params import CameraParams

NEAR, FAR = 0.01, 100.0  # metres
CANNOT_RENDER = 69  # exit code of the trial: EX_UNAVAILABLE
_ONE_AT_A_TIME = Lock()  # the scene is shared by the threads of a process
REMEDY = (
    "Install a Vulkan driver: `mesa-vulkan-drivers` 24.3 or newer and `libvulkan1` render on the CPU "
    "(Debian 12: from bookworm-backports), or choose the renderer `raycast`."
)


def render(composition: Composition, view: View, params: CameraParams, chord: float) -> DepthImage:
    """The depth image of a composition.

    Args:
        composition: what is seen.
        view: from where.
        params: the camera.
        chord: largest distance from a mesh to the round surface it stands for, metres.

    Raises:
        RendererUnavailable: SAPIEN is not installed or finds no rendering device.
    """
    with _ONE_AT_A_TIME:
        return _scene(params).render(composition, view, chord)


@lru_cache(maxsize=1)
def unavailable() -> str | None:
    """Why SAPIEN cannot render here, or None where it can.

    It is tried in a process of its own, because a broken Vulkan driver may end the process that loads it.
    """
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-m", __name__]
    trial = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if trial.returncode == 0:
        return None
    said = (trial.stderr.strip().splitlines() or ["no word"])[-1]
    if trial.returncode == CANNOT_RENDER:
        return said
    return f"SAPIEN cannot render here: its trial ended with code {trial.returncode} ({said}). {REMEDY}"


class _Scene:
    """One SAPIEN scene and camera, used for every composition of a process: building them costs half a second."""

    def __init__(self, params: CameraParams) -> None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that it looks for a Vulkan library: whether it renders is told below
                import sapien
                import sapien.render
        except ImportError as error:
            raise RendererUnavailable(f"SAPIEN cannot be loaded ({error}). Install it, or choose `raycast`.") from error
        self.sapien: Any = sapien
        self.params = params
        sapien.render.set_log_level("error")
        sapien.render.set_camera_shader_dir("trivial")  # exact float32 positions; "minimal" cuts to millimetres
        try:
            self.scene = sapien.Scene([sapien.render.RenderSystem()])
        except RuntimeError as error:
            raise RendererUnavailable(f"SAPIEN cannot render here: {error}. {REMEDY}") from error
        self.camera = sapien.render.RenderCameraComponent(params.width, params.height)
        self.camera.set_perspective_parameters(
            NEAR, FAR, params.focal, params.focal, params.width / 2, params.height / 2, 0.0
        )
        mount = sapien.Entity()
        mount.add_component(self.camera)
        self.scene.add_entity(mount)
        self.material = sapien.render.RenderMaterial()

    def render(self, composition: Composition, view: View, chord: float) -> DepthImage:
        meshes = view.meshes(composition, chord)
        entities = [self._entity(mesh.vertices, mesh.triangles) for mesh in meshes]
        try:
            self.scene.update_render()
            self.camera.take_picture()
            position = self.camera.get_picture("Position")  # (H, W, 4) x right, y up, z backward; 0 where nothing is
            segmentation = self.camera.get_picture("Segmentation")  # (H, W, 4) the second is the entity's number
            numbers = [entity.per_scene_id for entity in entities]
        finally:
            for entity in entities:
                self.scene.remove_entity(entity)
        window = window_of(meshes, self.params)
        seen = segmentation[..., 1][window]
        depth, labels = np.zeros(segmentation.shape[:2]), np.full(segmentation.shape[:2], -1)
        for index, number in enumerate(numbers):
            labels[window][seen == number] = index
        depth[window] = np.where(labels[window] >= 0, -position[..., 2][window].astype(np.float64), 0.0)
        return DepthImage(depth, labels)

    def _entity(self, vertices: np.ndarray, triangles: np.ndarray) -> Any:
        # The camera stays at the origin, which SAPIEN has look along x with y to the left and z up.
        world = np.stack([vertices[:, 2], -vertices[:, 0], -vertices[:, 1]], axis=1)
        shape = self.sapien.render.RenderShapeTriangleMesh(
            world.astype(np.float32),
            triangles.astype(np.uint32),
            np.zeros((0, 3), np.float32),
            np.zeros((0, 2), np.float32),
            self.material,
        )
        body = self.sapien.render.RenderBodyComponent()
        body.attach(shape)
        entity = self.sapien.Entity()
        entity.add_component(body)
        self.scene.add_entity(entity)
        return entity


@lru_cache(maxsize=1)
def _scene(params: CameraParams) -> _Scene:
    return _Scene(params)


def _try() -> int:
    """Renders a sphere a metre away; 0 where it is seen."""
    view = View(np.eye(4))
    pose = np.eye(4)
    pose[2, 3] = 1.0
    try:
        image = render(Composition((Prototype("sphere", (0.1,), pose),)), view, CameraParams(width=32, height=32), 1e-3)
    except RendererUnavailable as error:
        print(error, file=sys.stderr)
        return CANNOT_RENDER
    if not (image.depth > 0).any():
        print(f"SAPIEN renders, but nothing is to be seen. {REMEDY}", file=sys.stderr)
        return CANNOT_RENDER
    return 0


if __name__ == "__main__":
    sys.exit(_try())
