from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Options(_message.Message):
    __slots__ = ("model", "version", "alias", "time", "top", "stimuli", "explain", "segments")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    ALIAS_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    TOP_FIELD_NUMBER: _ClassVar[int]
    STIMULI_FIELD_NUMBER: _ClassVar[int]
    EXPLAIN_FIELD_NUMBER: _ClassVar[int]
    SEGMENTS_FIELD_NUMBER: _ClassVar[int]
    model: str
    version: int
    alias: str
    time: float
    top: int
    stimuli: bool
    explain: bool
    segments: bool
    def __init__(self, model: _Optional[str] = ..., version: _Optional[int] = ..., alias: _Optional[str] = ..., time: _Optional[float] = ..., top: _Optional[int] = ..., stimuli: _Optional[bool] = ..., explain: _Optional[bool] = ..., segments: _Optional[bool] = ...) -> None: ...

class Answer(_message.Message):
    __slots__ = ("model", "version", "time", "responses", "distances", "concepts", "novelty", "segments", "extent_m", "truncated", "warnings", "timings_ms", "stimuli", "explanation", "point_segments")
    class TimingsMsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    MODEL_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    RESPONSES_FIELD_NUMBER: _ClassVar[int]
    DISTANCES_FIELD_NUMBER: _ClassVar[int]
    CONCEPTS_FIELD_NUMBER: _ClassVar[int]
    NOVELTY_FIELD_NUMBER: _ClassVar[int]
    SEGMENTS_FIELD_NUMBER: _ClassVar[int]
    EXTENT_M_FIELD_NUMBER: _ClassVar[int]
    TRUNCATED_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    TIMINGS_MS_FIELD_NUMBER: _ClassVar[int]
    STIMULI_FIELD_NUMBER: _ClassVar[int]
    EXPLANATION_FIELD_NUMBER: _ClassVar[int]
    POINT_SEGMENTS_FIELD_NUMBER: _ClassVar[int]
    model: str
    version: int
    time: float
    responses: _containers.RepeatedScalarFieldContainer[float]
    distances: _containers.RepeatedScalarFieldContainer[float]
    concepts: _containers.RepeatedCompositeFieldContainer[Concept]
    novelty: float
    segments: int
    extent_m: float
    truncated: bool
    warnings: _containers.RepeatedScalarFieldContainer[str]
    timings_ms: _containers.ScalarMap[str, float]
    stimuli: Stimuli
    explanation: Explanation
    point_segments: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, model: _Optional[str] = ..., version: _Optional[int] = ..., time: _Optional[float] = ..., responses: _Optional[_Iterable[float]] = ..., distances: _Optional[_Iterable[float]] = ..., concepts: _Optional[_Iterable[_Union[Concept, _Mapping]]] = ..., novelty: _Optional[float] = ..., segments: _Optional[int] = ..., extent_m: _Optional[float] = ..., truncated: _Optional[bool] = ..., warnings: _Optional[_Iterable[str]] = ..., timings_ms: _Optional[_Mapping[str, float]] = ..., stimuli: _Optional[_Union[Stimuli, _Mapping]] = ..., explanation: _Optional[_Union[Explanation, _Mapping]] = ..., point_segments: _Optional[_Iterable[int]] = ...) -> None: ...

class Concept(_message.Message):
    __slots__ = ("id", "name", "response", "distance", "rank", "prototypes", "time")
    ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    RESPONSE_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_FIELD_NUMBER: _ClassVar[int]
    RANK_FIELD_NUMBER: _ClassVar[int]
    PROTOTYPES_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    id: int
    name: str
    response: float
    distance: float
    rank: int
    prototypes: int
    time: float
    def __init__(self, id: _Optional[int] = ..., name: _Optional[str] = ..., response: _Optional[float] = ..., distance: _Optional[float] = ..., rank: _Optional[int] = ..., prototypes: _Optional[int] = ..., time: _Optional[float] = ...) -> None: ...

class Stimuli(_message.Message):
    __slots__ = ("index", "value")
    INDEX_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    index: _containers.RepeatedScalarFieldContainer[int]
    value: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, index: _Optional[_Iterable[int]] = ..., value: _Optional[_Iterable[float]] = ...) -> None: ...

class Explanation(_message.Message):
    __slots__ = ("segments", "vertices", "concepts", "wholes", "thumbnails")
    SEGMENTS_FIELD_NUMBER: _ClassVar[int]
    VERTICES_FIELD_NUMBER: _ClassVar[int]
    CONCEPTS_FIELD_NUMBER: _ClassVar[int]
    WHOLES_FIELD_NUMBER: _ClassVar[int]
    THUMBNAILS_FIELD_NUMBER: _ClassVar[int]
    segments: _containers.RepeatedCompositeFieldContainer[SeenSegment]
    vertices: _containers.RepeatedCompositeFieldContainer[FiredVertex]
    concepts: _containers.RepeatedCompositeFieldContainer[NearConcept]
    wholes: _containers.RepeatedCompositeFieldContainer[Likeness]
    thumbnails: str
    def __init__(self, segments: _Optional[_Iterable[_Union[SeenSegment, _Mapping]]] = ..., vertices: _Optional[_Iterable[_Union[FiredVertex, _Mapping]]] = ..., concepts: _Optional[_Iterable[_Union[NearConcept, _Mapping]]] = ..., wholes: _Optional[_Iterable[_Union[Likeness, _Mapping]]] = ..., thumbnails: _Optional[str] = ...) -> None: ...

class SeenSegment(_message.Message):
    __slots__ = ("share", "adjacent", "words", "centroid_m", "extent_m", "nearest")
    SHARE_FIELD_NUMBER: _ClassVar[int]
    ADJACENT_FIELD_NUMBER: _ClassVar[int]
    WORDS_FIELD_NUMBER: _ClassVar[int]
    CENTROID_M_FIELD_NUMBER: _ClassVar[int]
    EXTENT_M_FIELD_NUMBER: _ClassVar[int]
    NEAREST_FIELD_NUMBER: _ClassVar[int]
    share: float
    adjacent: _containers.RepeatedScalarFieldContainer[int]
    words: _containers.RepeatedScalarFieldContainer[int]
    centroid_m: _containers.RepeatedScalarFieldContainer[float]
    extent_m: float
    nearest: _containers.RepeatedCompositeFieldContainer[Likeness]
    def __init__(self, share: _Optional[float] = ..., adjacent: _Optional[_Iterable[int]] = ..., words: _Optional[_Iterable[int]] = ..., centroid_m: _Optional[_Iterable[float]] = ..., extent_m: _Optional[float] = ..., nearest: _Optional[_Iterable[_Union[Likeness, _Mapping]]] = ...) -> None: ...

class FiredVertex(_message.Message):
    __slots__ = ("vertex", "hierarchy", "also_in", "level", "words", "stimulus", "segments", "prototypes", "nearest")
    VERTEX_FIELD_NUMBER: _ClassVar[int]
    HIERARCHY_FIELD_NUMBER: _ClassVar[int]
    ALSO_IN_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    WORDS_FIELD_NUMBER: _ClassVar[int]
    STIMULUS_FIELD_NUMBER: _ClassVar[int]
    SEGMENTS_FIELD_NUMBER: _ClassVar[int]
    PROTOTYPES_FIELD_NUMBER: _ClassVar[int]
    NEAREST_FIELD_NUMBER: _ClassVar[int]
    vertex: int
    hierarchy: int
    also_in: _containers.RepeatedScalarFieldContainer[int]
    level: int
    words: _containers.RepeatedScalarFieldContainer[int]
    stimulus: float
    segments: _containers.RepeatedScalarFieldContainer[int]
    prototypes: int
    nearest: _containers.RepeatedCompositeFieldContainer[Likeness]
    def __init__(self, vertex: _Optional[int] = ..., hierarchy: _Optional[int] = ..., also_in: _Optional[_Iterable[int]] = ..., level: _Optional[int] = ..., words: _Optional[_Iterable[int]] = ..., stimulus: _Optional[float] = ..., segments: _Optional[_Iterable[int]] = ..., prototypes: _Optional[int] = ..., nearest: _Optional[_Iterable[_Union[Likeness, _Mapping]]] = ...) -> None: ...

class NearConcept(_message.Message):
    __slots__ = ("id", "nearest")
    ID_FIELD_NUMBER: _ClassVar[int]
    NEAREST_FIELD_NUMBER: _ClassVar[int]
    id: int
    nearest: _containers.RepeatedCompositeFieldContainer[Likeness]
    def __init__(self, id: _Optional[int] = ..., nearest: _Optional[_Iterable[_Union[Likeness, _Mapping]]] = ...) -> None: ...

class Likeness(_message.Message):
    __slots__ = ("object", "key", "hash", "distance")
    OBJECT_FIELD_NUMBER: _ClassVar[int]
    KEY_FIELD_NUMBER: _ClassVar[int]
    HASH_FIELD_NUMBER: _ClassVar[int]
    DISTANCE_FIELD_NUMBER: _ClassVar[int]
    object: int
    key: str
    hash: str
    distance: float
    def __init__(self, object: _Optional[int] = ..., key: _Optional[str] = ..., hash: _Optional[str] = ..., distance: _Optional[float] = ...) -> None: ...
