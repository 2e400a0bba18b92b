from isoscope._proto import dataset_pb2 as _dataset_pb2
from isoscope._proto import frame_pb2 as _frame_pb2
from isoscope._proto import geometry_pb2 as _geometry_pb2
from isoscope._proto import options_pb2 as _options_pb2
from isoscope._proto import trace_pb2 as _trace_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from typing import ClassVar as _ClassVar, Iterable as _Iterable, Mapping as _Mapping, Optional as _Optional, Union as _Union

CAMERA_FIT_CELLS: CameraFit
CAMERA_FIT_SURFACE: CameraFit
CAMERA_FIT_UNSPECIFIED: CameraFit
CAMERA_FIT_VOLUME: CameraFit
COLOR_MAP_CIVIDIS: ColorMap
COLOR_MAP_COOL_WARM: ColorMap
COLOR_MAP_GREY: ColorMap
COLOR_MAP_MAGMA: ColorMap
COLOR_MAP_TURBO: ColorMap
COLOR_MAP_UNSPECIFIED: ColorMap
COLOR_MAP_VIRIDIS: ColorMap
DESCRIPTOR: _descriptor.FileDescriptor

class AmbientOcclusion(_message.Message):
    __slots__ = ["radius_px", "strength"]
    RADIUS_PX_FIELD_NUMBER: _ClassVar[int]
    STRENGTH_FIELD_NUMBER: _ClassVar[int]
    radius_px: int
    strength: float
    def __init__(self, radius_px: _Optional[int] = ..., strength: _Optional[float] = ...) -> None: ...

class CapsColoring(_message.Message):
    __slots__ = ["caps", "nan_color", "shows_nan"]
    CAPS_FIELD_NUMBER: _ClassVar[int]
    NAN_COLOR_FIELD_NUMBER: _ClassVar[int]
    SHOWS_NAN_FIELD_NUMBER: _ClassVar[int]
    caps: ClipCaps
    nan_color: _geometry_pb2.Color
    shows_nan: bool
    def __init__(self, caps: _Optional[_Union[ClipCaps, _Mapping]] = ..., nan_color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ..., shows_nan: bool = ...) -> None: ...

class ClipCaps(_message.Message):
    __slots__ = ["color_map", "range"]
    COLOR_MAP_FIELD_NUMBER: _ClassVar[int]
    RANGE_FIELD_NUMBER: _ClassVar[int]
    color_map: ColorMap
    range: ColorRange
    def __init__(self, color_map: _Optional[_Union[ColorMap, str]] = ..., range: _Optional[_Union[ColorRange, _Mapping]] = ...) -> None: ...

class ClipRegion(_message.Message):
    __slots__ = ["box", "half_spaces"]
    BOX_FIELD_NUMBER: _ClassVar[int]
    HALF_SPACES_FIELD_NUMBER: _ClassVar[int]
    box: _geometry_pb2.Box
    half_spaces: _containers.RepeatedCompositeFieldContainer[HalfSpace]
    def __init__(self, half_spaces: _Optional[_Iterable[_Union[HalfSpace, _Mapping]]] = ..., box: _Optional[_Union[_geometry_pb2.Box, _Mapping]] = ...) -> None: ...

class ColorBy(_message.Message):
    __slots__ = ["color_map", "component", "field", "opacity", "quantity", "range"]
    class Quantity(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    COLOR_MAP_FIELD_NUMBER: _ClassVar[int]
    COMPONENT_FIELD_NUMBER: _ClassVar[int]
    FIELD_FIELD_NUMBER: _ClassVar[int]
    OPACITY_FIELD_NUMBER: _ClassVar[int]
    QUANTITY_FIELD: ColorBy.Quantity
    QUANTITY_FIELD_NUMBER: _ClassVar[int]
    QUANTITY_GRADIENT_MAGNITUDE: ColorBy.Quantity
    QUANTITY_NORMAL: ColorBy.Quantity
    QUANTITY_POSITION_X: ColorBy.Quantity
    QUANTITY_POSITION_Y: ColorBy.Quantity
    QUANTITY_POSITION_Z: ColorBy.Quantity
    QUANTITY_UNSPECIFIED: ColorBy.Quantity
    RANGE_FIELD_NUMBER: _ClassVar[int]
    color_map: ColorMap
    component: str
    field: str
    opacity: MapOpacity
    quantity: ColorBy.Quantity
    range: ColorRange
    def __init__(self, quantity: _Optional[_Union[ColorBy.Quantity, str]] = ..., color_map: _Optional[_Union[ColorMap, str]] = ..., range: _Optional[_Union[ColorRange, _Mapping]] = ..., opacity: _Optional[_Union[MapOpacity, _Mapping]] = ..., field: _Optional[str] = ..., component: _Optional[str] = ...) -> None: ...

class ColorRange(_message.Message):
    __slots__ = ["max", "min", "percentiles", "source"]
    class Source(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    MAX_FIELD_NUMBER: _ClassVar[int]
    MIN_FIELD_NUMBER: _ClassVar[int]
    PERCENTILES_FIELD_NUMBER: _ClassVar[int]
    SOURCE_FIELD_NUMBER: _ClassVar[int]
    SOURCE_STEP: ColorRange.Source
    SOURCE_UNSPECIFIED: ColorRange.Source
    SOURCE_VISIBLE: ColorRange.Source
    max: float
    min: float
    percentiles: Percentiles
    source: ColorRange.Source
    def __init__(self, min: _Optional[float] = ..., max: _Optional[float] = ..., source: _Optional[_Union[ColorRange.Source, str]] = ..., percentiles: _Optional[_Union[Percentiles, _Mapping]] = ...) -> None: ...

class DrawnLevel(_message.Message):
    __slots__ = ["level", "max_spacing_px", "spacing"]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    MAX_SPACING_PX_FIELD_NUMBER: _ClassVar[int]
    SPACING_FIELD_NUMBER: _ClassVar[int]
    level: int
    max_spacing_px: float
    spacing: _geometry_pb2.Vec3
    def __init__(self, level: _Optional[int] = ..., max_spacing_px: _Optional[float] = ..., spacing: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ...) -> None: ...

class ExportIsosurfaceRequest(_message.Message):
    __slots__ = ["clip", "closes", "dataset", "dataset_id", "isovalue", "level", "selection", "surfaces", "with_measures", "with_origin", "without_mesh"]
    CLIP_FIELD_NUMBER: _ClassVar[int]
    CLOSES_FIELD_NUMBER: _ClassVar[int]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    DATASET_ID_FIELD_NUMBER: _ClassVar[int]
    ISOVALUE_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    SELECTION_FIELD_NUMBER: _ClassVar[int]
    SURFACES_FIELD_NUMBER: _ClassVar[int]
    WITHOUT_MESH_FIELD_NUMBER: _ClassVar[int]
    WITH_MEASURES_FIELD_NUMBER: _ClassVar[int]
    WITH_ORIGIN_FIELD_NUMBER: _ClassVar[int]
    clip: ClipRegion
    closes: bool
    dataset: str
    dataset_id: str
    isovalue: float
    level: int
    selection: _dataset_pb2.FieldSelection
    surfaces: _containers.RepeatedCompositeFieldContainer[Surface]
    with_measures: bool
    with_origin: bool
    without_mesh: bool
    def __init__(self, dataset: _Optional[str] = ..., isovalue: _Optional[float] = ..., surfaces: _Optional[_Iterable[_Union[Surface, _Mapping]]] = ..., clip: _Optional[_Union[ClipRegion, _Mapping]] = ..., dataset_id: _Optional[str] = ..., selection: _Optional[_Union[_dataset_pb2.FieldSelection, _Mapping]] = ..., closes: bool = ..., with_origin: bool = ..., with_measures: bool = ..., without_mesh: bool = ..., level: _Optional[int] = ...) -> None: ...

class ExportIsosurfaceResponse(_message.Message):
    __slots__ = ["measures", "normals", "origin", "positions", "surface_index", "triangles"]
    MEASURES_FIELD_NUMBER: _ClassVar[int]
    NORMALS_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_FIELD_NUMBER: _ClassVar[int]
    POSITIONS_FIELD_NUMBER: _ClassVar[int]
    SURFACE_INDEX_FIELD_NUMBER: _ClassVar[int]
    TRIANGLES_FIELD_NUMBER: _ClassVar[int]
    measures: SurfaceMeasures
    normals: bytes
    origin: _geometry_pb2.Vec3
    positions: bytes
    surface_index: int
    triangles: bytes
    def __init__(self, positions: _Optional[bytes] = ..., normals: _Optional[bytes] = ..., triangles: _Optional[bytes] = ..., surface_index: _Optional[int] = ..., origin: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ..., measures: _Optional[_Union[SurfaceMeasures, _Mapping]] = ...) -> None: ...

class FieldValue(_message.Message):
    __slots__ = ["component", "field", "unit", "value"]
    COMPONENT_FIELD_NUMBER: _ClassVar[int]
    FIELD_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    VALUE_FIELD_NUMBER: _ClassVar[int]
    component: str
    field: str
    unit: str
    value: float
    def __init__(self, field: _Optional[str] = ..., component: _Optional[str] = ..., unit: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...

class HalfSpace(_message.Message):
    __slots__ = ["normal", "offset"]
    NORMAL_FIELD_NUMBER: _ClassVar[int]
    OFFSET_FIELD_NUMBER: _ClassVar[int]
    normal: _geometry_pb2.Vec3
    offset: float
    def __init__(self, normal: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ..., offset: _Optional[float] = ...) -> None: ...

class LevelChoice(_message.Message):
    __slots__ = ["level", "max_spacing_px"]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    MAX_SPACING_PX_FIELD_NUMBER: _ClassVar[int]
    level: int
    max_spacing_px: float
    def __init__(self, level: _Optional[int] = ..., max_spacing_px: _Optional[float] = ...) -> None: ...

class Light(_message.Message):
    __slots__ = ["color", "direction", "intensity", "space"]
    class Space(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    COLOR_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    INTENSITY_FIELD_NUMBER: _ClassVar[int]
    SPACE_FIELD_NUMBER: _ClassVar[int]
    SPACE_UNSPECIFIED: Light.Space
    SPACE_VIEW: Light.Space
    SPACE_WORLD: Light.Space
    color: _geometry_pb2.Color
    direction: _geometry_pb2.Vec3
    intensity: float
    space: Light.Space
    def __init__(self, direction: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ..., space: _Optional[_Union[Light.Space, str]] = ..., intensity: _Optional[float] = ..., color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ...) -> None: ...

class MapOpacity(_message.Message):
    __slots__ = ["at_max", "at_min"]
    AT_MAX_FIELD_NUMBER: _ClassVar[int]
    AT_MIN_FIELD_NUMBER: _ClassVar[int]
    at_max: float
    at_min: float
    def __init__(self, at_min: _Optional[float] = ..., at_max: _Optional[float] = ...) -> None: ...

class Material(_message.Message):
    __slots__ = ["ambient", "diffuse", "shininess", "specular"]
    AMBIENT_FIELD_NUMBER: _ClassVar[int]
    DIFFUSE_FIELD_NUMBER: _ClassVar[int]
    SHININESS_FIELD_NUMBER: _ClassVar[int]
    SPECULAR_FIELD_NUMBER: _ClassVar[int]
    ambient: float
    diffuse: float
    shininess: float
    specular: float
    def __init__(self, ambient: _Optional[float] = ..., diffuse: _Optional[float] = ..., specular: _Optional[float] = ..., shininess: _Optional[float] = ...) -> None: ...

class OutputOptions(_message.Message):
    __slots__ = ["depth", "depth_bounds", "image_format", "jpeg_quality", "normal", "position", "surface_index"]
    class ImageFormat(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    DEPTH_BOUNDS_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FORMAT_FIELD_NUMBER: _ClassVar[int]
    IMAGE_FORMAT_JPEG: OutputOptions.ImageFormat
    IMAGE_FORMAT_NONE: OutputOptions.ImageFormat
    IMAGE_FORMAT_PNG: OutputOptions.ImageFormat
    IMAGE_FORMAT_RGBA8: OutputOptions.ImageFormat
    IMAGE_FORMAT_UNSPECIFIED: OutputOptions.ImageFormat
    JPEG_QUALITY_FIELD_NUMBER: _ClassVar[int]
    NORMAL_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    SURFACE_INDEX_FIELD_NUMBER: _ClassVar[int]
    depth: bool
    depth_bounds: bool
    image_format: OutputOptions.ImageFormat
    jpeg_quality: int
    normal: bool
    position: bool
    surface_index: bool
    def __init__(self, image_format: _Optional[_Union[OutputOptions.ImageFormat, str]] = ..., jpeg_quality: _Optional[int] = ..., depth: bool = ..., surface_index: bool = ..., position: bool = ..., normal: bool = ..., depth_bounds: bool = ...) -> None: ...

class Percentiles(_message.Message):
    __slots__ = ["high", "low"]
    HIGH_FIELD_NUMBER: _ClassVar[int]
    LOW_FIELD_NUMBER: _ClassVar[int]
    high: float
    low: float
    def __init__(self, low: _Optional[float] = ..., high: _Optional[float] = ...) -> None: ...

class PickSurfaceRequest(_message.Message):
    __slots__ = ["frame", "pixels", "with_field_values"]
    FRAME_FIELD_NUMBER: _ClassVar[int]
    PIXELS_FIELD_NUMBER: _ClassVar[int]
    WITH_FIELD_VALUES_FIELD_NUMBER: _ClassVar[int]
    frame: RenderIsosurfaceRequest
    pixels: _containers.RepeatedCompositeFieldContainer[Pixel]
    with_field_values: bool
    def __init__(self, frame: _Optional[_Union[RenderIsosurfaceRequest, _Mapping]] = ..., pixels: _Optional[_Iterable[_Union[Pixel, _Mapping]]] = ..., with_field_values: bool = ...) -> None: ...

class PickSurfaceResponse(_message.Message):
    __slots__ = ["camera", "points", "selection", "statistics", "time"]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    POINTS_FIELD_NUMBER: _ClassVar[int]
    SELECTION_FIELD_NUMBER: _ClassVar[int]
    STATISTICS_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    camera: _geometry_pb2.Camera
    points: _containers.RepeatedCompositeFieldContainer[PickedPoint]
    selection: _dataset_pb2.FieldSelection
    statistics: _frame_pb2.RenderStatistics
    time: float
    def __init__(self, points: _Optional[_Iterable[_Union[PickedPoint, _Mapping]]] = ..., camera: _Optional[_Union[_geometry_pb2.Camera, _Mapping]] = ..., statistics: _Optional[_Union[_frame_pb2.RenderStatistics, _Mapping]] = ..., selection: _Optional[_Union[_dataset_pb2.FieldSelection, _Mapping]] = ..., time: _Optional[float] = ...) -> None: ...

class PickedPoint(_message.Message):
    __slots__ = ["block_id", "depth", "field_values", "gradient", "is_hit", "label", "label_name", "normal", "position", "shard_index", "surface_index"]
    BLOCK_ID_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    FIELD_VALUES_FIELD_NUMBER: _ClassVar[int]
    GRADIENT_FIELD_NUMBER: _ClassVar[int]
    IS_HIT_FIELD_NUMBER: _ClassVar[int]
    LABEL_FIELD_NUMBER: _ClassVar[int]
    LABEL_NAME_FIELD_NUMBER: _ClassVar[int]
    NORMAL_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    SHARD_INDEX_FIELD_NUMBER: _ClassVar[int]
    SURFACE_INDEX_FIELD_NUMBER: _ClassVar[int]
    block_id: int
    depth: float
    field_values: _containers.RepeatedCompositeFieldContainer[FieldValue]
    gradient: _geometry_pb2.Vec3
    is_hit: bool
    label: float
    label_name: str
    normal: _geometry_pb2.Vec3
    position: _geometry_pb2.Vec3
    shard_index: int
    surface_index: int
    def __init__(self, is_hit: bool = ..., position: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ..., depth: _Optional[float] = ..., surface_index: _Optional[int] = ..., normal: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ..., block_id: _Optional[int] = ..., shard_index: _Optional[int] = ..., gradient: _Optional[_Union[_geometry_pb2.Vec3, _Mapping]] = ..., field_values: _Optional[_Iterable[_Union[FieldValue, _Mapping]]] = ..., label: _Optional[float] = ..., label_name: _Optional[str] = ...) -> None: ...

class Pixel(_message.Message):
    __slots__ = ["x", "y"]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    x: int
    y: int
    def __init__(self, x: _Optional[int] = ..., y: _Optional[int] = ...) -> None: ...

class RenderIsosurfaceRequest(_message.Message):
    __slots__ = ["allow_partial", "ambient_occlusion", "background_color", "base_color", "camera", "camera_fit", "caps", "clip", "culling", "dataset", "dataset_id", "isovalue", "level", "lights", "max_layers", "nan_color", "output", "ray_seed", "region", "samples", "selection", "silhouette", "surfaces", "viewport", "with_notes", "with_trace", "with_unresolved_count"]
    ALLOW_PARTIAL_FIELD_NUMBER: _ClassVar[int]
    AMBIENT_OCCLUSION_FIELD_NUMBER: _ClassVar[int]
    BACKGROUND_COLOR_FIELD_NUMBER: _ClassVar[int]
    BASE_COLOR_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIT_FIELD_NUMBER: _ClassVar[int]
    CAPS_FIELD_NUMBER: _ClassVar[int]
    CLIP_FIELD_NUMBER: _ClassVar[int]
    CULLING_FIELD_NUMBER: _ClassVar[int]
    DATASET_FIELD_NUMBER: _ClassVar[int]
    DATASET_ID_FIELD_NUMBER: _ClassVar[int]
    ISOVALUE_FIELD_NUMBER: _ClassVar[int]
    LEVEL_FIELD_NUMBER: _ClassVar[int]
    LIGHTS_FIELD_NUMBER: _ClassVar[int]
    MAX_LAYERS_FIELD_NUMBER: _ClassVar[int]
    NAN_COLOR_FIELD_NUMBER: _ClassVar[int]
    OUTPUT_FIELD_NUMBER: _ClassVar[int]
    RAY_SEED_FIELD_NUMBER: _ClassVar[int]
    REGION_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    SELECTION_FIELD_NUMBER: _ClassVar[int]
    SILHOUETTE_FIELD_NUMBER: _ClassVar[int]
    SURFACES_FIELD_NUMBER: _ClassVar[int]
    VIEWPORT_FIELD_NUMBER: _ClassVar[int]
    WITH_NOTES_FIELD_NUMBER: _ClassVar[int]
    WITH_TRACE_FIELD_NUMBER: _ClassVar[int]
    WITH_UNRESOLVED_COUNT_FIELD_NUMBER: _ClassVar[int]
    allow_partial: bool
    ambient_occlusion: AmbientOcclusion
    background_color: _geometry_pb2.Color
    base_color: _geometry_pb2.Color
    camera: _geometry_pb2.Camera
    camera_fit: CameraFit
    caps: ClipCaps
    clip: ClipRegion
    culling: _frame_pb2.Culling
    dataset: str
    dataset_id: str
    isovalue: float
    level: LevelChoice
    lights: _containers.RepeatedCompositeFieldContainer[Light]
    max_layers: int
    nan_color: _geometry_pb2.Color
    output: OutputOptions
    ray_seed: int
    region: _geometry_pb2.Region
    samples: int
    selection: _dataset_pb2.FieldSelection
    silhouette: Silhouette
    surfaces: _containers.RepeatedCompositeFieldContainer[Surface]
    viewport: _geometry_pb2.Viewport
    with_notes: bool
    with_trace: bool
    with_unresolved_count: bool
    def __init__(self, dataset: _Optional[str] = ..., isovalue: _Optional[float] = ..., camera: _Optional[_Union[_geometry_pb2.Camera, _Mapping]] = ..., viewport: _Optional[_Union[_geometry_pb2.Viewport, _Mapping]] = ..., culling: _Optional[_Union[_frame_pb2.Culling, str]] = ..., base_color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ..., background_color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ..., ray_seed: _Optional[int] = ..., surfaces: _Optional[_Iterable[_Union[Surface, _Mapping]]] = ..., clip: _Optional[_Union[ClipRegion, _Mapping]] = ..., lights: _Optional[_Iterable[_Union[Light, _Mapping]]] = ..., camera_fit: _Optional[_Union[CameraFit, str]] = ..., region: _Optional[_Union[_geometry_pb2.Region, _Mapping]] = ..., output: _Optional[_Union[OutputOptions, _Mapping]] = ..., ambient_occlusion: _Optional[_Union[AmbientOcclusion, _Mapping]] = ..., silhouette: _Optional[_Union[Silhouette, _Mapping]] = ..., samples: _Optional[int] = ..., max_layers: _Optional[int] = ..., caps: _Optional[_Union[ClipCaps, _Mapping]] = ..., with_trace: bool = ..., allow_partial: bool = ..., dataset_id: _Optional[str] = ..., selection: _Optional[_Union[_dataset_pb2.FieldSelection, _Mapping]] = ..., nan_color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ..., with_notes: bool = ..., level: _Optional[_Union[LevelChoice, _Mapping]] = ..., with_unresolved_count: bool = ...) -> None: ...

class RenderIsosurfaceResponse(_message.Message):
    __slots__ = ["camera", "caps_coloring", "colorings", "depth", "depth_bounds", "drawn_level", "extent", "jpeg", "normal", "notes", "png", "position", "rgba8", "selection", "statistics", "surface_index", "time", "trace"]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    CAPS_COLORING_FIELD_NUMBER: _ClassVar[int]
    COLORINGS_FIELD_NUMBER: _ClassVar[int]
    DEPTH_BOUNDS_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    DRAWN_LEVEL_FIELD_NUMBER: _ClassVar[int]
    EXTENT_FIELD_NUMBER: _ClassVar[int]
    JPEG_FIELD_NUMBER: _ClassVar[int]
    NORMAL_FIELD_NUMBER: _ClassVar[int]
    NOTES_FIELD_NUMBER: _ClassVar[int]
    PNG_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    RGBA8_FIELD_NUMBER: _ClassVar[int]
    SELECTION_FIELD_NUMBER: _ClassVar[int]
    STATISTICS_FIELD_NUMBER: _ClassVar[int]
    SURFACE_INDEX_FIELD_NUMBER: _ClassVar[int]
    TIME_FIELD_NUMBER: _ClassVar[int]
    TRACE_FIELD_NUMBER: _ClassVar[int]
    camera: _geometry_pb2.Camera
    caps_coloring: CapsColoring
    colorings: _containers.RepeatedCompositeFieldContainer[SurfaceColoring]
    depth: bytes
    depth_bounds: bytes
    drawn_level: DrawnLevel
    extent: _geometry_pb2.Viewport
    jpeg: bytes
    normal: bytes
    notes: _containers.RepeatedCompositeFieldContainer[SurfaceNote]
    png: bytes
    position: bytes
    rgba8: bytes
    selection: _dataset_pb2.FieldSelection
    statistics: _frame_pb2.RenderStatistics
    surface_index: bytes
    time: float
    trace: _trace_pb2.FrameTrace
    def __init__(self, png: _Optional[bytes] = ..., statistics: _Optional[_Union[_frame_pb2.RenderStatistics, _Mapping]] = ..., camera: _Optional[_Union[_geometry_pb2.Camera, _Mapping]] = ..., jpeg: _Optional[bytes] = ..., rgba8: _Optional[bytes] = ..., depth: _Optional[bytes] = ..., surface_index: _Optional[bytes] = ..., position: _Optional[bytes] = ..., normal: _Optional[bytes] = ..., extent: _Optional[_Union[_geometry_pb2.Viewport, _Mapping]] = ..., colorings: _Optional[_Iterable[_Union[SurfaceColoring, _Mapping]]] = ..., trace: _Optional[_Union[_trace_pb2.FrameTrace, _Mapping]] = ..., selection: _Optional[_Union[_dataset_pb2.FieldSelection, _Mapping]] = ..., time: _Optional[float] = ..., caps_coloring: _Optional[_Union[CapsColoring, _Mapping]] = ..., notes: _Optional[_Iterable[_Union[SurfaceNote, _Mapping]]] = ..., drawn_level: _Optional[_Union[DrawnLevel, _Mapping]] = ..., depth_bounds: _Optional[bytes] = ...) -> None: ...

class RenderIsosurfaceStreamRequest(_message.Message):
    __slots__ = ["request"]
    REQUEST_FIELD_NUMBER: _ClassVar[int]
    request: RenderIsosurfaceRequest
    def __init__(self, request: _Optional[_Union[RenderIsosurfaceRequest, _Mapping]] = ...) -> None: ...

class RenderIsosurfaceStreamResponse(_message.Message):
    __slots__ = ["part"]
    PART_FIELD_NUMBER: _ClassVar[int]
    part: RenderIsosurfaceResponse
    def __init__(self, part: _Optional[_Union[RenderIsosurfaceResponse, _Mapping]] = ...) -> None: ...

class Silhouette(_message.Message):
    __slots__ = ["color", "width_px"]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    color: _geometry_pb2.Color
    width_px: int
    def __init__(self, width_px: _Optional[int] = ..., color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ...) -> None: ...

class Surface(_message.Message):
    __slots__ = ["color", "color_by", "isovalue", "labels", "material", "smooth_labels"]
    COLOR_BY_FIELD_NUMBER: _ClassVar[int]
    COLOR_FIELD_NUMBER: _ClassVar[int]
    ISOVALUE_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    MATERIAL_FIELD_NUMBER: _ClassVar[int]
    SMOOTH_LABELS_FIELD_NUMBER: _ClassVar[int]
    color: _geometry_pb2.Color
    color_by: ColorBy
    isovalue: float
    labels: _containers.RepeatedScalarFieldContainer[float]
    material: Material
    smooth_labels: bool
    def __init__(self, isovalue: _Optional[float] = ..., color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ..., material: _Optional[_Union[Material, _Mapping]] = ..., color_by: _Optional[_Union[ColorBy, _Mapping]] = ..., labels: _Optional[_Iterable[float]] = ..., smooth_labels: bool = ...) -> None: ...

class SurfaceColoring(_message.Message):
    __slots__ = ["color_by", "nan_color", "shows_nan", "surface_index"]
    COLOR_BY_FIELD_NUMBER: _ClassVar[int]
    NAN_COLOR_FIELD_NUMBER: _ClassVar[int]
    SHOWS_NAN_FIELD_NUMBER: _ClassVar[int]
    SURFACE_INDEX_FIELD_NUMBER: _ClassVar[int]
    color_by: ColorBy
    nan_color: _geometry_pb2.Color
    shows_nan: bool
    surface_index: int
    def __init__(self, surface_index: _Optional[int] = ..., color_by: _Optional[_Union[ColorBy, _Mapping]] = ..., nan_color: _Optional[_Union[_geometry_pb2.Color, _Mapping]] = ..., shows_nan: bool = ...) -> None: ...

class SurfaceMeasures(_message.Message):
    __slots__ = ["area", "open_edge_count", "triangle_count", "volume"]
    AREA_FIELD_NUMBER: _ClassVar[int]
    OPEN_EDGE_COUNT_FIELD_NUMBER: _ClassVar[int]
    TRIANGLE_COUNT_FIELD_NUMBER: _ClassVar[int]
    VOLUME_FIELD_NUMBER: _ClassVar[int]
    area: float
    open_edge_count: int
    triangle_count: int
    volume: float
    def __init__(self, area: _Optional[float] = ..., volume: _Optional[float] = ..., triangle_count: _Optional[int] = ..., open_edge_count: _Optional[int] = ...) -> None: ...

class SurfaceNote(_message.Message):
    __slots__ = ["message", "reason", "surface_index"]
    class Reason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = []
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    REASON_CLIPPED: SurfaceNote.Reason
    REASON_FIELD_NUMBER: _ClassVar[int]
    REASON_NO_CELL: SurfaceNote.Reason
    REASON_NO_LABEL: SurfaceNote.Reason
    REASON_NO_SAMPLES: SurfaceNote.Reason
    REASON_OUTSIDE_PICTURE: SurfaceNote.Reason
    REASON_OUTSIDE_RANGE: SurfaceNote.Reason
    REASON_SOME_LABELS_MISSING: SurfaceNote.Reason
    REASON_TRANSPARENT: SurfaceNote.Reason
    REASON_UNSPECIFIED: SurfaceNote.Reason
    SURFACE_INDEX_FIELD_NUMBER: _ClassVar[int]
    message: str
    reason: SurfaceNote.Reason
    surface_index: int
    def __init__(self, surface_index: _Optional[int] = ..., reason: _Optional[_Union[SurfaceNote.Reason, str]] = ..., message: _Optional[str] = ...) -> None: ...

class ColorMap(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = []

class CameraFit(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = []
