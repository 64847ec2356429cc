"""What a job keeps in the model store from one step to the next, so that another worker can go on with it.

Below `jobs/<id>/`:

    clouds/<number>.npy   points of each cloud
    clouds.json           their keys, the source, the parent, and the clouds that could not be read
    model.safetensors     the tensors of the model
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import safetensors.numpy

from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.engine.params import ModelParams
from service.model_file import encode
from service.objects import Objects
from worker.learning.observations import NamedCloud

JOBS = "jobs"


class JobFiles:
    """The files of a job.

    Args:
        objects: of the store.
        job_id: whose files they are.
    """

    def __init__(self, objects: Objects, job_id: str) -> None:
        self._objects = objects
        self._folder = f"{JOBS}/{job_id}"

    def write_cloud(self, number: int, cloud: PointCloud) -> None:
        """Keeps a cloud, bit for bit."""
        self._objects.put(self._cloud(number), as_npy(cloud))

    def clouds(self) -> Iterator[NamedCloud]:
        """The clouds, one after the other."""
        for number, key in enumerate(self.index()["keys"]):
            points = np.load(io.BytesIO(self._objects.get(self._cloud(number))), allow_pickle=False)
            yield NamedCloud(key, PointCloud(points))

    def write_index(self, index: dict[str, Any]) -> None:
        """Keeps what is known of the clouds."""
        self._objects.put(f"{self._folder}/clouds.json", json.dumps(index).encode())

    def index(self) -> dict[str, Any]:
        """What is known of the clouds."""
        index: dict[str, Any] = json.loads(self._objects.get(f"{self._folder}/clouds.json"))
        return index

    def write_model(self, model: ShapeModel) -> None:
        """Keeps a model."""
        self._objects.put(f"{self._folder}/model.safetensors", encode(model))

    def model(self, params: ModelParams) -> ShapeModel:
        """The model that was kept; the parameters are those that it was learnt with."""
        data = self._objects.get(f"{self._folder}/model.safetensors")
        return ShapeModel.from_tensors(safetensors.numpy.load(data), params)

    def remove(self) -> None:
        """Forgets everything."""
        self._objects.remove(self._folder)

    def _cloud(self, number: int) -> str:
        return f"{self._folder}/clouds/{number:08}.npy"


def as_npy(cloud: PointCloud) -> bytes:
    """A file of a cloud's points, bit for bit."""
    data = io.BytesIO()
    np.save(data, cloud.points, allow_pickle=False)
    return data.getvalue()
