import datetime

from google.protobuf import struct_pb2 as _struct_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ModelSummary(_message.Message):
    __slots__ = ("name", "versions", "aliases", "built_in")
    class AliasesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    VERSIONS_FIELD_NUMBER: _ClassVar[int]
    ALIASES_FIELD_NUMBER: _ClassVar[int]
    BUILT_IN_FIELD_NUMBER: _ClassVar[int]
    name: str
    versions: _containers.RepeatedScalarFieldContainer[int]
    aliases: _containers.ScalarMap[str, int]
    built_in: bool
    def __init__(self, name: _Optional[str] = ..., versions: _Optional[_Iterable[int]] = ..., aliases: _Optional[_Mapping[str, int]] = ..., built_in: _Optional[bool] = ...) -> None: ...

class Manifest(_message.Message):
    __slots__ = ("name", "version", "created", "format", "format_version", "seed", "params", "source", "counts", "stimuli_fill", "filtration_step", "epsilon_max", "notes", "contents", "libraries", "digest", "parent", "metrics", "job")
    class ContentsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: Content
        def __init__(self, key: _Optional[str] = ..., value: _Optional[_Union[Content, _Mapping]] = ...) -> None: ...
    class LibrariesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    class MetricsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    CREATED_FIELD_NUMBER: _ClassVar[int]
    FORMAT_FIELD_NUMBER: _ClassVar[int]
    FORMAT_VERSION_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    PARAMS_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    COUNTS_FIELD_NUMBER: _ClassVar[int]
    STIMULI_FILL_FIELD_NUMBER: _ClassVar[int]
    FILTRATION_STEP_FIELD_NUMBER: _ClassVar[int]
    EPSILON_MAX_FIELD_NUMBER: _ClassVar[int]
    NOTES_FIELD_NUMBER: _ClassVar[int]
    CONTENTS_FIELD_NUMBER: _ClassVar[int]
    LIBRARIES_FIELD_NUMBER: _ClassVar[int]
    DIGEST_FIELD_NUMBER: _ClassVar[int]
    PARENT_FIELD_NUMBER: _ClassVar[int]
    METRICS_FIELD_NUMBER: _ClassVar[int]
    JOB_FIELD_NUMBER: _ClassVar[int]
    name: str
    version: int
    created: _timestamp_pb2.Timestamp
    format: str
    format_version: int
    seed: int
    params: _struct_pb2.Struct
    source: _struct_pb2.Struct
    counts: _struct_pb2.Struct
    stimuli_fill: float
    filtration_step: float
    epsilon_max: float
    notes: _containers.RepeatedScalarFieldContainer[str]
    contents: _containers.MessageMap[str, Content]
    libraries: _containers.ScalarMap[str, str]
    digest: str
    parent: str
    metrics: _containers.ScalarMap[str, float]
    job: str
    def __init__(self, name: _Optional[str] = ..., version: _Optional[int] = ..., created: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., format: _Optional[str] = ..., format_version: _Optional[int] = ..., seed: _Optional[int] = ..., params: _Optional[_Union[_struct_pb2.Struct, _Mapping]] = ..., source: _Optional[_Union[_struct_pb2.Struct, _Mapping]] = ..., counts: _Optional[_Union[_struct_pb2.Struct, _Mapping]] = ..., stimuli_fill: _Optional[float] = ..., filtration_step: _Optional[float] = ..., epsilon_max: _Optional[float] = ..., notes: _Optional[_Iterable[str]] = ..., contents: _Optional[_Mapping[str, Content]] = ..., libraries: _Optional[_Mapping[str, str]] = ..., digest: _Optional[str] = ..., parent: _Optional[str] = ..., metrics: _Optional[_Mapping[str, float]] = ..., job: _Optional[str] = ...) -> None: ...

class Content(_message.Message):
    __slots__ = ("sha256", "size")
    SHA256_FIELD_NUMBER: _ClassVar[int]
    SIZE_FIELD_NUMBER: _ClassVar[int]
    sha256: str
    size: int
    def __init__(self, sha256: _Optional[str] = ..., size: _Optional[int] = ...) -> None: ...

class ConceptList(_message.Message):
    __slots__ = ("model", "version", "epsilon_max", "time", "concepts", "objects", "thumbnails")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    EPSILON_MAX_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    CONCEPTS_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    THUMBNAILS_FIELD_NUMBER: _ClassVar[int]
    model: str
    version: int
    epsilon_max: float
    time: float
    concepts: _containers.RepeatedCompositeFieldContainer[LearnedConcept]
    objects: _containers.RepeatedCompositeFieldContainer[LearnedObject]
    thumbnails: str
    def __init__(self, model: _Optional[str] = ..., version: _Optional[int] = ..., epsilon_max: _Optional[float] = ..., time: _Optional[float] = ..., concepts: _Optional[_Iterable[_Union[LearnedConcept, _Mapping]]] = ..., objects: _Optional[_Iterable[_Union[LearnedObject, _Mapping]]] = ..., thumbnails: _Optional[str] = ...) -> None: ...

class LearnedConcept(_message.Message):
    __slots__ = ("id", "name", "prototypes", "time", "objects")
    ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    PROTOTYPES_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    OBJECTS_FIELD_NUMBER: _ClassVar[int]
    id: int
    name: str
    prototypes: int
    time: float
    objects: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, id: _Optional[int] = ..., name: _Optional[str] = ..., prototypes: _Optional[int] = ..., time: _Optional[float] = ..., objects: _Optional[_Iterable[int]] = ...) -> None: ...

class LearnedObject(_message.Message):
    __slots__ = ("object", "key", "hash", "map")
    OBJECT_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    HASH_FIELD_NUMBER: _ClassVar[int]
    MAP_FIELD_NUMBER: _ClassVar[int]
    object: int
    key: str
    hash: str
    map: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, object: _Optional[int] = ..., key: _Optional[str] = ..., hash: _Optional[str] = ..., map: _Optional[_Iterable[float]] = ...) -> None: ...
