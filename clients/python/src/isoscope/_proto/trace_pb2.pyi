from google.protobuf import duration_pb2 as _duration_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class FrameTrace(_message.Message):
    __slots__ = ["frame_number", "processes", "request_id"]
    FRAME_NUMBER_FIELD_NUMBER: _ClassVar[int]
    PROCESSES_FIELD_NUMBER: _ClassVar[int]
    REQUEST_ID_FIELD_NUMBER: _ClassVar[int]
    frame_number: int
    processes: _containers.RepeatedCompositeFieldContainer[ProcessTrace]
    request_id: str
    def __init__(self, frame_number: _Optional[int] = ..., request_id: _Optional[str] = ..., processes: _Optional[_Iterable[_Union[ProcessTrace, _Mapping]]] = ...) -> None: ...

class ProcessTrace(_message.Message):
    __slots__ = ["clock_error_duration", "dropped_span_count", "name", "tracks"]
    CLOCK_ERROR_DURATION_FIELD_NUMBER: _ClassVar[int]
    DROPPED_SPAN_COUNT_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    TRACKS_FIELD_NUMBER: _ClassVar[int]
    clock_error_duration: _duration_pb2.Duration
    dropped_span_count: int
    name: str
    tracks: _containers.RepeatedCompositeFieldContainer[TraceTrack]
    def __init__(self, name: _Optional[str] = ..., tracks: _Optional[_Iterable[_Union[TraceTrack, _Mapping]]] = ..., dropped_span_count: _Optional[int] = ..., clock_error_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ...) -> None: ...

class TraceSpan(_message.Message):
    __slots__ = ["name", "span_duration", "start_duration"]
    NAME_FIELD_NUMBER: _ClassVar[int]
    SPAN_DURATION_FIELD_NUMBER: _ClassVar[int]
    START_DURATION_FIELD_NUMBER: _ClassVar[int]
    name: str
    span_duration: _duration_pb2.Duration
    start_duration: _duration_pb2.Duration
    def __init__(self, name: _Optional[str] = ..., start_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., span_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ...) -> None: ...

class TraceTrack(_message.Message):
    __slots__ = ["name", "spans"]
    NAME_FIELD_NUMBER: _ClassVar[int]
    SPANS_FIELD_NUMBER: _ClassVar[int]
    name: str
    spans: _containers.RepeatedCompositeFieldContainer[TraceSpan]
    def __init__(self, name: _Optional[str] = ..., spans: _Optional[_Iterable[_Union[TraceSpan, _Mapping]]] = ...) -> None: ...
