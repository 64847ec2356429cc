"""The use cases of the service, for the command line and every transport; it knows none of them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from service import clouds
from service.access import Gate, needs_keys
from service.answer import Answer, compose
from service.choosing import Choosing
from service.dataset_cases import DatasetCases
from service.engine.cloud import PointCloud
from service.engine.errors import InvalidCloud, InvalidParameter, TooManyPoints
from service.engine.model import OnStage, ignore_stage
from service.jobs import Jobs
from service.keys import AccessKey, KeyStore
from service.lately import Answers
from service.live import Live
from service.looking import Drawing, Looking
from service.metrics import State
from service.model_cases import ModelCases
from service.naming import Naming
from service.pool import Intake, Pool
from service.scene_answer import Refusal, SceneAnswer, compose_scene, refuse
from service.schedules import Schedules
from service.scheduling import Scheduling
from service.settings import Settings
from service.store import ModelStore
from service.telemetry import Stages, Telemetry
from service.training import Training

KEYS = "the access keys"  # that question to the store


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


class Readiness(BaseModel):
    """That the service can answer, and with what."""

    model: str | None = Field(description="model that answers requests which name none; null if they must")
    version: int | None = Field(description="its version")
    models: list[str] = Field(description="names of all models in the store")
    built_in: bool = Field(False, description="whether it is the one that came with the service: the store holds none")


class Application:
    """The service without its transports.

    Args:
        settings: where the models are, which one answers by default, and the limits.
        telemetry: measures requests; None for one without traces.
    """

    def __init__(self, settings: Settings, telemetry: Telemetry | None = None) -> None:
        self.settings = settings
        self.telemetry = telemetry or Telemetry()
        self.store = ModelStore(settings.store)
        self.datasets = DatasetCases(self.store, settings)
        self.pool = Pool(settings.workers, settings.queue, self.telemetry.metrics.waits.observe)
        self.intake = Intake(max(settings.max_bodies, settings.max_body))
        jobs = Jobs(settings.jobs_url)
        self.training = Training(jobs, self.store)
        self.live = Live(settings.streams)
        self.scheduling = Scheduling(Schedules(jobs), self.training)
        self._answers = Answers()
        self._choosing = Choosing(self.store, settings, self._answers)
        self.models = ModelCases(self.store, self._choosing, self._answers)
        self.looking = Looking(self._choosing, self.datasets.store)
        self._keys = KeyStore(settings.store)
        self.access = Gate(
            self.valid_keys if needs_keys(settings) else None, settings, at_hand=lambda: self._answers.at_hand(KEYS)
        )
        self.telemetry.metrics.watch(self._state)

    @property
    def naming(self) -> Naming:
        """The use cases on names of concepts."""
        return self._choosing.source().naming

    def let_go(self) -> None:
        """Lets those go who follow jobs or watch streams, and would stay for hours: the service ends."""
        self.training.ending.set()
        self.live.end()

    def close(self) -> None:
        """Waits for the work under way."""
        self.let_go()
        self.pool.close()
        self._answers.close()
        self.scheduling.close()
        self.training.close()
        self.telemetry.close()

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
        max_points: int | None = None,
        on_stage: OnStage = ignore_stage,
        drawing: Drawing | None = None,
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
            max_points: limit on the cloud for this caller; None for the service's own, which holds in any case.
            on_stage: called with each stage's name as it begins; may raise `Cancelled`.
            drawing: takes what is drawn of the cloud; the answer says of these points, and of no others, to which
                segment they belong.

        Raises:
            ShapeConceptsError: one of its children, saying what is wrong with the cloud, the parameters or the model.
        """
        _check_top(top)
        meant = self._choosing.meant(model, version, alias)
        shape_model, names = meant.model(), meant.names()
        with self.telemetry.answering(on_stage) as stages:
            stages.begin("decode")
            sent = self._scene(clouds.SceneCloud(cloud) if isinstance(cloud, PointCloud) else cloud, max_points)
            told = segments if drawing is None else PointCloud(drawing.begin(sent).points)
            response = shape_model.respond(sent.cloud, time=time, explain=explain, segments=told, on_stage=stages.begin)
        which = (meant.name, meant.version)
        answer = compose(response, which, stages.timings_ms(), top=top, stimuli=stimuli, names=names)
        self.telemetry.answered(answer)
        return answer

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
        max_points: int | None = None,
        on_stage: OnStage = ignore_stage,
        drawing: Drawing | None = None,
    ) -> SceneAnswer:
        """Which concepts the objects on a table, a floor or another plane resemble, and where they are.

        An object that cannot be answered is told with its error, and keeps no other from its answer. Arguments and
        errors are those of `respond`, for each object; `segments` also says which object each point is part of.

        Raises:
            NoSupportingPlane: there is nothing that objects could stand on.
        """
        from service.tabletop import cut_out, find_objects

        _check_top(top)
        meant = self._choosing.meant(model, version, alias)
        shape_model, names, which = meant.model(), meant.names(), (meant.name, meant.version)
        with self.telemetry.answering(on_stage) as stages:
            stages.begin("decode")
            sent = self._scene(scene, max_points)
            drawn = None if drawing is None else drawing.begin(sent)
            stages.begin("tabletop")
            seen = find_objects(sent.cloud, width=sent.width, most=self.settings.max_objects)
            answers: list[Answer | Refusal] = []
            for one in seen.objects:
                own = Stages(stages.begin)
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
                    own.end()
                    answer = compose(response, which, own.timings_ms(), top=top, stimuli=stimuli, names=names)
                    self.telemetry.answered(answer)
                    answers.append(answer)
        told = segments if drawn is None else drawn.places
        return compose_scene(sent, seen, answers, which, stages.timings_ms(), points=told)

    def read(self, cloud: CloudFile | clouds.SceneCloud, max_points: int | None = None) -> clouds.SceneCloud:
        """The points of a cloud, as `respond_scene` reads it. Runs on the caller's thread.

        Raises:
            ShapeConceptsError: one of its children, saying what is wrong with the cloud.
        """
        return self._scene(cloud, max_points)

    def concept_order(self, name: str, version: int, time: float | None = None) -> ConceptOrder:
        """Which concepts the responses of a version's answers are to.

        Args:
            name: of the model.
            version: its version.
            time: that the answer was asked for with.

        Raises:
            InvalidParameter: the time is not in [0, 1].
        """
        spectrum = self._choosing.meant(name, version).model().spectrum(time)
        return ConceptOrder(spectrum.ids, spectrum.times)

    def which(self, model: str | None, version: int | None = None, alias: str | None = None) -> tuple[str, int]:
        """Name and version of the model that is meant.

        Raises:
            InvalidParameter: the three contradict each other, or several models could be meant.
            ModelNotFound: there is no such model.
        """
        meant = self._choosing.meant(model, version, alias)
        return meant.name, meant.version

    def prepare(self, model: str | None, version: int | None = None, alias: str | None = None) -> tuple[str, int]:
        """Name and version of the model that is meant, as `which`; it is in memory afterwards.

        Raises:
            ModelDamaged, ModelIncompatible: the model cannot be used.
        """
        meant = self._choosing.meant(model, version, alias)
        meant.model()
        return meant.name, meant.version

    def ready(self) -> Readiness:
        """Whether there is a model to answer with; loads the default one.

        Raises:
            ModelNotFound: the store holds no model, and there is no built-in one.
            StoreUnavailable: it cannot be read, and could not be before.
            ModelDamaged, ModelIncompatible: the default model cannot be used.
        """
        source = self._choosing.source()
        names = self._choosing.names(source)
        if self.settings.model is None and len(names) > 1:
            return Readiness(model=None, version=None, models=names)
        meant = self._choosing.meant(None)
        meant.model()
        return Readiness(
            model=meant.name, version=meant.version, models=names, built_in=self._choosing.is_lent(meant.source)
        )

    def valid_keys(self) -> dict[str, AccessKey]:
        """The access keys that are not revoked, by id; what was known last, while the store is away."""
        return self._answers.get(KEYS, self._keys.valid)

    def _scene(self, cloud: CloudFile | clouds.SceneCloud, max_points: int | None) -> clouds.SceneCloud:
        limit = self.settings.max_points if max_points is None else min(self.settings.max_points, max_points)
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

    def _state(self) -> State:
        """How the service stands, for its metrics."""
        return State(
            at_work=self.pool.at_work,
            waiting=self.pool.waiting,
            places=self.pool.places,
            held=self.intake.held,
            limit=self.intake.limit,
            loaded=self._choosing.loaded(),
            serving=self._choosing.serving(),
        )


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
