"""Decodes answers: messages of isoscope.v1 become values of this package; their numbers keep their bits.

1. `_core` makes a call with the decoder of its answer from here.
2. An answer of one message is decoded by a function, such as `dataset_fields` or `histogram`.
3. An answer in parts has a class: `add` takes each part and clears it, so that memory holds the data once.
4. `result` decodes the whole: a Frame with its planes, or a Mesh.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, cast

import numpy as np

from isoscope._proto import cluster_service_pb2 as cluster_pb
from isoscope._proto import dataset_pb2, frame_pb2, geometry_pb2
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope._mesh import CLAY, Rgba
from isoscope._messages import MAPS, QUANTITIES, surfaces_of
from isoscope._request import PLANES, is_asked
from isoscope._warn import warn_of_surface
from isoscope.camera import Camera
from isoscope.data import (
    AgentState,
    AgentStatistics,
    Capabilities,
    CapsColoring,
    DatasetLevel,
    DrawnLevel,
    Field,
    FieldComponent,
    FieldValue,
    Histogram,
    LabelValues,
    Mesh,
    PickedPoint,
    Statistics,
    Suggestion,
    SurfaceColoring,
    SurfaceMeasures,
    SurfaceNote,
    SurfaceStatistics,
    TimeStep,
)
from isoscope.errors import InternalError
from isoscope.frame import Frame, FrameCalls, Planes
from isoscope.labels import Label
from isoscope.look import Caps, ColorBy

_BYTES_FIELDS = ("png", "jpeg", "rgba8", *PLANES)
_DTYPES = ("V1", "u1", "i1", "u2", "i2", "u4", "i4", "f4", "f8")
_COLUMNS = ("sample_count", "active_block_count", "active_block_bytes", "estimated_triangle_count")
_STEPS = ("occluder_selection", "occluder_rendering", "visibility_culling", "composite", "encode")
_FILTERS = {1: "mean", 2: "majority"}
_METHODS: dict[int, Literal["between_classes", "one_percent"]] = {1: "between_classes", 2: "one_percent"}


def _key(values: dict[str, int], number: int, default: str) -> str:
    return next((name for name, value in values.items() if value == number), default)


def _copied(proto: Any, *names: str) -> dict[str, Any]:
    """Returns the fields that have the same names here."""
    return {name: getattr(proto, name) for name in names}


def _optional(proto: Any, name: str) -> Any:
    return getattr(proto, name) if proto.HasField(name) else None


def _tuple3(vector: Any) -> tuple[Any, Any, Any]:
    return (vector.x, vector.y, vector.z)


def _dtype(number: int) -> np.dtype[Any]:
    return np.dtype(_DTYPES[number] if number < len(_DTYPES) else _DTYPES[0])


def _value_range(proto: Any) -> tuple[float, float] | None:
    return (proto.value_range.min, proto.value_range.max) if proto.HasField("value_range") else None


def _field(proto: dataset_pb2.Field, numbers: Sequence[int]) -> Field:
    """Returns a field. `numbers` are those of the dataset's steps."""
    return Field(
        name=proto.name,
        long_name=proto.long_name or None,
        unit=proto.unit or None,
        components=tuple(
            FieldComponent(
                one.name, _dtype(int(one.sample_type)), _value_range(one), _optional(one, "max_gradient_magnitude")
            )
            for one in proto.components
        ),
        steps=tuple(numbers[at] for at in proto.time_steps if at < len(numbers)),
    )


def _hex_color(proto: geometry_pb2.Color) -> str:
    """Returns "#rrggbb", without the alpha."""
    bytes_ = (int(255 * channel + 0.5) for channel in (proto.red, proto.green, proto.blue))
    return "#" + "".join(f"{min(max(byte, 0), 255):02x}" for byte in bytes_)


def _label(proto: dataset_pb2.Label) -> Label:
    return Label(proto.value, proto.name or None, _hex_color(proto.color) if proto.HasField("color") else None)


def _level(proto: dataset_pb2.DatasetLevel) -> DatasetLevel:
    return DatasetLevel(
        level=proto.level,
        dims=_tuple3(proto.geometry.sample_dims),
        spacing=_tuple3(proto.geometry.spacing),
        block_count=proto.block_count,
        filter=_FILTERS.get(int(proto.filter), "unknown"),
    )


def _drawn_level(proto: pb.DrawnLevel | None) -> DrawnLevel | None:
    return None if proto is None else DrawnLevel(proto.level, proto.max_spacing_px, _tuple3(proto.spacing))


def selection(proto: dataset_pb2.FieldSelection | None) -> dict[str, Any]:
    """Returns field, component and step of an answer; None where the dataset has none."""
    if proto is None or not proto.field:
        return {"field": None, "component": None, "step": None}
    step = proto.time_step if proto.WhichOneof("when") == "time_step" else None
    return {"field": proto.field, "component": proto.component or None, "step": step}


def dataset_fields(proto: dataset_pb2.Dataset) -> dict[str, Any]:
    """Returns the keyword arguments of a DatasetInfo."""
    columns = [_tuple3(column) for column in proto.geometry.direction_columns]
    if len(columns) != 3:
        columns = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    steps = tuple(TimeStep(step.number, step.value) for step in proto.time_steps)
    return {
        **_copied(proto, "name", "source", "block_count", "shard_count"),
        "id": proto.dataset_id,
        "dims": _tuple3(proto.geometry.sample_dims),
        "spacing": _tuple3(proto.geometry.spacing),
        "origin": _tuple3(proto.geometry.origin),
        "direction": (columns[0], columns[1], columns[2]),
        "dtype": _dtype(int(proto.sample_type)),
        "range": _value_range(proto),
        "block_cells": _tuple3(proto.block_cells),
        "missing_shards": tuple(proto.missing_shards),
        "samples_digest": proto.samples_digest or None,
        "patient_frame": proto.patient_frame or None,
        "labels": tuple(_label(one) for one in proto.labels),
        "max_gradient": _optional(proto, "max_gradient_magnitude"),
        "fields": tuple(_field(one, [step.number for step in steps]) for one in proto.fields),
        "time_steps": steps,
        "time_unit": proto.time_unit or None,
        "length_unit": proto.length_unit or None,
        "levels": tuple(map(_level, proto.levels)),
    }


def histogram(proto: datasets_pb.GetHistogramResponse) -> Histogram:
    """Returns a histogram of arrays."""
    bins = proto.bins
    columns: dict[str, Any] = {name: np.array([getattr(one, name) for one in bins], np.int64) for name in _COLUMNS}
    return Histogram(
        edges=np.array([one.min for one in bins] + [one.max for one in bins[-1:]], np.float64),
        **columns,
        **_copied(proto, "has_sample_counts", "nan_count", "negative_infinity_count", "positive_infinity_count"),
        suggestions=tuple(
            Suggestion(_METHODS.get(int(one.method), "unknown"), one.isovalue, one.inside_fraction)
            for one in proto.suggestions
        ),
        suggested_labels=tuple(proto.suggested_labels),
        **selection(_optional(proto, "selection")),
    )


def capabilities(proto: cluster_pb.GetCapabilitiesResponse) -> Capabilities:
    """Returns version and limits."""
    return Capabilities(
        max_viewport=proto.max_viewport_px,
        max_concurrent_frames=proto.max_concurrent_frame_count,
        max_queued_frames=proto.max_queued_frame_count,
        gateway_address=proto.gateway_address or None,
        features=frozenset(proto.features),
        **_copied(proto, "version", "max_message_bytes", "max_frame_seconds"),
    )


def agents(proto: cluster_pb.GetClusterStatusResponse) -> list[AgentState]:
    """Returns the agents."""
    return [
        AgentState(
            is_reachable=int(agent.state) == 1,
            shards=tuple((shard.dataset, shard.shard_index, shard.block_count) for shard in agent.shards),
            **_copied(agent, "address", "message", "version", "renderer", "picture_revision", "is_draining"),
        )
        for agent in proto.agents
    ]


def _milliseconds(duration: Any) -> float:
    return float(duration.seconds * 1e3 + duration.nanos * 1e-6)


def statistics(proto: frame_pb2.RenderStatistics) -> Statistics:
    """Returns the cost of a frame."""
    return Statistics(
        **_copied(
            proto, "active_block_count", "ray_hit_block_count", "visible_block_count", "culled_block_count",
            "occluding_block_count", "triangle_count", "unique_vertex_count", "read_bytes", "network_bytes",
            "png_bytes", "truncated_pixel_count", "level",
        ),
        missing_shards=tuple(proto.missing_shards),
        active_block_coverage=_optional(proto, "active_block_coverage"),
        band_count=max(proto.band_count, 1),
        unresolved_block_count=_optional(proto, "unresolved_block_count"),
        durations_ms={step: _milliseconds(getattr(proto.durations, f"{step}_duration")) for step in _STEPS},
        agents=tuple(
            AgentStatistics(
                address=agent.agent_address,
                shards=tuple(agent.shard_indices),
                **_copied(agent, "active_block_count", "visible_block_count", "triangle_count", "read_bytes"),
                busy_ms=_milliseconds(agent.busy_duration),
                extract_ms=_milliseconds(agent.extract_duration),
                render_ms=_milliseconds(agent.render_duration),
            )
            for agent in proto.agents
        ),
        surfaces=tuple(SurfaceStatistics(one.triangle_count, one.unique_vertex_count) for one in proto.surfaces),
    )  # fmt: skip


def camera(proto: geometry_pb2.Camera) -> Camera:
    """Returns a camera; its numbers keep their bits."""
    up = _tuple3(proto.up) if proto.HasField("up") else (0.0, 1.0, 0.0)
    projection: dict[str, float] = (
        {"height": proto.orthographic.height} if proto.WhichOneof("projection") == "orthographic"
        else {"fov_y": proto.perspective.fov_y_degrees}
    )  # fmt: skip
    return Camera(_tuple3(proto.eye), _tuple3(proto.target), up, **projection)


def _coloring(proto: pb.SurfaceColoring) -> SurfaceColoring:
    one = proto.color_by
    return SurfaceColoring(
        surface_index=proto.surface_index,
        color_by=ColorBy(
            quantity=cast(Any, _key(QUANTITIES, int(one.quantity), "normal")),
            map=cast(Any, _key(MAPS, int(one.color_map), "viridis")) if int(one.quantity) != 4 else None,
            range=(one.range.min, one.range.max) if one.HasField("range") else None,
            opacity=(one.opacity.at_min, one.opacity.at_max) if one.HasField("opacity") else None,
            field=one.field or None,
            component=one.component or None,
        ),
        nan_color=_hex_color(proto.nan_color) if proto.HasField("nan_color") else None,
        shows_nan=proto.shows_nan,
    )


def _caps_coloring(proto: pb.CapsColoring | None) -> CapsColoring | None:
    if proto is None:
        return None
    range_ = proto.caps.range
    caps = Caps(cast(Any, _key(MAPS, int(proto.caps.color_map), "viridis")), (range_.min, range_.max))
    return CapsColoring(caps, _hex_color(proto.nan_color), proto.shows_nan)


def _note(proto: pb.SurfaceNote) -> SurfaceNote:
    names = pb.SurfaceNote.Reason
    known = proto.reason in names.values()
    reason = names.Name(proto.reason).removeprefix("REASON_").lower() if known else str(int(proto.reason))
    return SurfaceNote(proto.surface_index, reason, proto.message)


def _set_ranges(request: pb.RenderIsosurfaceRequest, answer: pb.RenderIsosurfaceResponse) -> None:
    """Sets the ranges of colours that the server has found."""
    if is_asked(request.caps.range) and answer.HasField("caps_coloring"):
        request.caps.range.CopyFrom(answer.caps_coloring.caps.range)
    for coloring in answer.colorings:
        if coloring.surface_index < len(request.surfaces):
            color_by = request.surfaces[coloring.surface_index].color_by
            if is_asked(color_by.range):
                color_by.range.CopyFrom(coloring.color_by.range)


class FrameParts:
    """Puts the parts of RenderIsosurfaceStream together."""

    def __init__(
        self, request: pb.RenderIsosurfaceRequest, make_calls: Callable[[Callable[[Any], Any]], FrameCalls]
    ) -> None:
        self._request = request
        self._make_calls = make_calls
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

    def result(self, do: Callable[[Any], Any] | None) -> Frame:
        """Returns the frame, with the request that gives it again wherever the server had moved the camera.

        It also names the step that was the last one, or the nearest to a time, the level that was drawn, and the ranges
        that the server found.
        """
        again = pb.RenderIsosurfaceRequest()
        again.CopyFrom(self._request)
        again.camera.CopyFrom(self._rest.camera)
        again.ClearField("camera_fit")
        again.ClearField("with_notes")
        again.ClearField("with_unresolved_count")
        _set_ranges(again, self._rest)
        notes = tuple(map(_note, self._rest.notes))
        for note in notes:
            warn_of_surface(note.message)
        if self._rest.HasField("selection"):
            again.selection.CopyFrom(self._rest.selection)
        if self._rest.HasField("drawn_level"):
            again.level.level = self._rest.drawn_level.level
        return Frame(
            width=self._rest.extent.width_px,
            height=self._rest.extent.height_px,
            camera=camera(self._rest.camera),
            stats=statistics(self._rest.statistics),
            colorings=tuple(map(_coloring, self._rest.colorings)),
            caps_coloring=_caps_coloring(_optional(self._rest, "caps_coloring")),
            notes=notes,
            jpeg=self._joined("jpeg") or None,
            **selection(_optional(self._rest, "selection")),
            time=_optional(self._rest, "time"),
            level=_drawn_level(_optional(self._rest, "drawn_level")),
            _png_bytes=self._joined("png"),
            _rgba_bytes=self._joined("rgba8"),
            _planes=self._planes(),
            _request=again,
            _calls=None if do is None else self._make_calls(do),
        )

    def _joined(self, name: str) -> bytes:
        pieces = self._bytes[name]
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)

    def _planes(self) -> Planes:
        """Returns the planes that came, read-only arrays."""
        width, height = self._rest.extent.width_px, self._rest.extent.height_px
        planes: Planes = {}
        for name, (dtype, components) in PLANES.items():
            data = self._joined(name)
            if not data:
                continue
            shape = (height, width) if components == 1 else (height, width, components)
            array = np.frombuffer(data, dtype)
            if array.size != math.prod(shape):
                raise InternalError(f"plane {name!r} has {len(data)} bytes, which is not {shape} of {dtype}")
            planes[name] = array.reshape(shape)
        return planes


def _color_of(surface: pb.Surface) -> Rgba:
    """Returns the colour that a picture of the surface has, where nothing colours it."""
    if not surface.HasField("color"):
        return CLAY
    color = surface.color
    return color.red, color.green, color.blue, color.alpha


class MeshParts:
    """Puts the chunks of ExportIsosurface together."""

    def __init__(self, request: pb.ExportIsosurfaceRequest) -> None:
        surfaces = surfaces_of(request)
        self._isovalues = tuple(math.nan if one.labels else one.isovalue for one in surfaces)
        self._colors = tuple(_color_of(one) for one in surfaces)
        self._parts: tuple[list[bytes], list[bytes], list[bytes]] = ([], [], [])
        self._surfaces: list[int] = []
        self._origin: tuple[float, float, float] | None = None

    def add(self, chunk: pb.ExportIsosurfaceResponse) -> None:
        """Takes the next chunk."""
        for part, data in zip(self._parts, (chunk.positions, chunk.normals, chunk.triangles)):
            part.append(data)
        self._surfaces.append(chunk.surface_index)
        self._origin = _tuple3(chunk.origin) if chunk.HasField("origin") else None

    def result(self, do: Callable[[Any], Any] | None) -> Mesh:
        """Returns the whole mesh."""
        points, normals, triangles = (
            np.frombuffer(b"".join(part), dtype).reshape(-1, 3)
            for part, dtype in zip(self._parts, ("<f4", "<f4", "<i8"))
        )
        counts = [len(data) // 24 for data in self._parts[2]]
        surface = np.repeat(np.array(self._surfaces, np.uint8 if len(self._isovalues) <= 256 else np.int32), counts)
        if self._origin is not None:
            points = points.astype(np.float64) + self._origin
        return Mesh(points, normals, triangles, surface, self._isovalues, self._origin, self._colors)


class MeasuresOfSurfaces:
    """Takes the measures that ExportIsosurface sends without a mesh."""

    def __init__(self, request: pb.ExportIsosurfaceRequest) -> None:
        self._measures: list[SurfaceMeasures | None] = [None] * max(1, len(request.surfaces))

    def add(self, chunk: pb.ExportIsosurfaceResponse) -> None:
        """Takes the next chunk."""
        if chunk.HasField("measures") and 0 <= chunk.surface_index < len(self._measures):
            of = chunk.measures
            self._measures[chunk.surface_index] = SurfaceMeasures(
                of.area, _optional(of, "volume"), of.triangle_count, of.open_edge_count
            )

    def result(self, do: Callable[[Any], Any] | None) -> list[SurfaceMeasures]:
        """Returns the measures of each surface."""
        found = [one for one in self._measures if one is not None]
        if len(found) < len(self._measures):
            raise InternalError("the server did not send the measures of all surfaces")
        return found


def label_values(proto: datasets_pb.GetHistogramResponse) -> LabelValues:
    """Returns the values that samples have, as far as they may be labels."""
    listed = proto.label_values
    return LabelValues(tuple(listed.values), listed.has_more, _optional(listed, "other_value"))


def picked(
    proto: pb.PickSurfaceResponse, pixels: Sequence[tuple[int, int]]
) -> list[PickedPoint | None]:
    """Returns the points at the pixels, in their order; None where it is the background."""
    return [
        PickedPoint(
            pixel=(int(pixel[0]), int(pixel[1])),
            position=_tuple3(point.position),
            normal=_tuple3(point.normal) if point.HasField("normal") else None,
            gradient=_tuple3(point.gradient) if point.HasField("gradient") else None,
            shard_index=_optional(point, "shard_index"),
            label=_optional(point, "label"),
            label_name=point.label_name or None,
            field_values=tuple(
                FieldValue(value.field, value.component, value.unit or None, value.value) for value in point.field_values
            ),
            **_copied(point, "depth", "surface_index", "block_id"),
        )
        if point.is_hit
        else None
        for point, pixel in zip(proto.points, pixels)
    ]
