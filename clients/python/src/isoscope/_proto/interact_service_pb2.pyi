from google.protobuf import duration_pb2 as _duration_pb2
from isoscope._proto import isosurface_service_pb2 as _isosurface_service_pb2
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class DepthGrid(_message.Message):
    __slots__ = ["depths", "far", "height", "near", "width"]
    DEPTHS_FIELD_NUMBER: _ClassVar[int]
    FAR_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    NEAR_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    depths: bytes
    far: float
    height: int
    near: float
    width: int
    def __init__(self, width: _Optional[int] = ..., height: _Optional[int] = ..., near: _Optional[float] = ..., far: _Optional[float] = ..., depths: _Optional[bytes] = ...) -> None: ...

class FrameError(_message.Message):
    __slots__ = ["code", "message", "reason", "retry_duration"]
    CODE_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    RETRY_DURATION_FIELD_NUMBER: _ClassVar[int]
    code: int
    message: str
    reason: str
    retry_duration: _duration_pb2.Duration
    def __init__(self, code: _Optional[int] = ..., message: _Optional[str] = ..., reason: _Optional[str] = ..., retry_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ...) -> None: ...

class FrameShown(_message.Message):
    __slots__ = ["decode_duration", "frame_number"]
    DECODE_DURATION_FIELD_NUMBER: _ClassVar[int]
    FRAME_NUMBER_FIELD_NUMBER: _ClassVar[int]
    decode_duration: _duration_pb2.Duration
    frame_number: int
    def __init__(self, frame_number: _Optional[int] = ..., decode_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ...) -> None: ...

class InteractRequest(_message.Message):
    __slots__ = ["frame_shown", "view_state"]
    FRAME_SHOWN_FIELD_NUMBER: _ClassVar[int]
    VIEW_STATE_FIELD_NUMBER: _ClassVar[int]
    frame_shown: FrameShown
    view_state: ViewState
    def __init__(self, view_state: _Optional[_Union[ViewState, _Mapping]] = ..., frame_shown: _Optional[_Union[FrameShown, _Mapping]] = ...) -> None: ...

class InteractResponse(_message.Message):
    __slots__ = ["depth_grid", "error", "frame", "frame_number", "is_exact", "sequence_number"]
    DEPTH_GRID_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    FRAME_NUMBER_FIELD_NUMBER: _ClassVar[int]
    IS_EXACT_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_NUMBER_FIELD_NUMBER: _ClassVar[int]
    depth_grid: DepthGrid
    error: FrameError
    frame: _isosurface_service_pb2.RenderIsosurfaceResponse
    frame_number: int
    is_exact: bool
    sequence_number: int
    def __init__(self, sequence_number: _Optional[int] = ..., frame_number: _Optional[int] = ..., is_exact: bool = ..., frame: _Optional[_Union[_isosurface_service_pb2.RenderIsosurfaceResponse, _Mapping]] = ..., depth_grid: _Optional[_Union[DepthGrid, _Mapping]] = ..., error: _Optional[_Union[FrameError, _Mapping]] = ...) -> None: ...

class ViewState(_message.Message):
    __slots__ = ["frame", "is_at_rest", "sequence_number", "target_frames_per_second"]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    IS_AT_REST_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_NUMBER_FIELD_NUMBER: _ClassVar[int]
    TARGET_FRAMES_PER_SECOND_FIELD_NUMBER: _ClassVar[int]
    frame: _isosurface_service_pb2.RenderIsosurfaceRequest
    is_at_rest: bool
    sequence_number: int
    target_frames_per_second: float
    def __init__(self, sequence_number: _Optional[int] = ..., frame: _Optional[_Union[_isosurface_service_pb2.RenderIsosurfaceRequest, _Mapping]] = ..., target_frames_per_second: _Optional[float] = ..., is_at_rest: bool = ...) -> None: ...
