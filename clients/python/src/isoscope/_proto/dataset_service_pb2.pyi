from isoscope._proto import dataset_pb2 as _dataset_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class GetDatasetRequest(_message.Message):
    __slots__ = ["name"]
    NAME_FIELD_NUMBER: _ClassVar[int]
    name: str
    def __init__(self, name: _Optional[str] = ...) -> None: ...

class GetDatasetResponse(_message.Message):
    __slots__ = ["dataset", "picture_revision"]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    PICTURE_REVISION_FIELD_NUMBER: _ClassVar[int]
    dataset: _dataset_pb2.Dataset
    picture_revision: str
    def __init__(self, dataset: _Optional[_Union[_dataset_pb2.Dataset, _Mapping]] = ..., picture_revision: _Optional[str] = ...) -> None: ...

class GetHistogramRequest(_message.Message):
    __slots__ = ["dataset", "dataset_id", "max_bin_count", "max_label_value_count", "selection", "value_range"]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    DATASET_ID_FIELD_NUMBER: _ClassVar[int]
    MAX_BIN_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_LABEL_VALUE_COUNT_FIELD_NUMBER: _ClassVar[int]
    SELECTION_FIELD_NUMBER: _ClassVar[int]
    VALUE_RANGE_FIELD_NUMBER: _ClassVar[int]
    dataset: str
    dataset_id: str
    max_bin_count: int
    max_label_value_count: int
    selection: _dataset_pb2.FieldSelection
    value_range: _dataset_pb2.ValueRange
    def __init__(self, dataset: _Optional[str] = ..., max_bin_count: _Optional[int] = ..., value_range: _Optional[_Union[_dataset_pb2.ValueRange, _Mapping]] = ..., dataset_id: _Optional[str] = ..., selection: _Optional[_Union[_dataset_pb2.FieldSelection, _Mapping]] = ..., max_label_value_count: _Optional[int] = ...) -> None: ...

class GetHistogramResponse(_message.Message):
    __slots__ = ["bins", "has_sample_counts", "label_values", "nan_count", "negative_infinity_count", "positive_infinity_count", "selection", "suggested_labels", "suggestions"]
    BINS_FIELD_NUMBER: _ClassVar[int]
    HAS_SAMPLE_COUNTS_FIELD_NUMBER: _ClassVar[int]
    LABEL_VALUES_FIELD_NUMBER: _ClassVar[int]
    NAN_COUNT_FIELD_NUMBER: _ClassVar[int]
    NEGATIVE_INFINITY_COUNT_FIELD_NUMBER: _ClassVar[int]
    POSITIVE_INFINITY_COUNT_FIELD_NUMBER: _ClassVar[int]
    SELECTION_FIELD_NUMBER: _ClassVar[int]
    SUGGESTED_LABELS_FIELD_NUMBER: _ClassVar[int]
    SUGGESTIONS_FIELD_NUMBER: _ClassVar[int]
    bins: _containers.RepeatedCompositeFieldContainer[HistogramBin]
    has_sample_counts: bool
    label_values: LabelValues
    nan_count: int
    negative_infinity_count: int
    positive_infinity_count: int
    selection: _dataset_pb2.FieldSelection
    suggested_labels: _containers.RepeatedScalarFieldContainer[float]
    suggestions: _containers.RepeatedCompositeFieldContainer[IsovalueSuggestion]
    def __init__(self, bins: _Optional[_Iterable[_Union[HistogramBin, _Mapping]]] = ..., has_sample_counts: bool = ..., nan_count: _Optional[int] = ..., negative_infinity_count: _Optional[int] = ..., positive_infinity_count: _Optional[int] = ..., suggestions: _Optional[_Iterable[_Union[IsovalueSuggestion, _Mapping]]] = ..., selection: _Optional[_Union[_dataset_pb2.FieldSelection, _Mapping]] = ..., label_values: _Optional[_Union[LabelValues, _Mapping]] = ..., suggested_labels: _Optional[_Iterable[float]] = ...) -> None: ...

class HistogramBin(_message.Message):
    __slots__ = ["active_block_bytes", "active_block_count", "estimated_triangle_count", "max", "min", "sample_count"]
    ACTIVE_BLOCK_BYTES_FIELD_NUMBER: _ClassVar[int]
    ACTIVE_BLOCK_COUNT_FIELD_NUMBER: _ClassVar[int]
    ESTIMATED_TRIANGLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_FIELD_NUMBER: _ClassVar[int]
    MIN_FIELD_NUMBER: _ClassVar[int]
    SAMPLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    active_block_bytes: int
    active_block_count: int
    estimated_triangle_count: int
    max: float
    min: float
    sample_count: int
    def __init__(self, min: _Optional[float] = ..., max: _Optional[float] = ..., sample_count: _Optional[int] = ..., active_block_count: _Optional[int] = ..., active_block_bytes: _Optional[int] = ..., estimated_triangle_count: _Optional[int] = ...) -> None: ...

class IsovalueSuggestion(_message.Message):
    __slots__ = ["inside_fraction", "isovalue", "method"]
    class Method(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    INSIDE_FRACTION_FIELD_NUMBER: _ClassVar[int]
    ISOVALUE_FIELD_NUMBER: _ClassVar[int]
    METHOD_BETWEEN_CLASSES: IsovalueSuggestion.Method
    METHOD_FIELD_NUMBER: _ClassVar[int]
    METHOD_ONE_PERCENT: IsovalueSuggestion.Method
    METHOD_UNSPECIFIED: IsovalueSuggestion.Method
    inside_fraction: float
    isovalue: float
    method: IsovalueSuggestion.Method
    def __init__(self, method: _Optional[_Union[IsovalueSuggestion.Method, str]] = ..., isovalue: _Optional[float] = ..., inside_fraction: _Optional[float] = ...) -> None: ...

class LabelValues(_message.Message):
    __slots__ = ["has_more", "other_value", "values"]
    HAS_MORE_FIELD_NUMBER: _ClassVar[int]
    OTHER_VALUE_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    has_more: bool
    other_value: float
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, values: _Optional[_Iterable[float]] = ..., has_more: bool = ..., other_value: _Optional[float] = ...) -> None: ...

class ListDatasetsRequest(_message.Message):
    __slots__ = ["page_size", "page_token"]
    PAGE_SIZE_FIELD_NUMBER: _ClassVar[int]
    PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    page_size: int
    page_token: str
    def __init__(self, page_size: _Optional[int] = ..., page_token: _Optional[str] = ...) -> None: ...

class ListDatasetsResponse(_message.Message):
    __slots__ = ["datasets", "next_page_token"]
    DATASETS_FIELD_NUMBER: _ClassVar[int]
    NEXT_PAGE_TOKEN_FIELD_NUMBER: _ClassVar[int]
    datasets: _containers.RepeatedCompositeFieldContainer[_dataset_pb2.Dataset]
    next_page_token: str
    def __init__(self, datasets: _Optional[_Iterable[_Union[_dataset_pb2.Dataset, _Mapping]]] = ..., next_page_token: _Optional[str] = ...) -> None: ...
