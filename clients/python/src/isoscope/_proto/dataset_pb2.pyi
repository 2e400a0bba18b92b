from isoscope._proto import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor
SAMPLE_TYPE_FLOAT32: SampleType
SAMPLE_TYPE_FLOAT64: SampleType
SAMPLE_TYPE_INT16: SampleType
SAMPLE_TYPE_INT32: SampleType
SAMPLE_TYPE_INT8: SampleType
SAMPLE_TYPE_UINT16: SampleType
SAMPLE_TYPE_UINT32: SampleType
SAMPLE_TYPE_UINT8: SampleType
SAMPLE_TYPE_UNSPECIFIED: SampleType

class Dataset(_message.Message):
    __slots__ = ["block_cells", "block_count", "dataset_id", "fields", "finite_range", "geometry", "labels", "length_unit", "levels", "max_gradient_magnitude", "missing_shards", "name", "patient_frame", "sample_type", "samples_digest", "shard_count", "source", "time_steps", "time_unit", "value_range"]
    BLOCK_CELLS_FIELD_NUMBER: _ClassVar[int]
    BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    DATASET_ID_FIELD_NUMBER: _ClassVar[int]
    FIELDS_FIELD_NUMBER: _ClassVar[int]
    FINITE_RANGE_FIELD_NUMBER: _ClassVar[int]
    GEOMETRY_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    LENGTH_UNIT_FIELD_NUMBER: _ClassVar[int]
    LEVELS_FIELD_NUMBER: _ClassVar[int]
    MAX_GRADIENT_MAGNITUDE_FIELD_NUMBER: _ClassVar[int]
    MISSING_SHARDS_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    PATIENT_FRAME_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_DIGEST_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_TYPE_FIELD_NUMBER: _ClassVar[int]
    SHARD_COUNT_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    TIME_STEPS_FIELD_NUMBER: _ClassVar[int]
    TIME_UNIT_FIELD_NUMBER: _ClassVar[int]
    VALUE_RANGE_FIELD_NUMBER: _ClassVar[int]
    block_cells: Dimensions
    block_count: int
    dataset_id: str
    fields: _containers.RepeatedCompositeFieldContainer[Field]
    finite_range: ValueRange
    geometry: GridGeometry
    labels: _containers.RepeatedCompositeFieldContainer[Label]
    length_unit: str
    levels: _containers.RepeatedCompositeFieldContainer[DatasetLevel]
    max_gradient_magnitude: float
    missing_shards: _containers.RepeatedScalarFieldContainer[int]
    name: str
    patient_frame: str
    sample_type: SampleType
    samples_digest: str
    shard_count: int
    source: str
    time_steps: _containers.RepeatedCompositeFieldContainer[TimeStep]
    time_unit: str
    value_range: ValueRange
    def __init__(self, name: _Optional[str] = ..., dataset_id: _Optional[str] = ..., source: _Optional[str] = ..., geometry: _Optional[_Union[GridGeometry, _Mapping]] = ..., sample_type: _Optional[_Union[SampleType, str]] = ..., value_range: _Optional[_Union[ValueRange, _Mapping]] = ..., block_cells: _Optional[_Union[Dimensions, _Mapping]] = ..., block_count: _Optional[int] = ..., shard_count: _Optional[int] = ..., missing_shards: _Optional[_Iterable[int]] = ..., samples_digest: _Optional[str] = ..., patient_frame: _Optional[str] = ..., max_gradient_magnitude: _Optional[float] = ..., fields: _Optional[_Iterable[_Union[Field, _Mapping]]] = ..., time_steps: _Optional[_Iterable[_Union[TimeStep, _Mapping]]] = ..., time_unit: _Optional[str] = ..., length_unit: _Optional[str] = ..., labels: _Optional[_Iterable[_Union[Label, _Mapping]]] = ..., finite_range: _Optional[_Union[ValueRange, _Mapping]] = ..., levels: _Optional[_Iterable[_Union[DatasetLevel, _Mapping]]] = ...) -> None: ...

class DatasetLevel(_message.Message):
    __slots__ = ["block_count", "filter", "geometry", "level"]
    class Filter(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    FILTER_FIELD_NUMBER: _ClassVar[int]
    FILTER_MAJORITY: DatasetLevel.Filter
    FILTER_MEAN: DatasetLevel.Filter
    FILTER_UNSPECIFIED: DatasetLevel.Filter
    GEOMETRY_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    block_count: int
    filter: DatasetLevel.Filter
    geometry: GridGeometry
    level: int
    def __init__(self, level: _Optional[int] = ..., geometry: _Optional[_Union[GridGeometry, _Mapping]] = ..., block_count: _Optional[int] = ..., filter: _Optional[_Union[DatasetLevel.Filter, str]] = ...) -> None: ...

class Dimensions(_message.Message):
    __slots__ = ["x", "y", "z"]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: int
    y: int
    z: int
    def __init__(self, x: _Optional[int] = ..., y: _Optional[int] = ..., z: _Optional[int] = ...) -> None: ...

class Field(_message.Message):
    __slots__ = ["components", "long_name", "name", "time_steps", "unit"]
    COMPONENTS_FIELD_NUMBER: _ClassVar[int]
    LONG_NAME_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    TIME_STEPS_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    components: _containers.RepeatedCompositeFieldContainer[FieldComponent]
    long_name: str
    name: str
    time_steps: _containers.RepeatedScalarFieldContainer[int]
    unit: str
    def __init__(self, name: _Optional[str] = ..., long_name: _Optional[str] = ..., unit: _Optional[str] = ..., components: _Optional[_Iterable[_Union[FieldComponent, _Mapping]]] = ..., time_steps: _Optional[_Iterable[int]] = ...) -> None: ...

class FieldComponent(_message.Message):
    __slots__ = ["finite_range", "max_gradient_magnitude", "name", "sample_type", "value_range"]
    FINITE_RANGE_FIELD_NUMBER: _ClassVar[int]
    MAX_GRADIENT_MAGNITUDE_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_TYPE_FIELD_NUMBER: _ClassVar[int]
    VALUE_RANGE_FIELD_NUMBER: _ClassVar[int]
    finite_range: ValueRange
    max_gradient_magnitude: float
    name: str
    sample_type: SampleType
    value_range: ValueRange
    def __init__(self, name: _Optional[str] = ..., sample_type: _Optional[_Union[SampleType, str]] = ..., value_range: _Optional[_Union[ValueRange, _Mapping]] = ..., max_gradient_magnitude: _Optional[float] = ..., finite_range: _Optional[_Union[ValueRange, _Mapping]] = ...) -> None: ...

class FieldSelection(_message.Message):
    __slots__ = ["component", "field", "time", "time_step"]
    COMPONENT_FIELD_NUMBER: _ClassVar[int]
    FIELD_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    TIME_STEP_FIELD_NUMBER: _ClassVar[int]
    component: str
    field: str
    time: float
    time_step: int
    def __init__(self, field: _Optional[str] = ..., component: _Optional[str] = ..., time_step: _Optional[int] = ..., time: _Optional[float] = ...) -> None: ...

class GridGeometry(_message.Message):
    __slots__ = ["direction_columns", "origin", "sample_dims", "spacing"]
    DIRECTION_COLUMNS_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_DIMS_FIELD_NUMBER: _ClassVar[int]
    SPACING_FIELD_NUMBER: _ClassVar[int]
    direction_columns: _containers.RepeatedCompositeFieldContainer[_geometry_pb2.Vec3]
    origin: _geometry_pb2.Vec3
    sample_dims: Dimensions
    spacing: _geometry_pb2.Vec3
    def __init__(self, sample_dims: _Optional[_Union[Dimensions, _Mapping]] = ..., spacing: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ..., origin: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ..., direction_columns: _Optional[_Iterable[_Union[_geometry_pb2.Vec3, _Mapping]]] = ...) -> None: ...

class Label(_message.Message):
    __slots__ = ["color", "name", "value"]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    color: _geometry_pb2.Color
    name: str
    value: float
    def __init__(self, value: _Optional[float] = ..., name: _Optional[str] = ..., color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ...) -> None: ...

class TimeStep(_message.Message):
    __slots__ = ["number", "value", "volumes_digest"]
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    VOLUMES_DIGEST_FIELD_NUMBER: _ClassVar[int]
    number: int
    value: float
    volumes_digest: str
    def __init__(self, value: _Optional[float] = ..., number: _Optional[int] = ..., volumes_digest: _Optional[str] = ...) -> None: ...

class ValueRange(_message.Message):
    __slots__ = ["max", "min"]
    MAX_FIELD_NUMBER: _ClassVar[int]
    MIN_FIELD_NUMBER: _ClassVar[int]
    max: float
    min: float
    def __init__(self, min: _Optional[float] = ..., max: _Optional[float] = ...) -> None: ...

class SampleType(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = []
