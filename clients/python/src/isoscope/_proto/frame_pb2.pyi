from google.protobuf import duration_pb2 as _duration_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

CULLING_DEPTH: Culling
CULLING_MASK: Culling
CULLING_NONE: Culling
CULLING_UNSPECIFIED: Culling
DESCRIPTOR: _descriptor.FileDescriptor

class AgentStatistics(_message.Message):
    __slots__ = ["active_block_count", "agent_address", "busy_duration", "extract_duration", "index_page_read_count", "occluding_block_count", "read_bytes", "render_duration", "shard_indices", "surfaces", "triangle_count", "unique_vertex_count", "visible_block_count"]
    ACTIVE_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    AGENT_ADDRESS_FIELD_NUMBER: _ClassVar[int]
    BUSY_DURATION_FIELD_NUMBER: _ClassVar[int]
    EXTRACT_DURATION_FIELD_NUMBER: _ClassVar[int]
    INDEX_PAGE_READ_COUNT_FIELD_NUMBER: _ClassVar[int]
    OCCLUDING_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    READ_BYTES_FIELD_NUMBER: _ClassVar[int]
    RENDER_DURATION_FIELD_NUMBER: _ClassVar[int]
    SHARD_INDICES_FIELD_NUMBER: _ClassVar[int]
    SURFACES_FIELD_NUMBER: _ClassVar[int]
    TRIANGLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    UNIQUE_VERTEX_COUNT_FIELD_NUMBER: _ClassVar[int]
    VISIBLE_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    active_block_count: int
    agent_address: str
    busy_duration: _duration_pb2.Duration
    extract_duration: _duration_pb2.Duration
    index_page_read_count: int
    occluding_block_count: int
    read_bytes: int
    render_duration: _duration_pb2.Duration
    shard_indices: _containers.RepeatedScalarFieldContainer[int]
    surfaces: _containers.RepeatedCompositeFieldContainer[SurfaceStatistics]
    triangle_count: int
    unique_vertex_count: int
    visible_block_count: int
    def __init__(self, agent_address: _Optional[str] = ..., shard_indices: _Optional[_Iterable[int]] = ..., active_block_count: _Optional[int] = ..., occluding_block_count: _Optional[int] = ..., visible_block_count: _Optional[int] = ..., triangle_count: _Optional[int] = ..., unique_vertex_count: _Optional[int] = ..., read_bytes: _Optional[int] = ..., index_page_read_count: _Optional[int] = ..., extract_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., render_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., busy_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., surfaces: _Optional[_Iterable[_Union[SurfaceStatistics, _Mapping]]] = ...) -> None: ...

class RenderStatistics(_message.Message):
    __slots__ = ["active_block_count", "active_block_coverage", "agents", "band_count", "culled_block_count", "durations", "level", "missing_shards", "network_bytes", "occluding_block_count", "png_bytes", "ray_hit_block_count", "read_bytes", "surfaces", "triangle_count", "truncated_pixel_count", "unique_vertex_count", "unresolved_block_count", "visible_block_count"]
    ACTIVE_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    ACTIVE_BLOCK_COVERAGE_FIELD_NUMBER: _ClassVar[int]
    AGENTS_FIELD_NUMBER: _ClassVar[int]
    BAND_COUNT_FIELD_NUMBER: _ClassVar[int]
    CULLED_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    DURATIONS_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    MISSING_SHARDS_FIELD_NUMBER: _ClassVar[int]
    NETWORK_BYTES_FIELD_NUMBER: _ClassVar[int]
    OCCLUDING_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    PNG_BYTES_FIELD_NUMBER: _ClassVar[int]
    RAY_HIT_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    READ_BYTES_FIELD_NUMBER: _ClassVar[int]
    SURFACES_FIELD_NUMBER: _ClassVar[int]
    TRIANGLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    TRUNCATED_PIXEL_COUNT_FIELD_NUMBER: _ClassVar[int]
    UNIQUE_VERTEX_COUNT_FIELD_NUMBER: _ClassVar[int]
    UNRESOLVED_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    VISIBLE_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    active_block_count: int
    active_block_coverage: float
    agents: _containers.RepeatedCompositeFieldContainer[AgentStatistics]
    band_count: int
    culled_block_count: int
    durations: StepDurations
    level: int
    missing_shards: _containers.RepeatedScalarFieldContainer[int]
    network_bytes: int
    occluding_block_count: int
    png_bytes: int
    ray_hit_block_count: int
    read_bytes: int
    surfaces: _containers.RepeatedCompositeFieldContainer[SurfaceStatistics]
    triangle_count: int
    truncated_pixel_count: int
    unique_vertex_count: int
    unresolved_block_count: int
    visible_block_count: int
    def __init__(self, active_block_count: _Optional[int] = ..., ray_hit_block_count: _Optional[int] = ..., occluding_block_count: _Optional[int] = ..., visible_block_count: _Optional[int] = ..., culled_block_count: _Optional[int] = ..., triangle_count: _Optional[int] = ..., unique_vertex_count: _Optional[int] = ..., read_bytes: _Optional[int] = ..., network_bytes: _Optional[int] = ..., png_bytes: _Optional[int] = ..., durations: _Optional[_Union[StepDurations, _Mapping]] = ..., agents: _Optional[_Iterable[_Union[AgentStatistics, _Mapping]]] = ..., surfaces: _Optional[_Iterable[_Union[SurfaceStatistics, _Mapping]]] = ..., truncated_pixel_count: _Optional[int] = ..., missing_shards: _Optional[_Iterable[int]] = ..., active_block_coverage: _Optional[float] = ..., band_count: _Optional[int] = ..., level: _Optional[int] = ..., unresolved_block_count: _Optional[int] = ...) -> None: ...

class StepDurations(_message.Message):
    __slots__ = ["composite_duration", "encode_duration", "occluder_rendering_duration", "occluder_selection_duration", "visibility_culling_duration"]
    COMPOSITE_DURATION_FIELD_NUMBER: _ClassVar[int]
    ENCODE_DURATION_FIELD_NUMBER: _ClassVar[int]
    OCCLUDER_RENDERING_DURATION_FIELD_NUMBER: _ClassVar[int]
    OCCLUDER_SELECTION_DURATION_FIELD_NUMBER: _ClassVar[int]
    VISIBILITY_CULLING_DURATION_FIELD_NUMBER: _ClassVar[int]
    composite_duration: _duration_pb2.Duration
    encode_duration: _duration_pb2.Duration
    occluder_rendering_duration: _duration_pb2.Duration
    occluder_selection_duration: _duration_pb2.Duration
    visibility_culling_duration: _duration_pb2.Duration
    def __init__(self, occluder_selection_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., occluder_rendering_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., visibility_culling_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., composite_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ..., encode_duration: _Optional[_Union[_duration_pb2.Duration, _Mapping]] = ...) -> None: ...

class SurfaceStatistics(_message.Message):
    __slots__ = ["triangle_count", "unique_vertex_count"]
    TRIANGLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    UNIQUE_VERTEX_COUNT_FIELD_NUMBER: _ClassVar[int]
    triangle_count: int
    unique_vertex_count: int
    def __init__(self, triangle_count: _Optional[int] = ..., unique_vertex_count: _Optional[int] = ...) -> None: ...

class Culling(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = []
