import datetime

from google.protobuf import duration_pb2 as _duration_pb2
from service.transports.grpc.generated.shapeconcepts.v1 import answer_pb2 as _answer_pb2
from service.transports.grpc.generated.shapeconcepts.v1 import cloud_pb2 as _cloud_pb2
from service.transports.grpc.generated.shapeconcepts.v1 import model_pb2 as _model_pb2
from service.transports.grpc.generated.shapeconcepts.v1 import scene_pb2 as _scene_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class RespondRequest(_message.Message):
    __slots__ = ("cloud", "options")
    CLOUD_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    cloud: _cloud_pb2.Cloud
    options: _answer_pb2.Options
    def __init__(self, cloud: _Optional[_Union[_cloud_pb2.Cloud, _Mapping]] = ..., options: _Optional[_Union[_answer_pb2.Options, _Mapping]] = ...) -> None: ...

class RespondResponse(_message.Message):
    __slots__ = ("answer",)
    ANSWER_FIELD_NUMBER: _ClassVar[int]
    answer: _answer_pb2.Answer
    def __init__(self, answer: _Optional[_Union[_answer_pb2.Answer, _Mapping]] = ...) -> None: ...

class RespondSceneRequest(_message.Message):
    __slots__ = ("cloud", "options")
    CLOUD_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    cloud: _cloud_pb2.Cloud
    options: _answer_pb2.Options
    def __init__(self, cloud: _Optional[_Union[_cloud_pb2.Cloud, _Mapping]] = ..., options: _Optional[_Union[_answer_pb2.Options, _Mapping]] = ...) -> None: ...

class RespondSceneResponse(_message.Message):
    __slots__ = ("answer",)
    ANSWER_FIELD_NUMBER: _ClassVar[int]
    answer: _scene_pb2.SceneAnswer
    def __init__(self, answer: _Optional[_Union[_scene_pb2.SceneAnswer, _Mapping]] = ...) -> None: ...

class RespondBatchRequest(_message.Message):
    __slots__ = ("clouds", "options")
    CLOUDS_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    clouds: _containers.RepeatedCompositeFieldContainer[_cloud_pb2.Cloud]
    options: _answer_pb2.Options
    def __init__(self, clouds: _Optional[_Iterable[_Union[_cloud_pb2.Cloud, _Mapping]]] = ..., options: _Optional[_Union[_answer_pb2.Options, _Mapping]] = ...) -> None: ...

class RespondBatchResponse(_message.Message):
    __slots__ = ("index", "answer", "problem")
    INDEX_FIELD_NUMBER: _ClassVar[int]
    ANSWER_FIELD_NUMBER: _ClassVar[int]
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    index: int
    answer: _answer_pb2.Answer
    problem: Problem
    def __init__(self, index: _Optional[int] = ..., answer: _Optional[_Union[_answer_pb2.Answer, _Mapping]] = ..., problem: _Optional[_Union[Problem, _Mapping]] = ...) -> None: ...

class RespondStreamRequest(_message.Message):
    __slots__ = ("sequence", "cloud", "options", "scene")
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    CLOUD_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    SCENE_FIELD_NUMBER: _ClassVar[int]
    sequence: int
    cloud: _cloud_pb2.Cloud
    options: _answer_pb2.Options
    scene: bool
    def __init__(self, sequence: _Optional[int] = ..., cloud: _Optional[_Union[_cloud_pb2.Cloud, _Mapping]] = ..., options: _Optional[_Union[_answer_pb2.Options, _Mapping]] = ..., scene: _Optional[bool] = ...) -> None: ...

class RespondStreamResponse(_message.Message):
    __slots__ = ("sequence", "answer", "problem", "scene_answer")
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    ANSWER_FIELD_NUMBER: _ClassVar[int]
    PROBLEM_FIELD_NUMBER: _ClassVar[int]
    SCENE_ANSWER_FIELD_NUMBER: _ClassVar[int]
    sequence: int
    answer: _answer_pb2.Answer
    problem: Problem
    scene_answer: _scene_pb2.SceneAnswer
    def __init__(self, sequence: _Optional[int] = ..., answer: _Optional[_Union[_answer_pb2.Answer, _Mapping]] = ..., problem: _Optional[_Union[Problem, _Mapping]] = ..., scene_answer: _Optional[_Union[_scene_pb2.SceneAnswer, _Mapping]] = ...) -> None: ...

class Problem(_message.Message):
    __slots__ = ("type", "title", "status", "detail", "instance", "code", "retry_delay")
    TYPE_FIELD_NUMBER: _ClassVar[int]
    TITLE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    DETAIL_FIELD_NUMBER: _ClassVar[int]
    INSTANCE_FIELD_NUMBER: _ClassVar[int]
    CODE_FIELD_NUMBER: _ClassVar[int]
    RETRY_DELAY_FIELD_NUMBER: _ClassVar[int]
    type: str
    title: str
    status: int
    detail: str
    instance: str
    code: int
    retry_delay: _duration_pb2.Duration
    def __init__(self, type: _Optional[str] = ..., title: _Optional[str] = ..., status: _Optional[int] = ..., detail: _Optional[str] = ..., instance: _Optional[str] = ..., code: _Optional[int] = ..., retry_delay: _Optional[_Union[datetime.timedelta, _duration_pb2.Duration, _Mapping]] = ...) -> None: ...

class ListModelsRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class ListModelsResponse(_message.Message):
    __slots__ = ("models",)
    MODELS_FIELD_NUMBER: _ClassVar[int]
    models: _containers.RepeatedCompositeFieldContainer[_model_pb2.ModelSummary]
    def __init__(self, models: _Optional[_Iterable[_Union[_model_pb2.ModelSummary, _Mapping]]] = ...) -> None: ...

class GetModelRequest(_message.Message):
    __slots__ = ("model", "version", "alias")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    ALIAS_FIELD_NUMBER: _ClassVar[int]
    model: str
    version: int
    alias: str
    def __init__(self, model: _Optional[str] = ..., version: _Optional[int] = ..., alias: _Optional[str] = ...) -> None: ...

class GetModelResponse(_message.Message):
    __slots__ = ("manifest",)
    MANIFEST_FIELD_NUMBER: _ClassVar[int]
    manifest: _model_pb2.Manifest
    def __init__(self, manifest: _Optional[_Union[_model_pb2.Manifest, _Mapping]] = ...) -> None: ...

class ListConceptsRequest(_message.Message):
    __slots__ = ("model", "version", "alias", "time")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    ALIAS_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    model: str
    version: int
    alias: str
    time: float
    def __init__(self, model: _Optional[str] = ..., version: _Optional[int] = ..., alias: _Optional[str] = ..., time: _Optional[float] = ...) -> None: ...

class ListConceptsResponse(_message.Message):
    __slots__ = ("list",)
    LIST_FIELD_NUMBER: _ClassVar[int]
    list: _model_pb2.ConceptList
    def __init__(self, list: _Optional[_Union[_model_pb2.ConceptList, _Mapping]] = ...) -> None: ...
