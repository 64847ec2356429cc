"""What a model shows of its training objects: thumbnails, and their places in the map CR^2."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from service.engine.segments import SegmentGraph
from worker.learning.embedding import embed

PIXELS = 48
TO_IMAGE = np.array([1.0, -1.0, -1.0])  # from the sensor's right, down, forward to right, up, towards the viewer
LIGHT = np.array([0.4, 0.6, 0.7])  # from over the viewer's shoulder: right, up, towards the viewer
PERPLEXITY = 30
ALL_PAIRS = 2000  # objects, up to which a map by all pairs is made sooner than an approximation


def draw_thumbnail(graph: SegmentGraph) -> NDArray[np.uint8]:
    """The object as the sensor saw it (48, 48), shaded by its normals; 0 is background."""
    axes = graph.frame.axes.T * TO_IMAGE
    place = graph.points @ axes
    span = np.ptp(place[:, :2], axis=0).max()
    middle = (place[:, :2].max(axis=0) + place[:, :2].min(axis=0)) / 2
    pixels = (place[:, :2] - middle) / max(span, 1e-9) * (PIXELS - 5) + PIXELS / 2
    shade = 70 + 185 * np.clip(graph.normals @ axes @ LIGHT / np.linalg.norm(LIGHT), 0, 1)
    image = np.zeros((PIXELS, PIXELS), np.uint8)
    reach = max(1, round(0.6 * graph.voxel / max(span, 1e-9) * PIXELS))
    _paint(image, pixels, shade.astype(np.uint8), np.argsort(place[:, 2], kind="stable"), reach)
    return image


@njit(cache=True, nogil=True)
def _paint(
    image: NDArray[np.uint8],
    pixels: NDArray[np.float64],
    shade: NDArray[np.uint8],
    order: NDArray[np.int64],
    reach: int,
) -> None:
    """Paints a square for each point (M, 2) in turn, those in front over those behind."""
    for k in order:
        column, row = int(pixels[k, 0]), PIXELS - 1 - int(pixels[k, 1])
        for i in range(max(row - reach, 0), min(row + reach + 1, PIXELS)):
            for j in range(max(column - reach, 0), min(column + reach + 1, PIXELS)):
                image[i, j] = shade[k]


def draw_map(coordinates: NDArray[np.float64], seed: int) -> NDArray[np.float32]:
    """t-SNE of the training objects (N, 2) from their embedded stimuli (N, k); of under 4 the first coordinates."""
    size = len(coordinates)
    if size < 4:
        flat = np.zeros((size, 2), np.float32)
        flat[:, : coordinates.shape[1]] = coordinates[:, :2]
        return flat
    start = np.zeros((size, 2))
    start[:, : coordinates.shape[1]] = coordinates[:, :2]
    start *= 1e-4 / max(start[:, 0].std(), 1e-12)
    perplexity = min(PERPLEXITY, (size - 1) / 3)
    if size <= ALL_PAIRS:
        return embed(coordinates, perplexity, start).astype(np.float32)
    from sklearn.manifold import TSNE  # takes more time to import than few objects take to embed

    embedding = TSNE(2, perplexity=perplexity, init=start, random_state=seed, n_jobs=1)
    return np.asarray(embedding.fit_transform(coordinates), dtype=np.float32)
