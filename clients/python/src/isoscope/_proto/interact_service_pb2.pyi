from google.protobuf import duration_pb2 as _duration_pb2
from isoscope._proto import geometry_pb2 as _geometry_pb2
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

class ExactDeferred(_message.Message):
    __slots__ = ["drawn_level", "expected_bytes", "expected_duration"]
    DRAWN_LEVEL_FIELD_NUMBER: _ClassVar[int]
    EXPECTED_BYTES_FIELD_NUMBER: _ClassVar[int]
    EXPECTED_DURATION_FIELD_NUMBER: _ClassVar[int]
    drawn_level: _isosurface_service_pb2.DrawnLevel
    expected_bytes: int
    expected_duration: _duration_pb2.Duration
    def __init__(self, expected_bytes: _Optional[int] = ..., expected_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., drawn_level: _Optional[_Union[_isosurface_service_pb2.DrawnLevel, _Mapping]] = ...) -> None: ...

class FocusPoint(_message.Message):
    __slots__ = ["x", "y"]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ...) -> None: ...

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
    __slots__ = ["depth_grid", "error", "exact_deferred", "frame", "frame_number", "is_exact", "sequence_number", "tile"]
    DEPTH_GRID_FIELD_NUMBER: _ClassVar[int]
    ERROR_FIELD_NUMBER: _ClassVar[int]
    EXACT_DEFERRED_FIELD_NUMBER: _ClassVar[int]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    FRAME_NUMBER_FIELD_NUMBER: _ClassVar[int]
    IS_EXACT_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_NUMBER_FIELD_NUMBER: _ClassVar[int]
    TILE_FIELD_NUMBER: _ClassVar[int]
    depth_grid: DepthGrid
    error: FrameError
    exact_deferred: ExactDeferred
    frame: _isosurface_service_pb2.RenderIsosurfaceResponse
    frame_number: int
    is_exact: bool
    sequence_number: int
    tile: Tile
    def __init__(self, sequence_number: _Optional[int] = ..., frame_number: _Optional[int] = ..., is_exact: bool = ..., frame: _Optional[_Union[_isosurface_service_pb2.RenderIsosurfaceResponse, _Mapping]] = ..., depth_grid: _Optional[_Union[DepthGrid, _Mapping]] = ..., error: _Optional[_Union[FrameError, _Mapping]] = ..., tile: _Optional[_Union[Tile, _Mapping]] = ..., exact_deferred: _Optional[_Union[ExactDeferred, _Mapping]] = ...) -> None: ...

class Refinement(_message.Message):
    __slots__ = ["coarse_levels", "focus", "max_exact_bytes", "max_exact_duration", "tiles"]
    COARSE_LEVELS_FIELD_NUMBER: _ClassVar[int]
    FOCUS_FIELD_NUMBER: _ClassVar[int]
    MAX_EXACT_BYTES_FIELD_NUMBER: _ClassVar[int]
    MAX_EXACT_DURATION_FIELD_NUMBER: _ClassVar[int]
    TILES_FIELD_NUMBER: _ClassVar[int]
    coarse_levels: bool
    focus: FocusPoint
    max_exact_bytes: int
    max_exact_duration: _duration_pb2.Duration
    tiles: bool
    def __init__(self, coarse_levels: bool = ..., tiles: bool = ..., focus: _Optional[_Union[FocusPoint, _Mapping]] = ..., max_exact_bytes: _Optional[int] = ..., max_exact_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ...) -> None: ...

class Tile(_message.Message):
    __slots__ = ["camera", "count", "drawn_level", "extent", "index", "png", "region"]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    DRAWN_LEVEL_FIELD_NUMBER: _ClassVar[int]
    EXTENT_FIELD_NUMBER: _ClassVar[int]
    INDEX_FIELD_NUMBER: _ClassVar[int]
    PNG_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    camera: _geometry_pb2.Camera
    count: int
    drawn_level: _isosurface_service_pb2.DrawnLevel
    extent: _geometry_pb2.Viewport
    index: int
    png: bytes
    region: _geometry_pb2.Region
    def __init__(self, region: _Optional[_Union[_geometry_pb2.Region, _Mapping]] = ..., png: _Optional[bytes] = ..., index: _Optional[int] = ..., count: _Optional[int] = ..., extent: _Optional[_Union[_geometry_pb2.Viewport, _Mapping]] = ..., camera: _Optional[_Union[_geometry_pb2.Camera, _Mapping]] = ..., drawn_level: _Optional[_Union[_isosurface_service_pb2.DrawnLevel, _Mapping]] = ...) -> None: ...

class ViewState(_message.Message):
    __slots__ = ["frame", "is_at_rest", "refinement", "sequence_number", "target_frames_per_second"]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    IS_AT_REST_FIELD_NUMBER: _ClassVar[int]
    REFINEMENT_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_NUMBER_FIELD_NUMBER: _ClassVar[int]
    TARGET_FRAMES_PER_SECOND_FIELD_NUMBER: _ClassVar[int]
    frame: _isosurface_service_pb2.RenderIsosurfaceRequest
    is_at_rest: bool
    refinement: Refinement
    sequence_number: int
    target_frames_per_second: float
    def __init__(self, sequence_number: _Optional[int] = ..., frame: _Optional[_Union[_isosurface_service_pb2.RenderIsosurfaceRequest, _Mapping]] = ..., target_frames_per_second: _Optional[float] = ..., is_at_rest: bool = ..., refinement: _Optional[_Union[Refinement, _Mapping]] = ...) -> None: ...
