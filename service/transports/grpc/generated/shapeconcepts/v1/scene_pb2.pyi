from service.transports.grpc.generated.shapeconcepts.v1 import answer_pb2 as _answer_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class SceneAnswer(_message.Message):
    __slots__ = ("model", "version", "plane", "objects", "left_out", "warnings", "timings_ms", "point_objects")
    class TimingsMsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    MODEL_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    PLANE_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    LEFT_OUT_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    TIMINGS_MS_FIELD_NUMBER: _ClassVar[int]
    POINT_OBJECTS_FIELD_NUMBER: _ClassVar[int]
    model: str
    version: int
    plane: SupportingPlane
    objects: _containers.RepeatedCompositeFieldContainer[SceneObject]
    left_out: _containers.RepeatedCompositeFieldContainer[LeftOut]
    warnings: _containers.RepeatedScalarFieldContainer[str]
    timings_ms: _containers.ScalarMap[str, float]
    point_objects: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, model: _Optional[str] = ..., version: _Optional[int] = ..., plane: _Optional[_Union[SupportingPlane, _Mapping]] = ..., objects: _Optional[_Iterable[_Union[SceneObject, _Mapping]]] = ..., left_out: _Optional[_Iterable[_Union[LeftOut, _Mapping]]] = ..., warnings: _Optional[_Iterable[str]] = ..., timings_ms: _Optional[_Mapping[str, float]] = ..., point_objects: _Optional[_Iterable[int]] = ...) -> None: ...

class SupportingPlane(_message.Message):
    __slots__ = ("normal", "offset_m", "sensor_height_m", "points")
    NORMAL_FIELD_NUMBER: _ClassVar[int]
    OFFSET_M_FIELD_NUMBER: _ClassVar[int]
    SENSOR_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    normal: _containers.RepeatedScalarFieldContainer[float]
    offset_m: float
    sensor_height_m: float
    points: int
    def __init__(self, normal: _Optional[_Iterable[float]] = ..., offset_m: _Optional[float] = ..., sensor_height_m: _Optional[float] = ..., points: _Optional[int] = ...) -> None: ...

class SceneObject(_message.Message):
    __slots__ = ("number", "position_m", "sensor_position_m", "distance_m", "box", "height_m", "points", "touches", "hidden_by", "at_border", "beyond_edge", "answer", "error")
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    POSITION_M_FIELD_NUMBER: _ClassVar[int]
    SENSOR_POSITION_M_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    BOX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    TOUCHES_FIELD_NUMBER: _ClassVar[int]
    HIDDEN_BY_FIELD_NUMBER: _ClassVar[int]
    AT_BORDER_FIELD_NUMBER: _ClassVar[int]
    BEYOND_EDGE_FIELD_NUMBER: _ClassVar[int]
    ANSWER_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    number: int
    position_m: _containers.RepeatedScalarFieldContainer[float]
    sensor_position_m: _containers.RepeatedScalarFieldContainer[float]
    distance_m: float
    box: StandingBox
    height_m: _containers.RepeatedScalarFieldContainer[float]
    points: int
    touches: _containers.RepeatedScalarFieldContainer[int]
    hidden_by: _containers.RepeatedScalarFieldContainer[int]
    at_border: bool
    beyond_edge: bool
    answer: _answer_pb2.Answer
    error: Refusal
    def __init__(self, number: _Optional[int] = ..., position_m: _Optional[_Iterable[float]] = ..., sensor_position_m: _Optional[_Iterable[float]] = ..., distance_m: _Optional[float] = ..., box: _Optional[_Union[StandingBox, _Mapping]] = ..., height_m: _Optional[_Iterable[float]] = ..., points: _Optional[int] = ..., touches: _Optional[_Iterable[int]] = ..., hidden_by: _Optional[_Iterable[int]] = ..., at_border: _Optional[bool] = ..., beyond_edge: _Optional[bool] = ..., answer: _Optional[_Union[_answer_pb2.Answer, _Mapping]] = ..., error: _Optional[_Union[Refusal, _Mapping]] = ...) -> None: ...

class StandingBox(_message.Message):
    __slots__ = ("centre_m", "size_m", "axes")
    CENTRE_M_FIELD_NUMBER: _ClassVar[int]
    SIZE_M_FIELD_NUMBER: _ClassVar[int]
    AXES_FIELD_NUMBER: _ClassVar[int]
    centre_m: _containers.RepeatedScalarFieldContainer[float]
    size_m: _containers.RepeatedScalarFieldContainer[float]
    axes: Axes
    def __init__(self, centre_m: _Optional[_Iterable[float]] = ..., size_m: _Optional[_Iterable[float]] = ..., axes: _Optional[_Union[Axes, _Mapping]] = ...) -> None: ...

class Axes(_message.Message):
    __slots__ = ("length", "width", "height")
    LENGTH_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    length: _containers.RepeatedScalarFieldContainer[float]
    width: _containers.RepeatedScalarFieldContainer[float]
    height: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, length: _Optional[_Iterable[float]] = ..., width: _Optional[_Iterable[float]] = ..., height: _Optional[_Iterable[float]] = ...) -> None: ...

class Refusal(_message.Message):
    __slots__ = ("type", "detail")
    TYPE_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    type: str
    detail: str
    def __init__(self, type: _Optional[str] = ..., detail: _Optional[str] = ...) -> None: ...

class LeftOut(_message.Message):
    __slots__ = ("reason", "detail", "points", "pieces")
    REASON_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    PIECES_FIELD_NUMBER: _ClassVar[int]
    reason: str
    detail: str
    points: int
    pieces: int
    def __init__(self, reason: _Optional[str] = ..., detail: _Optional[str] = ..., points: _Optional[int] = ..., pieces: _Optional[int] = ...) -> None: ...
