"""A request for inference, whatever the wire that it came by: checked, and answered with tensors."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from service.application import Application, CloudFile, parse_viewpoint
from service.clouds import Viewpoint
from service.clouds.claims import quote
from service.clouds.npy import of_points
from service.engine.errors import EmptyCloud, InvalidParameter, TooManyPoints, UnreadableCloud
from service.engine.model import OnStage, ignore_stage
from service.transports.open_inference.signature import (
    CLOUD,
    DATATYPE,
    OUTPUTS,
    POINT_SEGMENTS,
    STIMULI,
    Output,
    Told,
    describe,
)
from service.transports.open_inference.tensors import Tensor, tensor

BYTES_OF_POINT = 12
LONGEST_MODEL = 200  # characters
LONGEST_ID = 1000  # characters
LONGEST_TEXT = 300  # characters of a parameter
PARAMETERS = ("time", "top", "unit", "viewpoint")
WITHOUT_EFFECT = ("sequence_id", "sequence_start", "sequence_end", "priority", "timeout", "headers")  # Triton's own
TRITON = "triton_"  # begins other names that Triton keeps for itself


class Options(NamedTuple):
    """What is asked about a cloud, as `Application.respond` takes it.

    Attributes:
        time: filtration time of the concepts, [0, 1].
        top: how many concepts are ranked.
        unit: of the coordinates.
        viewpoint: pose of the sensor.
    """

    time: float | None = None
    top: int | None = None
    unit: str | None = None
    viewpoint: Viewpoint | None = None


class Inference(NamedTuple):
    """A request.

    Attributes:
        model: NAME, or NAME@ALIAS; None for the default model.
        version: of the model; None for that which its alias means.
        id: that the client gave to it, "" for none.
        options: what is asked.
        outputs: tensors that the answer shall have.
        xyz: the cloud: (N, 3) float32, little-endian.
    """

    model: str | None
    version: int | None
    id: str
    options: Options
    outputs: tuple[Output, ...]
    xyz: bytes


class Inferred(NamedTuple):
    """The answer: the name and the version of the model that gave it, and its tensors in the order asked for."""

    model: str
    version: int
    tensors: tuple[Tensor, ...]


def infer(application: Application, asked: Inference, on_stage: OnStage = ignore_stage) -> Inferred:
    """Answers a cloud. Runs on the caller's thread.

    Raises:
        ShapeConceptsError: as `Application.respond`.
    """
    names = {output.name for output in asked.outputs}
    options = asked.options
    answer = application.respond(
        CloudFile(of_points(asked.xyz), "npy", unit=options.unit, viewpoint=options.viewpoint),
        model=asked.model,
        version=asked.version,
        time=options.time,
        top=options.top,
        stimuli=not names.isdisjoint(STIMULI),
        segments=POINT_SEGMENTS in names,
        on_stage=on_stage,
    )
    told = Told(answer, application.concept_order(answer.model, answer.version, options.time))
    tensors = [tensor(output.name, output.datatype, output.values(told)) for output in asked.outputs]
    return Inferred(answer.model, answer.version, tuple(tensors))


def metadata(application: Application, model: str, version: str) -> dict[str, Any]:
    """The metadata of a model: of one version, or of all where the version is "".

    Raises:
        ModelNotFound: there is no such model or version.
    """
    asked = parse_version(version)
    name, number = application.which(parse_model(model), asked)
    if asked is None:
        return describe(name, application.models.one(name).versions)
    application.models.manifest(name, number)
    return describe(name, [number])


def parse_model(text: str) -> str | None:
    """The model that a request names; None for the default one."""
    if len(text) > LONGEST_MODEL:
        raise InvalidParameter(f"The name of a model has at most {LONGEST_MODEL} characters, not {len(text)}.")
    return text or None


def parse_version(text: str) -> int | None:
    """The version that a request names; None where it names none.

    Raises:
        InvalidParameter: it is no number.
    """
    if text and not re.fullmatch("[0-9]{1,8}", text):
        raise InvalidParameter(f"A version is a number such as '1', or left out for that in use; not {quote(text)}.")
    return int(text) if text else None


def parse_id(text: str) -> str:
    """The id that a client gave to its request."""
    if len(text) > LONGEST_ID:
        raise InvalidParameter(f"The id of a request has at most {LONGEST_ID} characters, not {len(text)}.")
    return text


def parse_options(parameters: Mapping[str, Any]) -> Options:
    """The parameters of a request.

    Raises:
        InvalidParameter: one is unknown, or not of its kind and range.
    """
    for name in parameters:
        if name not in PARAMETERS and name not in WITHOUT_EFFECT and not name.startswith(TRITON):
            raise InvalidParameter(f"There is no parameter {quote(name)}; there are {', '.join(PARAMETERS)}.")
    time = _number(parameters, "time")
    if time is not None and not 0 <= time <= 1:
        raise InvalidParameter(f"time is a filtration time from 0 to 1; it was {time:g}.")
    top = _number(parameters, "top")
    if top is not None and not (top >= 1 and top.is_integer()):
        raise InvalidParameter(f"top is the number of concepts to rank, at least 1; it was {top:g}.")
    viewpoint = _text(parameters, "viewpoint")
    return Options(
        time,
        None if top is None else int(top),
        _text(parameters, "unit"),
        parse_viewpoint(viewpoint) if viewpoint else None,
    )


def parse_outputs(names: Iterable[str]) -> tuple[Output, ...]:
    """The outputs of these names; where there are none, those that need not be asked for.

    Raises:
        InvalidParameter: one is unknown, or named twice.
    """
    chosen: dict[str, Output] = {}
    for name in names:
        if name not in OUTPUTS or name in chosen:
            problem = "is asked for twice" if name in chosen else f"is unknown; there are {', '.join(OUTPUTS)}"
            raise InvalidParameter(f"The output {quote(name)} {problem}.")
        chosen[name] = OUTPUTS[name]
    return tuple(chosen.values()) or tuple(output for output in OUTPUTS.values() if not output.asked)


def check_cloud(name: str, datatype: str, shape: Sequence[int], max_points: int) -> int:
    """How many points the cloud has that the one input announces; nothing is made for it yet.

    Raises:
        InvalidParameter: it is not `cloud`, FP32, (N, 3).
        EmptyCloud, TooManyPoints: by N.
    """
    if name != CLOUD:
        raise InvalidParameter(f"The input {quote(name)} is unknown; a model takes one, '{CLOUD}'.")
    if datatype != DATATYPE:
        raise InvalidParameter(f"The input '{CLOUD}' is {DATATYPE}, not {quote(datatype)}: send it as float32.")
    if len(shape) != 2 or shape[1] != 3 or shape[0] < 0:
        raise InvalidParameter(
            f"The input '{CLOUD}' has the shape [N, 3], x y z of each of N points; not {quote(list(shape[:8]))}."
        )
    if shape[0] == 0:
        raise EmptyCloud("The cloud holds no point. Send the points that the sensor measured of one object.")
    if shape[0] > max_points:
        raise TooManyPoints(f"The cloud has {quote(shape[0])} points; at most {max_points} are taken: thin it out.")
    return shape[0]


def check_size(points: int, size: int) -> None:
    """Refuses a binary tensor that is not as long as its shape says.

    Raises:
        UnreadableCloud: `size`, bytes, is another.
    """
    if size != points * BYTES_OF_POINT:
        raise UnreadableCloud(
            f"The tensor '{CLOUD}' of {points} points is {points * BYTES_OF_POINT} bytes long, but {size} came: it was "
            "cut off, or its shape is wrong."
        )


def _number(parameters: Mapping[str, Any], name: str) -> float | None:
    """A finite number; clients that can send none as a parameter send its text."""
    given = parameters.get(name)
    if given is None:
        return None
    try:
        if isinstance(given, (int, float, str)) and not isinstance(given, bool) and math.isfinite(float(given)):
            return float(given)
    except (ValueError, OverflowError):
        pass
    raise InvalidParameter(f"The parameter {name} is a finite number, not {quote(given)}.")


def _text(parameters: Mapping[str, Any], name: str) -> str | None:
    given = parameters.get(name)
    if given is not None and (not isinstance(given, str) or len(given) > LONGEST_TEXT):
        raise InvalidParameter(f"The parameter {name} is a text of at most {LONGEST_TEXT} characters.")
    return given or None
