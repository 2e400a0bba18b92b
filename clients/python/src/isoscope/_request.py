"""Requests: checked arguments become messages of isoscope.v1. The server checks ranges; the types are checked here.

1. `frame` sets what a frame or a pick sees: dataset, surfaces, camera, size, clip region.
2. `set_appearance` adds colours, lights and effects; `set_output` adds formats and planes.
3. `plane`, `pick`, `export` and `histogram` make the other requests.

An error is an InvalidArgumentError that names the argument, its value and the allowed values.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, cast

import numpy as np

from isoscope._messages import (
    CULLINGS,
    EFFECTS,
    FIRST_LOOK,
    FITS,
    as_int,
    as_ints,
    as_number,
    as_pair,
    camera_message,
    choice,
    clip_messages,
    color_by_message,
    color_message,
    light_message,
    selection_message,
    set_effect,
    surface_message,
    surfaces_of,
)
from isoscope._proto import dataset_pb2, geometry_pb2
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope.camera import Camera, CameraLike, as_camera
from isoscope.data import Capabilities, DatasetInfo
from isoscope.errors import FailedPreconditionError, InvalidArgumentError
from isoscope.frame import PlaneName
from isoscope.labels import LabelsLike, as_label_sets
from isoscope.look import (
    DEFAULT_WINDOW,
    ClipLike,
    ColorByLike,
    ColorLike,
    LightLike,
    Surface,
    SurfaceLike,
    as_lights,
)

_FORMATS = {"png": 1, "jpeg": 2, "rgba": 3, "none": 4}
# The side of a picture that is drawn for its notes alone, in pixels.
_EMPTY_SIDE = 64
# A first look that is drawn with at most this side has its samples: as `isoscope render`.
_MAX_DRAWN_SIDE = 65536
#: The most surfaces of a frame.
MAX_SURFACES = 128
#: Type and components of a pixel of each plane.
PLANES: dict[str, tuple[str, int]] = {
    "depth": ("<f4", 1),
    "surface_index": ("u1", 1),
    "position": ("<f4", 3),
    "normal": ("<f4", 3),
    "depth_bounds": ("<f4", 2),
}


def asks_first_look(
    camera: CameraLike | None = None,
    view: str | None = None,
    azimuth: float | None = None,
    elevation: float | None = None,
    zoom: float | None = None,
    fit: str | None = None,
) -> bool:
    """Whether nothing of the camera is given."""
    return all(given is None for given in (camera, view, azimuth, elevation, zoom, fit))


def _camera_of(
    dataset: DatasetInfo,
    camera: CameraLike | None,
    view: str | None,
    azimuth: float | None,
    elevation: float | None,
    zoom: float | None,
    fit: str | None,
) -> Camera:
    """Returns the camera of a request, before the server fits it to the surface."""
    if asks_first_look(camera, view, azimuth, elevation, zoom, fit):
        if dataset.patient_frame:
            return dataset.camera("anterior")
        return dataset.camera("front", FIRST_LOOK.azimuth_degrees, FIRST_LOOK.elevation_degrees)
    turn = (azimuth or 0, elevation or 0, 1 if zoom is None else zoom)
    if camera is None:
        return dataset.camera(view or "front", *turn)
    if view is not None or fit not in (None, "volume"):
        raise InvalidArgumentError(
            f"camera can't be given with {'view' if view is not None else f'fit={fit!r}'}, which places the camera"
        )
    turned = as_camera(camera)
    turned = turned.azimuth(turn[0]) if turn[0] else turned
    turned = turned.elevation(turn[1]) if turn[1] else turned
    return turned.zoom(turn[2]) if turn[2] != 1 else turned


def _set_surfaces(
    request: Any,
    dataset: DatasetInfo,
    isovalue: float | None,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None,
    labels: LabelsLike | None,
    smooth_labels: bool,
) -> None:
    if (isovalue is not None and surfaces is not None) or (isovalue is None and surfaces is None and labels is None):
        raise InvalidArgumentError(
            "give isovalue=... for one surface, surfaces=[isoscope.Surface(...), ...], or labels=[3, 7, ...]"
            + ("" if isovalue is None else ", and of isovalue and surfaces not both")
        )
    if smooth_labels and labels is None:
        raise InvalidArgumentError("smooth_labels smooths the surfaces of labels: give labels, or Surface(smooth=True)")
    if surfaces is None and labels is None:
        request.isovalue = as_number(isovalue, "isovalue")
        return
    several: list[SurfaceLike] = [] if isovalue is None else [isovalue]
    if surfaces is not None:
        several += surfaces if isinstance(surfaces, Iterable) else [surfaces]
    if labels is not None:
        several += [Surface(labels=one, smooth=smooth_labels) for one in as_label_sets(labels)]
    request.surfaces.extend(surface_message(surface, labels=dataset.labels) for surface in several)
    if not request.surfaces:
        raise InvalidArgumentError(f"surfaces is empty: give 1 to {MAX_SURFACES} surfaces")
    if len(request.surfaces) > MAX_SURFACES:
        raise InvalidArgumentError(f"there are {len(request.surfaces)} surfaces: give 1 to {MAX_SURFACES}")


def frame(
    dataset: DatasetInfo,
    isovalue: float | None,
    *,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
    labels: LabelsLike | None = None,
    smooth_labels: bool = False,
    camera: CameraLike | None = None,
    view: str | None = None,
    azimuth: float | None = None,
    elevation: float | None = None,
    zoom: float | None = None,
    fit: str | None = None,
    size: tuple[int, int] | int = (1024, 1024),
    region: tuple[int, int, int, int] | None = None,
    clip: ClipLike | None = None,
    max_layers: int | None = None,
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | str | None = None,
    capabilities: Capabilities | None = None,
) -> pb.RenderIsosurfaceRequest:
    """Returns the request for what a frame or a pick sees: surfaces, camera, size, clip region, field and time.

    `capabilities`: of the server. A first look leaves the camera to servers that can fit it to the surface's cells.
    """
    selection = selection_message(dataset, field, component, time, step)
    request = pb.RenderIsosurfaceRequest(dataset=dataset.name, selection=selection)
    _set_surfaces(request, dataset, isovalue, surfaces, labels, smooth_labels)
    is_first_look = asks_first_look(camera, view, azimuth, elevation, zoom, fit)
    if is_first_look and capabilities is not None and "fit_cells" in capabilities.features:
        request.camera_fit = cast(Any, FITS["cells"])
    else:
        request.camera.CopyFrom(camera_message(_camera_of(dataset, camera, view, azimuth, elevation, zoom, fit)))
        request.camera_fit = cast(Any, choice(FITS, "volume" if fit is None else fit, "fit"))
    sides = (size, size) if isinstance(size, (int, np.integer)) else size
    width, height = as_ints(sides, "size", "(width, height)", 2)
    request.viewport.CopyFrom(geometry_pb2.Viewport(width_px=width, height_px=height))
    if region is not None:
        x, y, w, h = as_ints(region, "region", "(x, y, width, height)", 4)
        request.region.CopyFrom(geometry_pb2.Region(x=x, y=y, width_px=w, height_px=h))
    if clip is not None:
        clip_region, caps = clip_messages(clip)
        request.clip.CopyFrom(clip_region)
        if caps is not None:
            request.caps.CopyFrom(caps)
    if max_layers is not None:
        request.max_layers = as_int(max_layers, "max_layers")
    return request


def set_appearance(
    request: pb.RenderIsosurfaceRequest,
    *,
    color: ColorLike | None,
    background: ColorLike | None,
    lights: Sequence[LightLike] | LightLike,
    color_by: ColorByLike | None,
    nan_color: ColorLike | None,
    samples: int | None,
    culling: str,
    effects: Mapping[str, Any],
) -> None:
    """Adds what decides colours. `effects`: by the name of their field."""
    if color is not None:
        if request.surfaces:
            raise InvalidArgumentError("color is that of the only surface: with surfaces, write Surface(V, color=...)")
        request.base_color.CopyFrom(color_message(color, "color"))
    coloring = None if color_by is None else color_by_message(color_by)
    if coloring is not None:
        _set_color_by(request, coloring)
    if nan_color is not None:
        request.nan_color.CopyFrom(color_message(nan_color, "nan_color"))
    if background is not None:
        request.background_color.CopyFrom(color_message(background, "background"))
    request.lights.extend(map(light_message, as_lights(lights)))
    if samples is not None:
        request.samples = as_int(samples, "samples")
    for name, effect in effects.items():
        if effect:
            set_effect(getattr(request, name), effect, name)
    request.culling = cast(Any, choice(CULLINGS, culling, "culling"))


def set_level(
    request: pb.RenderIsosurfaceRequest, level: int | None, max_spacing: float | None, capabilities: Capabilities | None
) -> None:
    """Adds the choice of a level. Without one, a request is as it was before there were levels."""
    if level is not None and max_spacing is not None:
        raise InvalidArgumentError("level and max_spacing exclude each other: both choose the level")
    if level is not None:
        request.level.level = _level_number(level)
    elif max_spacing is not None:
        try:
            request.level.max_spacing_px = float(max_spacing)
        except (TypeError, ValueError):
            raise InvalidArgumentError(f"max_spacing {max_spacing!r}: must be a number of pixels, above 0") from None
    if request.HasField("level"):
        _expect_levels(capabilities)


def set_mesh_level(request: pb.ExportIsosurfaceRequest, level: int, capabilities: Capabilities | None) -> None:
    """Sets the level of a mesh."""
    request.level = _level_number(level)
    if request.level:
        _expect_levels(capabilities)


def _level_number(level: int) -> int:
    number = as_int(level, "level")
    if number < 0:
        raise InvalidArgumentError(f"level {level!r}: must be 0 or one of Dataset.levels")
    return number


def _expect_levels(capabilities: Capabilities | None) -> None:
    if capabilities is not None and "levels" not in capabilities.features:
        raise FailedPreconditionError(
            f"the server, version {capabilities.version}, does not know levels: it is older than the client"
        )


def set_first_look(request: pb.RenderIsosurfaceRequest) -> None:
    """Adds samples and material of the first look, where they are not given. What could not be drawn with more keeps one sample."""
    side = math.isqrt(FIRST_LOOK.samples)
    width, height = request.viewport.width_px, request.viewport.height_px
    if not request.samples and max(width, height) * side <= _MAX_DRAWN_SIDE:
        request.samples = FIRST_LOOK.samples
    _list_surfaces(request)
    for surface in request.surfaces:
        if not surface.HasField("material"):
            for name in ("diffuse", "specular", "shininess"):
                setattr(surface.material, name, getattr(FIRST_LOOK, name))


def _list_surfaces(request: pb.RenderIsosurfaceRequest) -> None:
    """Makes the only surface of a request, by its isovalue, the first of its list."""
    if not request.surfaces:
        request.surfaces.extend(surfaces_of(request))
        request.ClearField("isovalue")
        request.ClearField("base_color")


def _set_color_by(request: pb.RenderIsosurfaceRequest, color_by: pb.ColorBy) -> None:
    """Colours all surfaces that have no color_by of their own."""
    _list_surfaces(request)
    for surface in request.surfaces:
        if not surface.HasField("color_by"):
            surface.color_by.CopyFrom(color_by)


def set_output(
    request: pb.RenderIsosurfaceRequest, image_format: str, quality: int | None, planes: Sequence[str]
) -> None:
    """Adds what comes back."""
    wanted = [planes] if isinstance(planes, str) else list(planes)
    for plane in wanted:
        if plane not in PLANES:
            raise InvalidArgumentError(f"plane {plane!r}: must be one of {', '.join(map(repr, PLANES))}")
    if image_format == "png" and not wanted and quality is None:
        return
    request.output.image_format = cast(Any, choice(_FORMATS, image_format, "format"))
    if quality is not None:
        request.output.jpeg_quality = as_int(quality, "quality")
    for plane in wanted:
        setattr(request.output, plane, True)


def ask_for_notes(request: pb.RenderIsosurfaceRequest, capabilities: Capabilities | None) -> None:
    """Asks why surfaces do not show. Older servers refuse the field."""
    request.with_notes = capabilities is not None and "notes" in capabilities.features


def plane(request: pb.RenderIsosurfaceRequest, plane: PlaneName) -> pb.RenderIsosurfaceRequest:
    """Returns the request for one more plane of the frame that `request` asked for."""
    more = pb.RenderIsosurfaceRequest()
    more.CopyFrom(request)
    more.ClearField("output")
    more.output.image_format = cast(Any, _FORMATS["none"])
    setattr(more.output, plane, True)
    # Planes depend on none of these, and with several samples NONE would draw them for nothing.
    for field in (*EFFECTS, "samples"):
        more.ClearField(cast(Any, field))
    return more


def pick(
    request: pb.RenderIsosurfaceRequest, pixels: Sequence[tuple[int, int]], all_fields: bool = False
) -> pb.PickSurfaceRequest:
    """Returns the request for what pixels of the frame show, counted in its whole viewport."""
    pick = pb.PickSurfaceRequest(frame=request, with_field_values=all_fields)
    pick.frame.ClearField("output")
    pick.frame.ClearField("region")
    for pixel in pixels:
        x, y = as_ints(pixel, "pixel", "(column, row)", 2)
        pick.pixels.add(x=x, y=y)
    return pick


def export(
    dataset: DatasetInfo,
    isovalue: float | None,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None,
    clip: ClipLike | None,
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | str | None = None,
    labels: LabelsLike | None = None,
    smooth_labels: bool = False,
    closed: bool = False,
    capabilities: Capabilities | None = None,
) -> pb.ExportIsosurfaceRequest:
    """Returns the request for a mesh."""
    selection = selection_message(dataset, field, component, time, step)
    request = pb.ExportIsosurfaceRequest(dataset=dataset.name, selection=selection)
    _set_surfaces(request, dataset, isovalue, surfaces, labels, smooth_labels)
    if clip is not None:
        clip_region, caps = clip_messages(clip)
        if caps is not None:
            raise InvalidArgumentError("clip caps are those of pictures: closed=True closes a mesh; leave caps out")
        request.clip.CopyFrom(clip_region)
    if capabilities is not None and "closed_meshes" in capabilities.features:
        request.closes = bool(closed)
        request.with_origin = True
    elif closed:
        raise FailedPreconditionError("closed: the server does not close meshes, it is older than this client")
    return request


def measure(request: pb.ExportIsosurfaceRequest) -> pb.ExportIsosurfaceRequest:
    """Returns the request for the measures of a mesh, alone."""
    if not request.with_origin:
        raise FailedPreconditionError("measure: the server does not measure surfaces, it is older than this client")
    request.with_measures = request.without_mesh = True
    return request


def frame_of_empty(request: pb.ExportIsosurfaceRequest, filled: set[int]) -> pb.RenderIsosurfaceRequest:
    """Returns the request for a small picture of those surfaces of a mesh that are not among `filled`."""
    empty = [surface for at, surface in enumerate(surfaces_of(request)) if at not in filled]
    frame = pb.RenderIsosurfaceRequest(
        dataset=request.dataset, dataset_id=request.dataset_id, surfaces=empty[:MAX_SURFACES],
        viewport=geometry_pb2.Viewport(width_px=_EMPTY_SIDE, height_px=_EMPTY_SIDE),
    )  # fmt: skip
    for name in ("clip", "selection"):
        if request.HasField(cast(Any, name)):
            getattr(frame, name).CopyFrom(getattr(request, name))
    return frame


def histogram(
    dataset: DatasetInfo,
    bins: int,
    values: tuple[float, float] | None,
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | str | None = None,
) -> datasets_pb.GetHistogramRequest:
    """Returns the request for a histogram."""
    selection = selection_message(dataset, field, component, time, step)
    request = datasets_pb.GetHistogramRequest(
        dataset=dataset.name, max_bin_count=as_int(bins, "bins"), selection=selection
    )
    if values is not None:
        lower, upper = as_pair(values, "histogram range")
        request.value_range.CopyFrom(dataset_pb2.ValueRange(min=lower, max=upper))
    return request


def is_asked(color_range: pb.ColorRange) -> bool:
    """Whether the server finds the ends of a range."""
    return bool(color_range.source) or color_range.HasField("percentiles")


def _leave_out_ranges(request: pb.RenderIsosurfaceRequest, capabilities: Capabilities | None) -> None:
    """Leaves out the window of caps that nobody asked for: older servers refuse the field."""
    window = request.caps.range.percentiles
    if request.caps.range.HasField("percentiles") and (window.low, window.high) == DEFAULT_WINDOW:
        request.caps.ClearField("range")
    ranges = [request.caps.range, *(surface.color_by.range for surface in request.surfaces)]
    if capabilities is not None and any(map(is_asked, ranges)):
        raise FailedPreconditionError(
            f"the server, version {capabilities.version}, does not know ranges of colours but by numbers: it is older "
            "than the client"
        )


def expect_dataset(
    request: pb.RenderIsosurfaceRequest | pb.ExportIsosurfaceRequest | datasets_pb.GetHistogramRequest,
    dataset: DatasetInfo,
    capabilities: Capabilities | None,
) -> None:
    """Lets a request fail if the name has other contents by now. Older servers refuse the field."""
    if capabilities is not None and "dataset_id" in capabilities.features:
        request.dataset_id = dataset.id
    if isinstance(request, pb.RenderIsosurfaceRequest) and (
        capabilities is None or "color_ranges" not in capabilities.features
    ):
        _leave_out_ranges(request, capabilities)
    surfaces = [] if isinstance(request, datasets_pb.GetHistogramRequest) else request.surfaces
    if capabilities is not None and "labels" not in capabilities.features and any(one.labels for one in surfaces):
        raise FailedPreconditionError(
            f"the server, version {capabilities.version}, does not know surfaces of labels: it is older than the client"
        )
    if capabilities is not None and "smooth_labels" not in capabilities.features and any(
        one.smooth_labels for one in surfaces
    ):
        raise FailedPreconditionError(
            f"the server, version {capabilities.version}, does not smooth labels: it is older than the client"
        )
