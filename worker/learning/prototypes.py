"""What a model shows of its training objects: thumbnails, and their places in the map CR^2."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from sklearn.manifold import TSNE

from service.engine.segments import SegmentGraph

PIXELS = 48
TO_IMAGE = np.array([1.0, -1.0, -1.0])  # from the sensor's right, down, forward to right, up, towards the viewer
LIGHT = np.array([0.4, 0.6, 0.7])  # from over the viewer's shoulder: right, up, towards the viewer
PERPLEXITY = 30


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
    for k in np.argsort(place[:, 2], kind="stable"):
        column, row = int(pixels[k, 0]), PIXELS - 1 - int(pixels[k, 1])
        image[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1] = shade[k]
    return image


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
    embedding = TSNE(2, perplexity=min(PERPLEXITY, (size - 1) / 3), init=start, random_state=seed, n_jobs=1)
    return np.asarray(embedding.fit_transform(coordinates), dtype=np.float32)
