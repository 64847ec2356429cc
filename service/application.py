"""The use cases of the service, for the command line and every transport; it knows none of them."""

from __future__ import annotations

import re
import time as clock
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from service import clouds
from service.access import Gate, needs_keys
from service.aliases import AliasEntry
from service.answer import Answer, compose
from service.catalogue import (
    AnnexationGraph,
    Barcode,
    ConceptList,
    Tree,
    list_concepts,
    tell_annexations,
    tell_barcode,
    tell_tree,
)
from service.engine.cloud import PointCloud
from service.engine.errors import InvalidCloud, InvalidParameter, ModelNotFound, TooManyPoints
from service.engine.model import OnStage, ignore_stage
from service.jobs import Job, Jobs, JobSpec
from service.keys import AccessKey, KeyStore
from service.lately import Answers, Models
from service.model_file import Manifest
from service.naming import Naming
from service.pool import Intake, Pool
from service.scene_answer import Refusal, SceneAnswer, compose_scene, refuse
from service.settings import Settings
from service.store import NO_MODEL, PRODUCTION, ModelStore
from service.tabletop import cut_out, find_objects


class CloudFile(NamedTuple):
    """A cloud as somebody sent it.

    Attributes:
        data: the bytes of the file.
        format: one of clouds.FORMATS; None to tell it from the content, then from the name's ending.
        name: of the file, if it has one.
        unit: of the coordinates: m, cm, mm, ...; None where the file says so itself or it is metres.
        viewpoint: pose of the sensor in the cloud's frame; None where the file says so itself or it is the origin.
        camera: that took the depth image which the file is; None where it is none.
        mask: the file of a depth image's mask, if it has one.
    """

    data: bytes
    format: str | None = None
    name: str = ""
    unit: str | None = None
    viewpoint: clouds.Viewpoint | None = None
    camera: clouds.DepthCamera | None = None
    mask: bytes | None = None


class ConceptOrder(NamedTuple):
    """The order in which an answer has its responses and distances.

    Attributes:
        ids: (K,) int64: the concepts, each once.
        times: (K,) float64: the filtration time at which each was taken, [0, 1].
    """

    ids: NDArray[np.int64]
    times: NDArray[np.float64]


class ModelSummary(BaseModel):
    """A model of the store."""

    name: str = Field(description="the model's name")
    versions: list[int] = Field(description="its versions, ascending")
    aliases: dict[str, int] = Field(description="what each alias means now")


class Readiness(BaseModel):
    """That the service can answer, and with what."""

    model: str | None = Field(description="model that answers requests which name none; null if they must")
    version: int | None = Field(description="its version")
    models: list[str] = Field(description="names of all models in the store")


class Application:
    """The service without its transports.

    Args:
        settings: where the models are, which one answers by default, and the limits.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.store = ModelStore(settings.store)
        self.pool = Pool(settings.workers, settings.queue)
        self.intake = Intake(max(settings.max_bodies, settings.max_body))
        self._jobs = Jobs(settings.jobs_url)
        self._models = Models(lambda name, version: self.store.load(name, version)[0], settings.loaded_models)
        self._answers = Answers()
        self.naming = Naming(self.store, self._models, self._answers)
        self._keys = KeyStore(settings.store)
        self.access = Gate(self.valid_keys if needs_keys(settings) else None)

    def close(self) -> None:
        """Waits for the work under way."""
        self.pool.close()
        self._answers.close()
        self._jobs.close()

    def respond(
        self,
        cloud: CloudFile | PointCloud,
        *,
        model: str | None = None,
        version: int | None = None,
        alias: str | None = None,
        time: float | None = None,
        top: int | None = None,
        stimuli: bool = False,
        explain: bool = False,
        segments: bool = False,
        on_stage: OnStage = ignore_stage,
    ) -> Answer:
        """Which concepts a cloud resembles. Runs on the caller's thread.

        Args:
            cloud: bytes of a file, or points in the sensor's frame.
            model: NAME, NAME@ALIAS or NAME:VERSION; None for the default model.
            version: of the model, instead of in its name.
            alias: of the version, instead of in the model's name.
            time: filtration time in [0, 1] of all concepts; None for the model's epsilon_max, and after its concepts
                those of other times.
            top: how many of the best concepts are listed; None for all.
            stimuli: whether the stimuli vector is part of the answer.
            explain: whether the answer says why it is what it is.
            segments: whether it says of each point of the cloud to which segment it belongs.
            on_stage: called with each stage's name as it begins; may raise `Cancelled`.

        Raises:
            ShapeConceptsError: one of its children, saying what is wrong with the cloud, the parameters or the model.
        """
        _check_top(top)
        name, number = self.which(model, version, alias)
        shape_model = self._models.get(name, number)
        names = self.naming.names(name, number).of
        timings = _Timings(on_stage)
        timings.begin("decode")
        points = self._points(cloud)
        response = shape_model.respond(points, time=time, explain=explain, segments=segments, on_stage=timings.begin)
        return compose(response, (name, number), timings.end(), top=top, stimuli=stimuli, names=names)

    def respond_scene(
        self,
        scene: CloudFile | clouds.SceneCloud,
        *,
        model: str | None = None,
        version: int | None = None,
        alias: str | None = None,
        time: float | None = None,
        top: int | None = None,
        stimuli: bool = False,
        explain: bool = False,
        segments: bool = False,
        on_stage: OnStage = ignore_stage,
    ) -> SceneAnswer:
        """Which concepts the objects on a table, a floor or another plane resemble, and where they are.

        An object that cannot be answered is told with its error, and keeps no other from its answer. Arguments and
        errors are those of `respond`, for each object; `segments` also says which object each point is part of.

        Raises:
            NoSupportingPlane: there is nothing that objects could stand on.
        """
        _check_top(top)
        name, number = self.which(model, version, alias)
        shape_model = self._models.get(name, number)
        names = self.naming.names(name, number).of
        timings = _Timings(on_stage)
        timings.begin("decode")
        sent = self._scene(scene)
        timings.begin("tabletop")
        seen = find_objects(sent.cloud, width=sent.width, most=self.settings.max_objects)
        answers: list[Answer | Refusal] = []
        for one in seen.objects:
            own = _Timings(timings.begin)
            try:
                response = shape_model.respond(
                    cut_out(sent.cloud, one, seen.plane),
                    time=time,
                    explain=explain,
                    segments=segments,
                    on_stage=own.begin,
                )
            except InvalidCloud as error:
                answers.append(refuse(error))
            else:
                answers.append(compose(response, (name, number), own.end(), top=top, stimuli=stimuli, names=names))
        return compose_scene(sent, seen, answers, (name, number), timings.end(), points=segments)

    def concept_order(self, name: str, version: int, time: float | None = None) -> ConceptOrder:
        """Which concepts the responses of a version's answers are to.

        Args:
            name: of the model.
            version: its version.
            time: that the answer was asked for with.

        Raises:
            InvalidParameter: the time is not in [0, 1].
        """
        spectrum = self._models.get(name, version).spectrum(time)
        return ConceptOrder(spectrum.ids, spectrum.times)

    def which(self, model: str | None, version: int | None = None, alias: str | None = None) -> tuple[str, int]:
        """Name and version of the model that is meant.

        Raises:
            InvalidParameter: the three contradict each other, or several models could be meant.
            ModelNotFound: there is no such model.
        """
        reference = model or self.settings.model or self._only_model()
        if version is not None and alias is not None:
            raise InvalidParameter(f"Give a version or an alias, not both: they were {version} and '{alias}'.")
        if version is None and alias is None:
            return self._resolve(reference)
        name, *qualifier = re.split("[@:]", reference, maxsplit=1)
        if qualifier and model:
            raise InvalidParameter(f"The model '{model}' says its version or alias already; do not give another.")
        return self._resolve(f"{name}:{version}" if alias is None else f"{name}@{alias}")

    def prepare(self, model: str | None, version: int | None = None, alias: str | None = None) -> tuple[str, int]:
        """Name and version of the model that is meant, as `which`; it is in memory afterwards.

        Raises:
            ModelDamaged, ModelIncompatible: the model cannot be used.
        """
        name, number = self.which(model, version, alias)
        self._models.get(name, number)
        return name, number

    def ready(self) -> Readiness:
        """Whether there is a model to answer with; loads the default one.

        Raises:
            ModelNotFound: the store holds no model.
            StoreUnavailable: it cannot be read, and could not be before.
            ModelDamaged, ModelIncompatible: the default model cannot be used.
        """
        names = self._names()
        if self.settings.model is None and len(names) > 1:
            return Readiness(model=None, version=None, models=names)
        name, version = self.prepare(None)
        return Readiness(model=name, version=version, models=names)

    def models(self) -> list[ModelSummary]:
        """All models of the store with their versions and aliases."""
        return [self.model(name) for name in self.store.names()]

    def model(self, name: str) -> ModelSummary:
        """A model with its versions and aliases.

        Raises:
            ModelNotFound: there is no such model.
        """
        return ModelSummary(name=name, versions=self.store.require(name), aliases=self.store.aliases(name))

    def manifest(self, name: str, version: int) -> Manifest:
        """How a version was made."""
        return self._answers.get(f"the manifest of {name}:{version}", lambda: self.store.manifest(name, version))

    def concepts(self, name: str, version: int, time: float | None = None) -> ConceptList:
        """The concepts of a version: those at a filtration time; None for those that answers compare clouds with.

        Raises:
            InvalidParameter: the time is not in [0, 1].
        """
        names = self.naming.names(name, version).of
        return list_concepts(self._models.get(name, version), (name, version), time, names)

    def barcode(self, name: str, version: int) -> Barcode:
        """The bars of H_0 of a version's filtration."""
        return tell_barcode(self._models.get(name, version), (name, version))

    def annexations(self, name: str, version: int) -> AnnexationGraph:
        """The annexation graph F of a version."""
        return tell_annexations(self._models.get(name, version), (name, version))

    def tree(self, name: str, version: int) -> Tree:
        """The spanning tree of a version's topological space."""
        return tell_tree(self._models.get(name, version), (name, version))

    def valid_keys(self) -> dict[str, AccessKey]:
        """The access keys that are not revoked, by id; what was known last, while the store is away."""
        return self._answers.get("the access keys", self._keys.valid)

    def thumbnail(self, name: str, version: int, number: int) -> NDArray[np.uint8]:
        """A training object of a version as the sensor saw it (48, 48), shaded; 0 is background.

        Raises:
            InvalidParameter: the model has no training object of that number.
        """
        thumbnails = self._models.get(*self.which(name, version)).prototypes.thumbnails
        if not 0 <= number < len(thumbnails):
            raise InvalidParameter(
                f"{name}:{version} learnt from {len(thumbnails)} objects, numbered from 0; there is no {number}."
            )
        return thumbnails[number]

    def alias_histories(self, name: str) -> dict[str, list[AliasEntry]]:
        """All that each alias of a model has meant, oldest first.

        Raises:
            ModelNotFound: there is no such model.
        """
        self.store.require(name)
        return {alias: self.store.alias_history(name, alias) for alias in self.store.aliases(name)}

    def export(self, name: str, version: int, out_dir: Path) -> list[Path]:
        """Writes a version's files into a folder; returns them."""
        return self.store.export(name, version, out_dir)

    def promote(self, model: str, alias: str = PRODUCTION) -> tuple[str, int]:
        """Lets an alias mean the version that a reference names; returns its name and version."""
        name, version = self.store.resolve(model)
        self.store.promote(name, version, alias)
        self._answers.forget()
        return name, version

    def rollback(self, name: str, alias: str = PRODUCTION, leaving: int | None = None) -> int:
        """Lets an alias mean what it meant before; returns the version. `leaving`: only if it means that one now."""
        version = self.store.rollback(name, alias, leaving)
        self._answers.forget()
        return version

    def submit(self, spec: JobSpec, job_id: str | None = None) -> Job:
        """Puts a job into the queue; submitted again under the same id, it is the same job."""
        return self._jobs.submit(spec, job_id)

    def job(self, job_id: str) -> Job:
        """A job as it stands."""
        return self._jobs.show(job_id)

    def jobs(self, limit: int | None = None) -> list[Job]:
        """Jobs, the one submitted last first."""
        return self._jobs.recent(limit)

    def cancel(self, job_id: str) -> Job:
        """Takes a job from the queue, or stops it."""
        return self._jobs.cancel(job_id)

    def _points(self, cloud: CloudFile | PointCloud) -> PointCloud:
        return self._scene(clouds.SceneCloud(cloud) if isinstance(cloud, PointCloud) else cloud).cloud

    def _scene(self, cloud: CloudFile | clouds.SceneCloud) -> clouds.SceneCloud:
        limit = self.settings.max_points
        if isinstance(cloud, clouds.SceneCloud):
            if len(cloud.cloud.points) > limit:
                raise TooManyPoints(f"The cloud has {len(cloud.cloud.points)} points; at most {limit} are taken.")
            return cloud
        return clouds.read_scene(
            cloud.data,
            cloud.format,
            name=cloud.name,
            unit=cloud.unit,
            viewpoint=cloud.viewpoint,
            camera=cloud.camera,
            mask=cloud.mask,
            max_points=limit,
        )

    def _only_model(self) -> str:
        names = self._names()
        if len(names) == 1:
            return names[0]
        raise InvalidParameter(f"Say which model is meant: there are {', '.join(names)}.")

    def _resolve(self, reference: str) -> tuple[str, int]:
        return self._answers.get(f"the model {reference}", lambda: self.store.resolve(reference))

    def _names(self) -> list[str]:
        """Names of all models; there is at least one."""

        def read() -> list[str]:
            if names := self.store.names():
                return names
            raise ModelNotFound(NO_MODEL)

        return self._answers.get("the models that there are", read)


def parse_viewpoint(text: str) -> clouds.Viewpoint:
    """The pose "x,y,z" or "x,y,z,qw,qx,qy,qz", as requests and the command line write it.

    Raises:
        InvalidParameter: it is not 3 or 7 finite numbers, or the quaternion is no rotation.
    """
    parts = text.split(",")
    if len(parts) not in (3, 7):
        raise InvalidParameter(
            f"The viewpoint is x,y,z or x,y,z,qw,qx,qy,qz: 3 or 7 numbers, but there were {len(parts)}."
        )
    try:
        x, y, z, *turn = map(float, parts)
    except ValueError:
        raise InvalidParameter(f"The viewpoint is numbers, separated by commas; it was '{text[:100]}'.") from None
    return clouds.Viewpoint((x, y, z), (turn[0], turn[1], turn[2], turn[3]) if turn else (1.0, 0.0, 0.0, 0.0))


def _check_top(top: int | None) -> None:
    if top is not None and top < 1:
        raise InvalidParameter(f"top is the number of concepts to list, at least 1; it was {top}.")


class _Timings:
    """A clock that is told when a stage begins, and tells the caller."""

    def __init__(self, on_stage: OnStage) -> None:
        self._on_stage = on_stage
        self._begun: list[tuple[str, float]] = []

    def begin(self, stage: str) -> None:
        self._on_stage(stage)
        self._begun.append((stage, clock.perf_counter()))

    def end(self) -> dict[str, float]:
        """Milliseconds of each stage; a stage that began several times has their sum."""
        ends = [start for _, start in self._begun[1:]] + [clock.perf_counter()]
        spent: dict[str, float] = {}
        for (stage, start), end in zip(self._begun, ends, strict=True):
            spent[stage] = round(spent.get(stage, 0.0) + (end - start) * 1000, 3)
        return spent
