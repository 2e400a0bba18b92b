from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class AgentStatus(_message.Message):
    __slots__ = ["address", "message", "picture_revision", "renderer", "shards", "state", "version"]
    class State(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    ADDRESS_FIELD_NUMBER: _ClassVar[int]
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    PICTURE_REVISION_FIELD_NUMBER: _ClassVar[int]
    RENDERER_FIELD_NUMBER: _ClassVar[int]
    SHARDS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    STATE_REACHABLE: AgentStatus.State
    STATE_UNREACHABLE: AgentStatus.State
    STATE_UNSPECIFIED: AgentStatus.State
    VERSION_FIELD_NUMBER: _ClassVar[int]
    address: str
    message: str
    picture_revision: str
    renderer: str
    shards: _containers.RepeatedCompositeFieldContainer[ServedShard]
    state: AgentStatus.State
    version: str
    def __init__(self, address: _Optional[str] = ..., state: _Optional[_Union[AgentStatus.State, str]] = ..., message: _Optional[str] = ..., version: _Optional[str] = ..., renderer: _Optional[str] = ..., shards: _Optional[_Iterable[_Union[ServedShard, _Mapping]]] = ..., picture_revision: _Optional[str] = ...) -> None: ...

class GetCapabilitiesRequest(_message.Message):
    __slots__ = []
    def __init__(self) -> None: ...

class GetCapabilitiesResponse(_message.Message):
    __slots__ = ["gateway_address", "max_concurrent_frame_count", "max_frame_seconds", "max_message_bytes", "max_queued_frame_count", "max_viewport_px", "version"]
    GATEWAY_ADDRESS_FIELD_NUMBER: _ClassVar[int]
    MAX_CONCURRENT_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_FRAME_SECONDS_FIELD_NUMBER: _ClassVar[int]
    MAX_MESSAGE_BYTES_FIELD_NUMBER: _ClassVar[int]
    MAX_QUEUED_FRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_VIEWPORT_PX_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    gateway_address: str
    max_concurrent_frame_count: int
    max_frame_seconds: float
    max_message_bytes: int
    max_queued_frame_count: int
    max_viewport_px: int
    version: str
    def __init__(self, version: _Optional[str] = ..., max_viewport_px: _Optional[int] = ..., max_concurrent_frame_count: _Optional[int] = ..., max_queued_frame_count: _Optional[int] = ..., max_message_bytes: _Optional[int] = ..., max_frame_seconds: _Optional[float] = ..., gateway_address: _Optional[str] = ...) -> None: ...

class GetClusterStatusRequest(_message.Message):
    __slots__ = []
    def __init__(self) -> None: ...

class GetClusterStatusResponse(_message.Message):
    __slots__ = ["agents"]
    AGENTS_FIELD_NUMBER: _ClassVar[int]
    agents: _containers.RepeatedCompositeFieldContainer[AgentStatus]
    def __init__(self, agents: _Optional[_Iterable[_Union[AgentStatus, _Mapping]]] = ...) -> None: ...

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
