"""What the steps of a training job do: gather clouds, learn, publish.

Each may be killed at any moment and is then done again from its beginning, to the same effect. What one step leaves for
the next stands in the model store, below `jobs/<id>/`, so that another worker can go on with it:

    clouds/<number>.npy   points of each cloud
    clouds.json           their keys, the source, and the clouds that could not be read
    model.safetensors     the tensors of the model
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy

from service.engine.cloud import PointCloud
from service.engine.model import ShapeModel
from service.engine.perception import OnStage
from service.job_specs import TrainSpec
from service.model_file import encode
from service.objects import Objects
from service.store import ModelStore
from worker.learning.observations import NamedCloud
from worker.learning.train import train
from worker.simulation.params import SimulationParams
from worker.sources import Folder, Simulation, Source

JOBS = "jobs"


class JobFiles:
    """What a job keeps in the store from one step to the next.

    Args:
        objects: of the store.
        job_id: whose files they are.
    """

    def __init__(self, objects: Objects, job_id: str) -> None:
        self._objects = objects
        self._folder = f"{JOBS}/{job_id}"

    def write_cloud(self, number: int, cloud: PointCloud) -> None:
        """Keeps a cloud, bit for bit."""
        data = io.BytesIO()
        np.save(data, cloud.points, allow_pickle=False)
        self._objects.put(self._cloud(number), data.getvalue())

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

    def model(self, spec: TrainSpec) -> ShapeModel:
        """The model that was kept."""
        data = self._objects.get(f"{self._folder}/model.safetensors")
        return ShapeModel.from_tensors(safetensors.numpy.load(data), spec.params)

    def remove(self) -> None:
        """Forgets everything."""
        self._objects.remove(self._folder)

    def _cloud(self, number: int) -> str:
        return f"{self._folder}/clouds/{number:08}.npy"


def gather(spec: TrainSpec, files: JobFiles, on_cloud: Callable[[], None]) -> int:
    """Simulates the training clouds, or reads them, and keeps them.

    Args:
        spec: of the job.
        files: of the job.
        on_cloud: called after each cloud.

    Returns:
        How many there are.

    Raises:
        InvalidParameter: the folder holds no cloud, or a parameter of the simulation is out of its range.
        RendererUnavailable: SAPIEN cannot render here.
    """
    source = _source(spec)
    keys: list[str] = []
    for number, named in enumerate(source):
        files.write_cloud(number, named.cloud)
        keys.append(named.key)
        on_cloud()
    refused = {key: str(error) for key, error in source.refused}
    files.write_index({"keys": keys, "source": source.describe(), "refused": refused})
    return len(keys)


def learn(spec: TrainSpec, files: JobFiles, on_stage: OnStage) -> dict[str, str]:
    """Learns a model from the clouds and keeps it.

    Returns:
        The clouds that were left out, and why.

    Raises:
        NotEnoughSamples: fewer than two clouds can be described.
    """
    model, refused = train(files.clouds(), spec.params, spec.seed, on_stage)
    files.write_model(model)
    return files.index()["refused"] | {key: str(error) for key, error in refused}


def publish(spec: TrainSpec, files: JobFiles, store: ModelStore, job: str, once: str) -> int:
    """Publishes the model once, however often it is called.

    Args:
        spec: of the job.
        files: of the job.
        store: where to.
        job: its id.
        once: what no other job has, not even an earlier one of the same id.

    Returns:
        The version.
    """
    model = files.model(spec)
    source = files.index()["source"]
    parent = spec.parent and "{}:{}".format(*store.resolve(spec.parent))
    made: dict[str, Any] = {"name": spec.name, "seed": spec.seed, "source": source, "parent": parent}
    return store.publish(model, alias=spec.alias, job=job, once=once, **made).version


def _source(spec: TrainSpec) -> Source:
    if spec.clouds is not None:
        return Folder(Path(spec.clouds))
    return Simulation(spec.simulate or 0, spec.seed, SimulationParams().but(**spec.simulation))
