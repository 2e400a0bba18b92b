from google.protobuf import duration_pb2 as _duration_pb2
from isoscope._proto import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class AgentLoad(_message.Message):
    __slots__ = ["busy_duration", "done_frame_count", "failed_frame_count", "memory_limit_bytes", "read_bytes", "resident_bytes", "triangle_count", "up_duration", "working_frame_count"]
    BUSY_DURATION_FIELD_NUMBER: _ClassVar[int]
    DONE_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    FAILED_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    MEMORY_LIMIT_BYTES_FIELD_NUMBER: _ClassVar[int]
    READ_BYTES_FIELD_NUMBER: _ClassVar[int]
    RESIDENT_BYTES_FIELD_NUMBER: _ClassVar[int]
    TRIANGLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    UP_DURATION_FIELD_NUMBER: _ClassVar[int]
    WORKING_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    busy_duration: _duration_pb2.Duration
    done_frame_count: int
    failed_frame_count: int
    memory_limit_bytes: int
    read_bytes: int
    resident_bytes: int
    triangle_count: int
    up_duration: _duration_pb2.Duration
    working_frame_count: int
    def __init__(self, up_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., working_frame_count: _Optional[int] = ..., done_frame_count: _Optional[int] = ..., failed_frame_count: _Optional[int] = ..., read_bytes: _Optional[int] = ..., triangle_count: _Optional[int] = ..., busy_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., resident_bytes: _Optional[int] = ..., memory_limit_bytes: _Optional[int] = ...) -> None: ...

class AgentStatus(_message.Message):
    __slots__ = ["address", "damaged_shards", "is_draining", "load", "message", "opening", "picture_revision", "renderer", "shards", "state", "version"]
    class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    ADDRESS_FIELD_NUMBER: _ClassVar[int]
    DAMAGED_SHARDS_FIELD_NUMBER: _ClassVar[int]
    IS_DRAINING_FIELD_NUMBER: _ClassVar[int]
    LOAD_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    OPENING_FIELD_NUMBER: _ClassVar[int]
    PICTURE_REVISION_FIELD_NUMBER: _ClassVar[int]
    RENDERER_FIELD_NUMBER: _ClassVar[int]
    SHARDS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    STATE_OPENING: AgentStatus.State
    STATE_REACHABLE: AgentStatus.State
    STATE_UNREACHABLE: AgentStatus.State
    STATE_UNSPECIFIED: AgentStatus.State
    VERSION_FIELD_NUMBER: _ClassVar[int]
    address: str
    damaged_shards: _containers.RepeatedCompositeFieldContainer[DamagedShard]
    is_draining: bool
    load: AgentLoad
    message: str
    opening: OpeningProgress
    picture_revision: str
    renderer: str
    shards: _containers.RepeatedCompositeFieldContainer[ServedShard]
    state: AgentStatus.State
    version: str
    def __init__(self, address: _Optional[str] = ..., state: _Optional[_Union[AgentStatus.State, str]] = ..., message: _Optional[str] = ..., version: _Optional[str] = ..., renderer: _Optional[str] = ..., shards: _Optional[_Iterable[_Union[ServedShard, _Mapping]]] = ..., picture_revision: _Optional[str] = ..., load: _Optional[_Union[AgentLoad, _Mapping]] = ..., is_draining: bool = ..., opening: _Optional[_Union[OpeningProgress, _Mapping]] = ..., damaged_shards: _Optional[_Iterable[_Union[DamagedShard, _Mapping]]] = ...) -> None: ...

class CoordinatorLoad(_message.Message):
    __slots__ = ["done_frame_count", "failed_frame_count", "memory_limit_bytes", "network_bytes", "queued_frame_count", "refused_frame_count", "resident_bytes", "up_duration", "working_frame_count"]
    DONE_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    FAILED_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    MEMORY_LIMIT_BYTES_FIELD_NUMBER: _ClassVar[int]
    NETWORK_BYTES_FIELD_NUMBER: _ClassVar[int]
    QUEUED_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    REFUSED_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    RESIDENT_BYTES_FIELD_NUMBER: _ClassVar[int]
    UP_DURATION_FIELD_NUMBER: _ClassVar[int]
    WORKING_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    done_frame_count: int
    failed_frame_count: int
    memory_limit_bytes: int
    network_bytes: int
    queued_frame_count: int
    refused_frame_count: int
    resident_bytes: int
    up_duration: _duration_pb2.Duration
    working_frame_count: int
    def __init__(self, up_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., working_frame_count: _Optional[int] = ..., queued_frame_count: _Optional[int] = ..., done_frame_count: _Optional[int] = ..., failed_frame_count: _Optional[int] = ..., refused_frame_count: _Optional[int] = ..., network_bytes: _Optional[int] = ..., resident_bytes: _Optional[int] = ..., memory_limit_bytes: _Optional[int] = ...) -> None: ...

class DamagedShard(_message.Message):
    __slots__ = ["dataset", "message", "shard_index"]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    SHARD_INDEX_FIELD_NUMBER: _ClassVar[int]
    dataset: str
    message: str
    shard_index: int
    def __init__(self, dataset: _Optional[str] = ..., shard_index: _Optional[int] = ..., message: _Optional[str] = ...) -> None: ...

class FrameInWork(_message.Message):
    __slots__ = ["age_duration", "client", "dataset", "extent", "request_id", "step"]
    class Step(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    AGE_DURATION_FIELD_NUMBER: _ClassVar[int]
    CLIENT_FIELD_NUMBER: _ClassVar[int]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    EXTENT_FIELD_NUMBER: _ClassVar[int]
    REQUEST_ID_FIELD_NUMBER: _ClassVar[int]
    STEP_FIELD_NUMBER: _ClassVar[int]
    STEP_FINISHING: FrameInWork.Step
    STEP_OCCLUDER_RENDERING: FrameInWork.Step
    STEP_OCCLUDER_SELECTION: FrameInWork.Step
    STEP_PREPARING: FrameInWork.Step
    STEP_QUEUED: FrameInWork.Step
    STEP_UNSPECIFIED: FrameInWork.Step
    STEP_VISIBILITY_CULLING: FrameInWork.Step
    age_duration: _duration_pb2.Duration
    client: str
    dataset: str
    extent: _geometry_pb2.Viewport
    request_id: str
    step: FrameInWork.Step
    def __init__(self, request_id: _Optional[str] = ..., client: _Optional[str] = ..., dataset: _Optional[str] = ..., extent: _Optional[_Union[_geometry_pb2.Viewport, _Mapping]] = ..., step: _Optional[_Union[FrameInWork.Step, str]] = ..., age_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ...) -> None: ...

class GetCapabilitiesRequest(_message.Message):
    __slots__ = []
    def __init__(self) -> None: ...

class GetCapabilitiesResponse(_message.Message):
    __slots__ = ["features", "gateway_address", "max_concurrent_frame_count", "max_frame_seconds", "max_message_bytes", "max_queued_frame_count", "max_viewport_px", "version"]
    FEATURES_FIELD_NUMBER: _ClassVar[int]
    GATEWAY_ADDRESS_FIELD_NUMBER: _ClassVar[int]
    MAX_CONCURRENT_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_FRAME_SECONDS_FIELD_NUMBER: _ClassVar[int]
    MAX_MESSAGE_BYTES_FIELD_NUMBER: _ClassVar[int]
    MAX_QUEUED_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_VIEWPORT_PX_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    features: _containers.RepeatedScalarFieldContainer[str]
    gateway_address: str
    max_concurrent_frame_count: int
    max_frame_seconds: float
    max_message_bytes: int
    max_queued_frame_count: int
    max_viewport_px: int
    version: str
    def __init__(self, version: _Optional[str] = ..., max_viewport_px: _Optional[int] = ..., max_concurrent_frame_count: _Optional[int] = ..., max_queued_frame_count: _Optional[int] = ..., max_message_bytes: _Optional[int] = ..., max_frame_seconds: _Optional[float] = ..., gateway_address: _Optional[str] = ..., features: _Optional[_Iterable[str]] = ...) -> None: ...

class GetClusterStatusRequest(_message.Message):
    __slots__ = ["page_size", "page_token"]
    PAGE_SIZE_FIELD_NUMBER: _ClassVar[int]
    PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    page_size: int
    page_token: str
    def __init__(self, page_size: _Optional[int] = ..., page_token: _Optional[str] = ...) -> None: ...

class GetClusterStatusResponse(_message.Message):
    __slots__ = ["agents", "frames", "load", "next_page_token"]
    AGENTS_FIELD_NUMBER: _ClassVar[int]
    FRAMES_FIELD_NUMBER: _ClassVar[int]
    LOAD_FIELD_NUMBER: _ClassVar[int]
    NEXT_PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    agents: _containers.RepeatedCompositeFieldContainer[AgentStatus]
    frames: _containers.RepeatedCompositeFieldContainer[FrameInWork]
    load: CoordinatorLoad
    next_page_token: str
    def __init__(self, agents: _Optional[_Iterable[_Union[AgentStatus, _Mapping]]] = ..., load: _Optional[_Union[CoordinatorLoad, _Mapping]] = ..., frames: _Optional[_Iterable[_Union[FrameInWork, _Mapping]]] = ..., next_page_token: _Optional[str] = ...) -> None: ...

class OpeningProgress(_message.Message):
    __slots__ = ["open_shard_count", "read_bytes", "shard_count", "table_bytes"]
    OPEN_SHARD_COUNT_FIELD_NUMBER: _ClassVar[int]
    READ_BYTES_FIELD_NUMBER: _ClassVar[int]
    SHARD_COUNT_FIELD_NUMBER: _ClassVar[int]
    TABLE_BYTES_FIELD_NUMBER: _ClassVar[int]
    open_shard_count: int
    read_bytes: int
    shard_count: int
    table_bytes: int
    def __init__(self, shard_count: _Optional[int] = ..., open_shard_count: _Optional[int] = ..., table_bytes: _Optional[int] = ..., read_bytes: _Optional[int] = ...) -> None: ...

class ServedShard(_message.Message):
    __slots__ = ["block_count", "dataset", "dataset_id", "shard_index"]
    BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    DATASET_ID_FIELD_NUMBER: _ClassVar[int]
    SHARD_INDEX_FIELD_NUMBER: _ClassVar[int]
    block_count: int
    dataset: str
    dataset_id: str
    shard_index: int
    def __init__(self, dataset: _Optional[str] = ..., dataset_id: _Optional[str] = ..., shard_index: _Optional[int] = ..., block_count: _Optional[int] = ...) -> None: ...
