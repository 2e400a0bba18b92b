"""Between this package's values and the messages of isoscope.v1. No other module reads or makes them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Literal, cast

import numpy as np
import numpy.typing as npt

from isoscope._proto import cluster_service_pb2 as cluster_pb
from isoscope._proto import dataset_pb2, frame_pb2, geometry_pb2
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope.camera import Camera, CameraLike, Vec3, as_camera, as_vec3
from isoscope.data import (
    AgentState,
    AgentStatistics,
    Capabilities,
    DatasetInfo,
    Histogram,
    Mesh,
    PickedPoint,
    Statistics,
    Suggestion,
    SurfaceColoring,
    SurfaceStatistics,
)
from isoscope.errors import InternalError, InvalidArgumentError
from isoscope.frame import Frame, PlaneName, Planes
from isoscope.look import (
    AmbientOcclusion,
    Caps,
    ClipLike,
    ColorBy,
    ColorLike,
    LightLike,
    Material,
    Silhouette,
    SurfaceLike,
    as_bounds,
    as_clip,
    as_light,
    as_lights,
    as_plane,
    as_surface,
    parse_color,
)

_MAPS = {name: 1 + at for at, name in enumerate(("viridis", "magma", "cividis", "turbo", "cool-warm", "grey"))}
_QUANTITIES = {name: 1 + at for at, name in enumerate(("x", "y", "z", "normal", "gradient"))}
_SPACES = {"view": 1, "world": 2}
_CULLINGS = {"depth": 1, "mask": 2, "none": 3}
_FORMATS = {"png": 1, "jpeg": 2, "rgba": 3, "none": 4}
_FITS = {"volume": 1, "surface": 2}
_PLANES: dict[str, tuple[str, int]] = {
    "depth": ("<f4", 1),
    "surface_index": ("u1", 1),
    "position": ("<f4", 3),
    "normal": ("<f4", 3),
}
_BYTES_FIELDS = ("png", "jpeg", "rgba8", *_PLANES)
_DTYPES = ("V1", "u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8")
_METHODS: dict[int, Literal["between_classes", "one_percent"]] = {1: "between_classes", 2: "one_percent"}


def _choice(values: dict[str, int], value: Any, name: str) -> int:
    if value not in values:
        raise InvalidArgumentError(f"{name} {value!r}: must be one of {', '.join(map(repr, values))}")
    return values[value]


def _key(values: dict[str, int], number: int, default: str) -> str:
    return next((name for name, value in values.items() if value == number), default)


def _int(value: Any, name: str) -> int:
    """Returns a whole number that fits the message."""
    try:
        number = int(value)
        exact = number == value
    except (TypeError, ValueError, OverflowError):
        number, exact = 0, False
    if not exact or abs(number) >= 2**31:
        raise InvalidArgumentError(f"{name} {value!r}: must be a whole number")
    return number


def _number(value: Any, name: str) -> float:
    """Returns a number; the server checks its range."""
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} {value!r}: must be a number") from error


def _vec(value: Iterable[float]) -> geometry_pb2.Vec3:
    x, y, z = value
    return geometry_pb2.Vec3(x=x, y=y, z=z)


def _color(value: ColorLike, name: str, opacity: float | None = None) -> geometry_pb2.Color:
    red, green, blue, alpha = parse_color(value, name)
    if opacity is not None:
        alpha = _number(opacity, "surface opacity")
    return geometry_pb2.Color(red=red, green=green, blue=blue, alpha=alpha)


def _pair(values: Sequence[float], name: str) -> tuple[float, float]:
    try:
        lower, upper = (float(value) for value in values)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} {values!r}: must be two numbers (min, max)") from error
    return lower, upper


def _range(values: Sequence[float], name: str) -> pb.ColorRange:
    lower, upper = _pair(values, name)
    return pb.ColorRange(min=lower, max=upper)


# --------------------------------------------------------------------------------- requests


def camera_to_proto(camera: Camera) -> geometry_pb2.Camera:
    """Returns the message of a camera; its numbers keep their bits."""
    proto = geometry_pb2.Camera(eye=_vec(camera.eye), target=_vec(camera.target), up=_vec(camera.up))
    if camera.height is not None:
        proto.orthographic.height = camera.height
    else:
        proto.perspective.fov_y_degrees = camera.fov_y
    return proto


def _color_by(value: ColorBy) -> pb.ColorBy:
    proto = pb.ColorBy(quantity=cast(Any, _choice(_QUANTITIES, value.quantity, "color_by quantity")))
    if value.map is not None:
        proto.color_map = cast(Any, _choice(_MAPS, value.map, "color_by map"))
    if value.range is not None:
        proto.range.CopyFrom(_range(value.range, "color_by range"))
    if value.opacity is not None:
        at_min, at_max = _pair(value.opacity, "color_by opacity")
        proto.opacity.CopyFrom(pb.MapOpacity(at_min=at_min, at_max=at_max))
    return proto


#: The server's default colour, for surfaces that set only an opacity.
_CLAY = (222 / 255, 209 / 255, 190 / 255)


def surface_to_proto(surface: SurfaceLike, default_color: ColorLike = _CLAY) -> pb.Surface:
    """Returns the message of a surface."""
    value = as_surface(surface)
    proto = pb.Surface(isovalue=_number(value.isovalue, "surface isovalue"))
    if value.color is not None or value.opacity is not None:
        color = default_color if value.color is None else value.color
        proto.color.CopyFrom(_color(color, "surface color", value.opacity))
    if value.material is not None:
        proto.material.CopyFrom(_material(value.material))
    if value.color_by is not None:
        proto.color_by.CopyFrom(_color_by(value.color_by))
    return proto


def _material(value: Material) -> pb.Material:
    proto = pb.Material()
    for name in ("ambient", "diffuse", "specular", "shininess"):
        number = getattr(value, name)
        if number is not None:
            setattr(proto, name, _number(number, f"material {name}"))
    return proto


def clip_to_proto(clip: ClipLike) -> tuple[pb.ClipRegion, pb.ClipCaps | None]:
    """Returns the messages of a region and of its caps."""
    value = as_clip(clip)
    proto = pb.ClipRegion()
    for plane in map(as_plane, value.planes):
        proto.half_spaces.add(
            normal=_vec(as_vec3(plane.normal, "clip plane normal")), offset=_number(plane.offset, "clip plane offset")
        )
    if value.box is not None:
        x0, x1, y0, y1, z0, z1 = as_bounds(value.box)
        proto.box.CopyFrom(geometry_pb2.Box(min=_vec((x0, y0, z0)), max=_vec((x1, y1, z1))))
    caps: pb.ClipCaps | None = None
    if value.caps:
        caps = pb.ClipCaps()
        if isinstance(value.caps, Caps):
            if value.caps.map is not None:
                caps.color_map = cast(Any, _choice(_MAPS, value.caps.map, "caps map"))
            if value.caps.range is not None:
                caps.range.CopyFrom(_range(value.caps.range, "caps range"))
    return proto, caps


def _light(light: LightLike) -> pb.Light:
    value = as_light(light)
    proto = pb.Light(direction=_vec(as_vec3(value.direction, "light direction")))
    proto.intensity = _number(value.intensity, "light intensity")
    proto.space = cast(Any, _choice(_SPACES, value.space, "light space"))
    if value.color is not None:
        proto.color.CopyFrom(_color(value.color, "light color"))
    return proto


def _camera_of(
    dataset: DatasetInfo,
    camera: CameraLike | None,
    view: str | None,
    azimuth: float,
    elevation: float,
    zoom: float,
    fit: str,
) -> Camera:
    """Returns the camera of a request, before the server fits it to the surface."""
    if camera is None:
        return dataset.camera(view or "front", azimuth, elevation, zoom)
    if view is not None or fit != "volume":
        raise InvalidArgumentError("camera can't be given with view or fit='surface', which place the camera")
    turned = as_camera(camera)
    turned = turned.azimuth(azimuth) if azimuth else turned
    turned = turned.elevation(elevation) if elevation else turned
    return turned.zoom(zoom) if zoom != 1 else turned


def _set_surfaces(
    request: Any, isovalue: float | None, surfaces: Sequence[SurfaceLike] | SurfaceLike | None
) -> None:
    if (isovalue is None) == (surfaces is None):
        raise InvalidArgumentError(
            "give either isovalue=... for one surface, or surfaces=[isoscope.Surface(...), ...]"
            + ("" if isovalue is None else ", not both")
        )
    if surfaces is None:
        request.isovalue = _number(isovalue, "isovalue")
        return
    several = surfaces if isinstance(surfaces, Iterable) else [surfaces]
    request.surfaces.extend(surface_to_proto(surface) for surface in several)
    if not request.surfaces:
        raise InvalidArgumentError("surfaces is empty: give 1 to 16 surfaces")


def frame_request(
    dataset: DatasetInfo,
    isovalue: float | None,
    *,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
    camera: CameraLike | None = None,
    view: str | None = None,
    azimuth: float = 0,
    elevation: float = 0,
    zoom: float = 1,
    fit: str = "volume",
    size: tuple[int, int] | int = (1024, 1024),
    region: tuple[int, int, int, int] | None = None,
    clip: ClipLike | None = None,
    max_layers: int | None = None,
) -> pb.RenderIsosurfaceRequest:
    """Returns the request for what a frame or a pick sees: surfaces, camera, size and clip region."""
    request = pb.RenderIsosurfaceRequest(dataset=dataset.name)
    _set_surfaces(request, isovalue, surfaces)
    request.camera.CopyFrom(camera_to_proto(_camera_of(dataset, camera, view, azimuth, elevation, zoom, fit)))
    request.camera_fit = cast(Any, _choice(_FITS, fit, "fit"))
    sides = (size, size) if isinstance(size, (int, np.integer)) else size
    width, height = _integers(sides, "size", "(width, height)", 2)
    request.viewport.CopyFrom(geometry_pb2.Viewport(width_px=width, height_px=height))
    if region is not None:
        x, y, w, h = _integers(region, "region", "(x, y, width, height)", 4)
        request.region.CopyFrom(geometry_pb2.Region(x=x, y=y, width_px=w, height_px=h))
    if clip is not None:
        clip_region, caps = clip_to_proto(clip)
        request.clip.CopyFrom(clip_region)
        if caps is not None:
            request.caps.CopyFrom(caps)
    if max_layers is not None:
        request.max_layers = _int(max_layers, "max_layers")
    return request


def _integers(values: Any, name: str, shape: str, count: int) -> tuple[int, ...]:
    try:
        numbers = tuple(int(value) for value in values)
        exact = all(number == value for number, value in zip(numbers, values))
    except (TypeError, ValueError, OverflowError):
        numbers, exact = (), False
    if len(numbers) != count or not exact or any(abs(number) >= 2**31 for number in numbers):
        raise InvalidArgumentError(f"{name} {values!r}: must be {shape}, whole numbers of pixels")
    return numbers


def set_appearance(
    request: pb.RenderIsosurfaceRequest,
    *,
    color: ColorLike | None,
    background: ColorLike | None,
    lights: Sequence[LightLike] | LightLike,
    color_by: ColorBy | None,
    samples: int | None,
    ambient_occlusion: AmbientOcclusion | bool,
    silhouette: Silhouette | bool,
    culling: str,
) -> None:
    """Adds what decides colours."""
    if color is not None:
        if request.surfaces:
            raise InvalidArgumentError("color is that of the only surface: with surfaces, write Surface(V, color=...)")
        request.base_color.CopyFrom(_color(color, "color"))
    if color_by is not None:
        _set_color_by(request, color_by)
    if background is not None:
        request.background_color.CopyFrom(_color(background, "background"))
    request.lights.extend(map(_light, as_lights(lights)))
    if samples is not None:
        request.samples = _int(samples, "samples")
    if ambient_occlusion:
        effect = ambient_occlusion if isinstance(ambient_occlusion, AmbientOcclusion) else AmbientOcclusion()
        request.ambient_occlusion.CopyFrom(
            pb.AmbientOcclusion(
                radius_px=_int(effect.radius, "ambient_occlusion radius"),
                strength=_number(effect.strength, "ambient_occlusion strength"),
            )
        )
    if silhouette:
        lines = silhouette if isinstance(silhouette, Silhouette) else Silhouette()
        request.silhouette.CopyFrom(pb.Silhouette(width_px=_int(lines.width, "silhouette width")))
        if lines.color is not None:
            request.silhouette.color.CopyFrom(_color(lines.color, "silhouette color"))
    request.culling = cast(Any, _choice(_CULLINGS, culling, "culling"))


def _set_color_by(request: pb.RenderIsosurfaceRequest, color_by: ColorBy) -> None:
    """Colours all surfaces that have no color_by of their own."""
    if not request.surfaces:
        surface = request.surfaces.add(isovalue=request.isovalue)
        request.ClearField("isovalue")
        if request.HasField("base_color"):
            surface.color.CopyFrom(request.base_color)
            request.ClearField("base_color")
    for surface in request.surfaces:
        if not surface.HasField("color_by"):
            surface.color_by.CopyFrom(_color_by(color_by))


def set_output(
    request: pb.RenderIsosurfaceRequest, image_format: str, quality: int | None, planes: Sequence[str]
) -> None:
    """Adds what comes back."""
    wanted = [planes] if isinstance(planes, str) else list(planes)
    for plane in wanted:
        if plane not in _PLANES:
            raise InvalidArgumentError(f"plane {plane!r}: must be one of {', '.join(map(repr, _PLANES))}")
    if image_format == "png" and not wanted and quality is None:
        return
    request.output.image_format = cast(Any, _choice(_FORMATS, image_format, "format"))
    if quality is not None:
        request.output.jpeg_quality = _int(quality, "quality")
    for plane in wanted:
        setattr(request.output, plane, True)


def plane_request(request: pb.RenderIsosurfaceRequest, plane: PlaneName) -> pb.RenderIsosurfaceRequest:
    """Returns the request for one more plane of the frame that `request` asked for."""
    more = pb.RenderIsosurfaceRequest()
    more.CopyFrom(request)
    more.ClearField("output")
    more.output.image_format = cast(Any, _FORMATS["none"])
    setattr(more.output, plane, True)
    # Planes depend on neither, and NONE with several samples would draw them for nothing.
    for field in ("ambient_occlusion", "silhouette", "samples"):
        more.ClearField(cast(Any, field))
    return more


def pick_request(request: pb.RenderIsosurfaceRequest, pixels: Sequence[tuple[int, int]]) -> pb.PickSurfaceRequest:
    """Returns the request for what pixels of the frame show, counted in its whole viewport."""
    pick = pb.PickSurfaceRequest(frame=request)
    pick.frame.ClearField("output")
    pick.frame.ClearField("region")
    for pixel in pixels:
        x, y = _integers(pixel, "pixel", "(column, row)", 2)
        pick.pixels.add(x=x, y=y)
    return pick


def export_request(
    dataset: DatasetInfo,
    isovalue: float | None,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None,
    clip: ClipLike | None,
) -> pb.ExportIsosurfaceRequest:
    """Returns the request for a mesh."""
    request = pb.ExportIsosurfaceRequest(dataset=dataset.name)
    _set_surfaces(request, isovalue, surfaces)
    if clip is not None:
        clip_region, caps = clip_to_proto(clip)
        if caps is not None:
            raise InvalidArgumentError("clip caps: meshes are open where they are cut; leave caps out")
        request.clip.CopyFrom(clip_region)
    return request


def histogram_request(name: str, bins: int, values: tuple[float, float] | None) -> datasets_pb.GetHistogramRequest:
    """Returns the request for a histogram."""
    request = datasets_pb.GetHistogramRequest(dataset=name, max_bin_count=_int(bins, "bins"))
    if values is not None:
        lower, upper = _pair(values, "histogram range")
        request.value_range.CopyFrom(dataset_pb2.ValueRange(min=lower, max=upper))
    return request


# --------------------------------------------------------------------------------- answers


def _tuple3(vector: geometry_pb2.Vec3) -> Vec3:
    return (vector.x, vector.y, vector.z)


def _dims(proto: dataset_pb2.Dimensions) -> tuple[int, int, int]:
    return (proto.x, proto.y, proto.z)


def dataset_fields(proto: dataset_pb2.Dataset) -> dict[str, Any]:
    """Returns the keyword arguments of a DatasetInfo."""
    columns = [_tuple3(column) for column in proto.geometry.direction_columns]
    if len(columns) != 3:
        columns = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    kind = int(proto.sample_type)
    return {
        "name": proto.name,
        "id": proto.dataset_id,
        "source": proto.source,
        "dims": _dims(proto.geometry.sample_dims),
        "spacing": _tuple3(proto.geometry.spacing),
        "origin": _tuple3(proto.geometry.origin),
        "direction": (columns[0], columns[1], columns[2]),
        "dtype": np.dtype(_DTYPES[kind] if kind < len(_DTYPES) else _DTYPES[0]),
        "range": (proto.value_range.min, proto.value_range.max) if proto.HasField("value_range") else None,
        "block_cells": _dims(proto.block_cells),
        "block_count": proto.block_count,
        "shard_count": proto.shard_count,
        "missing_shards": tuple(proto.missing_shards),
        "samples_digest": proto.samples_digest or None,
        "patient_frame": proto.patient_frame or None,
        "max_gradient": proto.max_gradient_magnitude if proto.HasField("max_gradient_magnitude") else None,
    }


def histogram_from_proto(proto: datasets_pb.GetHistogramResponse) -> Histogram:
    """Returns a histogram of arrays."""
    bins = proto.bins

    def column(name: str) -> npt.NDArray[np.int64]:
        return np.array([getattr(one, name) for one in bins], np.int64)

    return Histogram(
        edges=np.array([one.min for one in bins] + [one.max for one in bins[-1:]], np.float64),
        sample_count=column("sample_count"),
        active_block_count=column("active_block_count"),
        active_block_bytes=column("active_block_bytes"),
        estimated_triangle_count=column("estimated_triangle_count"),
        has_sample_counts=proto.has_sample_counts,
        nan_count=proto.nan_count,
        negative_infinity_count=proto.negative_infinity_count,
        positive_infinity_count=proto.positive_infinity_count,
        suggestions=tuple(
            Suggestion(_METHODS.get(int(one.method), "unknown"), one.isovalue, one.inside_fraction)
            for one in proto.suggestions
        ),
    )


def capabilities_from_proto(proto: cluster_pb.GetCapabilitiesResponse) -> Capabilities:
    """Returns version and limits."""
    return Capabilities(
        version=proto.version,
        max_viewport=proto.max_viewport_px,
        max_concurrent_frames=proto.max_concurrent_frame_count,
        max_queued_frames=proto.max_queued_frame_count,
        max_message_bytes=proto.max_message_bytes,
        max_frame_seconds=proto.max_frame_seconds,
        gateway_address=proto.gateway_address or None,
        features=frozenset(proto.features),
    )


def expect_dataset(
    request: pb.RenderIsosurfaceRequest | pb.ExportIsosurfaceRequest | datasets_pb.GetHistogramRequest,
    dataset: DatasetInfo,
    capabilities: Capabilities | None,
) -> None:
    """Lets a request fail if the name has other contents by now. Older servers refuse the field."""
    if capabilities is not None and "dataset_id" in capabilities.features:
        request.dataset_id = dataset.id


def agents_from_proto(proto: cluster_pb.GetClusterStatusResponse) -> list[AgentState]:
    """Returns the agents."""
    return [
        AgentState(
            address=agent.address,
            is_reachable=int(agent.state) == 1,
            message=agent.message,
            version=agent.version,
            renderer=agent.renderer,
            picture_revision=agent.picture_revision,
            shards=tuple((shard.dataset, shard.shard_index, shard.block_count) for shard in agent.shards),
            is_draining=agent.is_draining,
        )
        for agent in proto.agents
    ]


def _milliseconds(duration: Any) -> float:
    return float(duration.seconds * 1e3 + duration.nanos * 1e-6)


def statistics_from_proto(proto: frame_pb2.RenderStatistics) -> Statistics:
    """Returns the cost of a frame."""
    steps = ("occluder_selection", "occluder_rendering", "visibility_culling", "composite", "encode")
    return Statistics(
        active_block_count=proto.active_block_count,
        ray_hit_block_count=proto.ray_hit_block_count,
        visible_block_count=proto.visible_block_count,
        culled_block_count=proto.culled_block_count,
        occluding_block_count=proto.occluding_block_count,
        triangle_count=proto.triangle_count,
        unique_vertex_count=proto.unique_vertex_count,
        read_bytes=proto.read_bytes,
        network_bytes=proto.network_bytes,
        png_bytes=proto.png_bytes,
        truncated_pixel_count=proto.truncated_pixel_count,
        missing_shards=tuple(proto.missing_shards),
        active_block_coverage=proto.active_block_coverage if proto.HasField("active_block_coverage") else None,
        durations_ms={step: _milliseconds(getattr(proto.durations, f"{step}_duration")) for step in steps},
        agents=tuple(
            AgentStatistics(
                address=agent.agent_address,
                shards=tuple(agent.shard_indices),
                active_block_count=agent.active_block_count,
                visible_block_count=agent.visible_block_count,
                triangle_count=agent.triangle_count,
                read_bytes=agent.read_bytes,
                busy_ms=_milliseconds(agent.busy_duration),
                extract_ms=_milliseconds(agent.extract_duration),
                render_ms=_milliseconds(agent.render_duration),
            )
            for agent in proto.agents
        ),
        surfaces=tuple(SurfaceStatistics(one.triangle_count, one.unique_vertex_count) for one in proto.surfaces),
    )


def camera_from_proto(proto: geometry_pb2.Camera) -> Camera:
    """Returns a camera; its numbers keep their bits."""
    up = _tuple3(proto.up) if proto.HasField("up") else (0.0, 1.0, 0.0)
    if proto.WhichOneof("projection") == "orthographic":
        return Camera(_tuple3(proto.eye), _tuple3(proto.target), up, height=proto.orthographic.height)
    return Camera(_tuple3(proto.eye), _tuple3(proto.target), up, fov_y=proto.perspective.fov_y_degrees)


def _coloring(proto: pb.SurfaceColoring) -> SurfaceColoring:
    one = proto.color_by
    return SurfaceColoring(
        surface_index=proto.surface_index,
        color_by=ColorBy(
            quantity=cast(Any, _key(_QUANTITIES, int(one.quantity), "normal")),
            map=cast(Any, _key(_MAPS, int(one.color_map), "viridis")) if int(one.quantity) != 4 else None,
            range=(one.range.min, one.range.max) if one.HasField("range") else None,
            opacity=(one.opacity.at_min, one.opacity.at_max) if one.HasField("opacity") else None,
        ),
    )


class FrameParts:
    """Puts the parts of RenderIsosurfaceStream together."""

    def __init__(self) -> None:
        self._bytes: dict[str, list[bytes]] = {name: [] for name in _BYTES_FIELDS}
        self._rest = pb.RenderIsosurfaceResponse()

    def add(self, message: pb.RenderIsosurfaceStreamResponse) -> None:
        """Takes the next part; it is empty afterwards."""
        part = message.part
        for name, pieces in self._bytes.items():
            piece = getattr(part, name)
            if piece:
                pieces.append(piece)
                part.ClearField(cast(Any, name))
        self._rest.MergeFrom(part)

    def _joined(self, name: str) -> bytes:
        pieces = self._bytes[name]
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)

    def planes(self) -> Planes:
        """Returns the planes that came, read-only arrays."""
        width, height = self._rest.extent.width_px, self._rest.extent.height_px
        planes: Planes = {}
        for name, (dtype, components) in _PLANES.items():
            data = self._joined(name)
            if not data:
                continue
            shape = (height, width) if components == 1 else (height, width, components)
            array = np.frombuffer(data, dtype)
            if array.size != math.prod(shape):
                raise InternalError(f"plane {name!r} has {len(data)} bytes, which is not {shape} of {dtype}")
            planes[name] = array.reshape(shape)
        return planes

    def frame(self, request: pb.RenderIsosurfaceRequest, fetch: Any = None, pick: Any = None) -> Frame:
        """Returns the frame, with the request that gives it again wherever the server had moved the camera."""
        rest = self._rest
        again = pb.RenderIsosurfaceRequest()
        again.CopyFrom(request)
        again.camera.CopyFrom(rest.camera)
        again.ClearField("camera_fit")
        return Frame(
            width=rest.extent.width_px,
            height=rest.extent.height_px,
            camera=camera_from_proto(rest.camera),
            stats=statistics_from_proto(rest.statistics),
            colorings=tuple(map(_coloring, rest.colorings)),
            jpeg=self._joined("jpeg") or None,
            _png_bytes=self._joined("png"),
            _rgba_bytes=self._joined("rgba8"),
            _planes=self.planes(),
            _request=again,
            _fetch=fetch and (lambda plane: fetch(again, plane)),
            _pick=pick and (lambda pixels: pick(again, pixels)),
        )


class MeshParts:
    """Puts the chunks of ExportIsosurface together."""

    def __init__(self, request: pb.ExportIsosurfaceRequest) -> None:
        self._isovalues = tuple(one.isovalue for one in request.surfaces) or (request.isovalue,)
        self._chunks: list[tuple[bytes, bytes, bytes, int]] = []

    def add(self, chunk: pb.ExportIsosurfaceResponse) -> None:
        """Takes the next chunk."""
        self._chunks.append((chunk.positions, chunk.normals, chunk.triangles, chunk.surface_index))

    def mesh(self) -> Mesh:
        """Returns the whole mesh."""
        chunks = self._chunks
        return Mesh(
            points=np.frombuffer(b"".join(chunk[0] for chunk in chunks), "<f4").reshape(-1, 3),
            normals=np.frombuffer(b"".join(chunk[1] for chunk in chunks), "<f4").reshape(-1, 3),
            triangles=np.frombuffer(b"".join(chunk[2] for chunk in chunks), "<i8").reshape(-1, 3),
            triangle_surface=np.repeat(
                np.array([chunk[3] for chunk in chunks], np.uint8), [len(chunk[2]) // 24 for chunk in chunks]
            ),
            isovalues=self._isovalues,
        )


def picked_from_proto(
    proto: pb.PickSurfaceResponse, pixels: Sequence[tuple[int, int]]
) -> list[PickedPoint | None]:
    """Returns what the pixels show, in their order; None where it is the background."""
    return [
        PickedPoint(
            pixel=(int(pixel[0]), int(pixel[1])),
            position=_tuple3(point.position),
            depth=point.depth,
            surface_index=point.surface_index,
            normal=_tuple3(point.normal) if point.HasField("normal") else None,
            gradient=_tuple3(point.gradient) if point.HasField("gradient") else None,
            block_id=point.block_id,
            shard_index=point.shard_index if point.HasField("shard_index") else None,
        )
        if point.is_hit
        else None
        for point, pixel in zip(proto.points, pixels)
    ]
