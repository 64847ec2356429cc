from __future__ import annotations

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import maximum_filter, minimum_filter

from tests.shapes import ball, look
from worker.simulation import raycast, scene
from worker.simulation.camera import DepthImage, draw_view
from worker.simulation.compositions import Composition, compose
from worker.simulation.params import CameraParams, PrototypeParams

ROOT = Path(__file__).resolve().parents[3]
KINECT = CameraParams()
CHORD = PrototypeParams().chord


def within_surfaces(image: DepthImage) -> np.ndarray:
    """(H, W) pixels whose neighbours all see the same prototype: none of them is at a silhouette."""
    return (minimum_filter(image.labels, 3) == maximum_filter(image.labels, 3)) & (image.labels >= 0)


@pytest.mark.usefixtures("sapien")
@pytest.mark.parametrize("seed", range(6))
def test_sapien_and_ray_casting_see_the_same_depths(seed: int) -> None:
    rng = np.random.default_rng(seed)
    composition = compose(seed % 5 + 1, PrototypeParams(), rng)
    view = draw_view(composition, KINECT, rng)
    rendered = scene.render(composition, view, KINECT, CHORD)
    cast = raycast.render(composition, view, KINECT, CHORD)
    assert (rendered.labels == cast.labels).mean() > 0.9999
    compared = within_surfaces(rendered) & within_surfaces(cast)
    assert compared.sum() > 0.5 * (cast.labels >= 0).sum()
    difference = (rendered.depth - cast.depth)[compared]
    assert np.sqrt(np.mean(difference**2)) < 1e-5  # 0.01 mm
    assert np.array_equal(rendered.depth > 0, rendered.labels >= 0)


@pytest.mark.usefixtures("sapien")
def test_a_picture_is_the_same_to_the_bit_whatever_was_rendered_before() -> None:
    rng = np.random.default_rng(0)
    one, other = (compose(order, PrototypeParams(), rng) for order in (5, 2))
    view = look(30, 40, 0.9)
    first = scene.render(one, view, KINECT, CHORD)
    scene.render(other, view, KINECT, CHORD)
    small = scene.render(one, view, CameraParams(width=64, height=48, focal=50), CHORD)
    again = scene.render(one, view, KINECT, CHORD)
    assert small.depth.shape == (48, 64)
    assert np.array_equal(first.depth, again.depth)
    assert np.array_equal(first.labels, again.labels)


@pytest.mark.usefixtures("sapien")
def test_what_was_rendered_is_gone_from_the_next_picture() -> None:
    view = look(0, 90, 1.0)
    big = scene.render(ball(0.2), view, KINECT, CHORD)
    small = scene.render(ball(0.02), view, KINECT, CHORD)
    assert (small.depth > 0).sum() < 0.02 * (big.depth > 0).sum()


@pytest.mark.usefixtures("sapien")
def test_threads_may_render_at_once() -> None:
    rng = np.random.default_rng(1)
    compositions = [compose(order, PrototypeParams(), rng) for order in (1, 2, 3, 4, 5, 1, 2, 3)]

    def depth(composition: Composition) -> np.ndarray:
        return scene.render(composition, look(30, 40, 0.9), KINECT, CHORD).depth

    alone = [depth(composition) for composition in compositions]
    with ThreadPoolExecutor(4) as threads:
        assert all(map(np.array_equal, alone, threads.map(depth, compositions)))


# Without a Vulkan driver. Each of these needs a process of its own: a driver is loaded once.


def without_vulkan(*command: str) -> subprocess.CompletedProcess[str]:
    nowhere = {"VK_ICD_FILENAMES": "/nonexistent.json", "VK_DRIVER_FILES": "/nonexistent.json"}
    return subprocess.run(
        [sys.executable, *command],
        env={**os.environ, **nowhere, "PYTHONPATH": str(ROOT)},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


def test_without_a_driver_simulation_is_refused_at_once_with_advice() -> None:
    ended = without_vulkan("-c", "from worker.simulation import simulate; simulate(1, 0)")
    assert ended.returncode == 1
    said = ended.stderr.strip().splitlines()[-1]
    assert "RendererUnavailable: SAPIEN" in said
    assert "raycast" in said


def test_without_a_driver_rendering_is_refused_too() -> None:
    pytest.importorskip("sapien")
    ended = without_vulkan("-m", "worker.simulation.scene")
    assert ended.returncode == scene.CANNOT_RENDER
    assert scene.REMEDY in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.parametrize(
    ("does", "said"),
    [
        ("raise ImportError('no libvulkan')", "cannot be loaded (no libvulkan)"),
        ("raise ValueError('odd')", "ended with code 1 (ValueError: odd)"),
        ("import os; os.abort()", "ended with code -6 "),
    ],
)
def test_a_sapien_that_breaks_where_it_is_loaded_is_told_of(does: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "sapien.py").write_text(does)
    ended = subprocess.run(
        [sys.executable, "-c", "from worker.simulation import scene; print(scene.unavailable())"],
        env={**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert said in ended.stdout
    assert "raycast" in ended.stdout


def test_ray_casting_needs_neither_a_driver_nor_sapien() -> None:
    program = (
        "import sys; from worker.simulation import simulate;"
        "(seen,) = simulate(1, 0, renderer='raycast');"
        "print(len(seen.cloud.points) > 0, 'sapien' in sys.modules)"
    )
    ended = without_vulkan("-c", program)
    assert ended.stdout.split() == ["True", "False"], ended.stderr
