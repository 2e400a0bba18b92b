"""Requests: checked arguments become messages of isoscope.v1. The server checks ranges; the types are checked here.

1. `frame` sets what a frame or a pick sees: dataset, surfaces, camera, size, clip region.
2. `set_appearance` adds colours, lights and effects; `set_output` adds formats and planes.
3. `plane`, `pick`, `export` and `histogram` make the other requests.

An error is an InvalidArgumentError that names the argument, its value and the allowed values.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np

from isoscope._proto import dataset_pb2, geometry_pb2
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope.camera import Camera, CameraLike, as_camera, as_vec3
from isoscope.data import Capabilities, DatasetInfo
from isoscope.errors import FailedPreconditionError, InvalidArgumentError
from isoscope.frame import PlaneName
from isoscope.labels import Label, LabelsLike, as_label_sets, color_of, values_of
from isoscope.look import (
    AmbientOcclusion,
    Caps,
    ClipLike,
    ColorByLike,
    ColorLike,
    LightLike,
    Material,
    Silhouette,
    Surface,
    SurfaceLike,
    as_bounds,
    as_clip,
    as_color_by,
    as_light,
    as_lights,
    as_plane,
    as_surface,
    parse_color,
)

MAPS = {name: 1 + at for at, name in enumerate(("viridis", "magma", "cividis", "turbo", "cool-warm", "grey"))}
QUANTITIES = {name: 1 + at for at, name in enumerate(("x", "y", "z", "normal", "gradient", "field"))}
_SPACES = {"view": 1, "world": 2}
_CULLINGS = {"depth": 1, "mask": 2, "none": 3}
_FORMATS = {"png": 1, "jpeg": 2, "rgba": 3, "none": 4}
_ENDS = {"first": 0, "last": -1}
_FITS = {"volume": 1, "surface": 2}
#: The most surfaces of a frame; servers of 0.1 take 16.
MAX_SURFACES = 128
#: Type and components of a pixel of each plane.
PLANES: dict[str, tuple[str, int]] = {
    "depth": ("<f4", 1),
    "surface_index": ("u1", 1),
    "position": ("<f4", 3),
    "normal": ("<f4", 3),
}


def _choice(values: dict[str, int], value: Any, name: str) -> int:
    if value not in values:
        raise InvalidArgumentError(f"{name} {value!r}: must be one of {', '.join(map(repr, values))}")
    return values[value]


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


def camera_message(camera: Camera) -> geometry_pb2.Camera:
    """Returns the message of a camera; its numbers keep their bits."""
    proto = geometry_pb2.Camera(eye=_vec(camera.eye), target=_vec(camera.target), up=_vec(camera.up))
    if camera.height is not None:
        proto.orthographic.height = camera.height
    else:
        proto.perspective.fov_y_degrees = camera.fov_y
    return proto


def _component(value: str | int) -> str:
    return value if isinstance(value, str) else str(_int(value, "component"))


def _field_and_component(
    field: str, component: str | int | None, names: Sequence[str] = ()
) -> tuple[str, str]:
    """Returns the two names, also of "velocity:x", unless that is one of `names`."""
    if not isinstance(field, str) or not field:
        raise InvalidArgumentError(f"field {field!r}: must be the name of a field, such as 'velocity' or 'velocity:x'")
    if field in names or ":" not in field:
        return field, "" if component is None else _component(component)
    name, _, of_name = field.rpartition(":")
    if component is not None:
        raise InvalidArgumentError(f"field {field!r} names a component, and component {component!r} another: give one")
    return name, of_name


def _selection(
    dataset: DatasetInfo, field: str | None, component: str | int | None, time: float | None, step: int | str | None
) -> dataset_pb2.FieldSelection | None:
    """Returns the message of what is drawn and when; None if nothing is named. The server checks the names."""
    if field is None and component is None and time is None and step is None:
        return None
    proto = dataset_pb2.FieldSelection()
    if field is not None:
        proto.field, proto.component = _field_and_component(field, component, [one.name for one in dataset.fields])
    elif component is not None:
        proto.component = _component(component)
    if time is not None and step is not None:
        raise InvalidArgumentError(f"time {time!r} and step {step!r} can't be given together: both name a time step")
    if time is not None:
        proto.time = _number(time, "time")
    elif step is not None:
        proto.time_step = _ENDS[step] if isinstance(step, str) and step in _ENDS else _int(step, "step")
    return proto


def _color_by(like: ColorByLike) -> pb.ColorBy | None:
    value = as_color_by(like)
    if value is None:
        return None
    proto = pb.ColorBy(quantity=cast(Any, _choice(QUANTITIES, value.quantity, "color_by quantity")))
    if (value.quantity == "field") != (value.field is not None):
        raise InvalidArgumentError(
            "color_by: give either a quantity such as ColorBy('z'), or a field: ColorBy(field='temperature')"
        )
    if value.field is not None:
        proto.field, proto.component = _field_and_component(value.field, value.component)
    elif value.component is not None:
        raise InvalidArgumentError(f"color_by component {value.component!r}: only a field has one")
    if value.map is not None:
        proto.color_map = cast(Any, _choice(MAPS, value.map, "color_by map"))
    if value.range is not None:
        proto.range.CopyFrom(_range(value.range, "color_by range"))
    if value.opacity is not None:
        at_min, at_max = _pair(value.opacity, "color_by opacity")
        proto.opacity.CopyFrom(pb.MapOpacity(at_min=at_min, at_max=at_max))
    return proto


#: The server's default colour, for surfaces that set only an opacity.
_CLAY = (222 / 255, 209 / 255, 190 / 255)


def surface_message(
    surface: SurfaceLike, default_color: ColorLike = _CLAY, labels: Sequence[Label] = ()
) -> pb.Surface:
    """Returns the message of a surface. `labels` are those of the dataset."""
    value = as_surface(surface)
    if (value.isovalue is None) == (value.labels is None):
        raise InvalidArgumentError("surface: must have either an isovalue or labels")
    if value.labels is None:
        proto = pb.Surface(isovalue=_number(value.isovalue, "surface isovalue"))
    else:
        proto = pb.Surface(labels=values_of(value.labels, labels))
        default_color = color_of(proto.labels, labels)
    if value.color is not None or value.opacity is not None or proto.labels:
        color = default_color if value.color is None else value.color
        proto.color.CopyFrom(_color(color, "surface color", value.opacity))
    if value.material is not None:
        proto.material.CopyFrom(_material(value.material))
    color_by = None if value.color_by is None else _color_by(value.color_by)
    if color_by is not None:
        proto.color_by.CopyFrom(color_by)
    return proto


def _material(value: Material) -> pb.Material:
    proto = pb.Material()
    for name in ("ambient", "diffuse", "specular", "shininess"):
        number = getattr(value, name)
        if number is not None:
            setattr(proto, name, _number(number, f"material {name}"))
    return proto


def clip_messages(clip: ClipLike) -> tuple[pb.ClipRegion, pb.ClipCaps | None]:
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
                caps.color_map = cast(Any, _choice(MAPS, value.caps.map, "caps map"))
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
    request: Any,
    dataset: DatasetInfo,
    isovalue: float | None,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None,
    labels: LabelsLike | None,
) -> None:
    if (isovalue is not None and surfaces is not None) or (isovalue is None and surfaces is None and labels is None):
        raise InvalidArgumentError(
            "give isovalue=... for one surface, surfaces=[isoscope.Surface(...), ...], or labels=[3, 7, ...]"
            + ("" if isovalue is None else ", and of isovalue and surfaces not both")
        )
    if surfaces is None and labels is None:
        request.isovalue = _number(isovalue, "isovalue")
        return
    several: list[SurfaceLike] = [] if isovalue is None else [isovalue]
    if surfaces is not None:
        several += surfaces if isinstance(surfaces, Iterable) else [surfaces]
    if labels is not None:
        several += [Surface(labels=one) for one in as_label_sets(labels)]
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
    field: str | None = None,
    component: str | int | None = None,
    time: float | None = None,
    step: int | str | None = None,
) -> pb.RenderIsosurfaceRequest:
    """Returns the request for what a frame or a pick sees: surfaces, camera, size, clip region, field and time."""
    selection = _selection(dataset, field, component, time, step)
    request = pb.RenderIsosurfaceRequest(dataset=dataset.name, selection=selection)
    _set_surfaces(request, dataset, isovalue, surfaces, labels)
    request.camera.CopyFrom(camera_message(_camera_of(dataset, camera, view, azimuth, elevation, zoom, fit)))
    request.camera_fit = cast(Any, _choice(_FITS, fit, "fit"))
    sides = (size, size) if isinstance(size, (int, np.integer)) else size
    width, height = _integers(sides, "size", "(width, height)", 2)
    request.viewport.CopyFrom(geometry_pb2.Viewport(width_px=width, height_px=height))
    if region is not None:
        x, y, w, h = _integers(region, "region", "(x, y, width, height)", 4)
        request.region.CopyFrom(geometry_pb2.Region(x=x, y=y, width_px=w, height_px=h))
    if clip is not None:
        clip_region, caps = clip_messages(clip)
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
    color_by: ColorByLike | None,
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
    coloring = None if color_by is None else _color_by(color_by)
    if coloring is not None:
        _set_color_by(request, coloring)
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


def _set_color_by(request: pb.RenderIsosurfaceRequest, color_by: pb.ColorBy) -> None:
    """Colours all surfaces that have no color_by of their own."""
    if not request.surfaces:
        surface = request.surfaces.add(isovalue=request.isovalue)
        request.ClearField("isovalue")
        if request.HasField("base_color"):
            surface.color.CopyFrom(request.base_color)
            request.ClearField("base_color")
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
    request.output.image_format = cast(Any, _choice(_FORMATS, image_format, "format"))
    if quality is not None:
        request.output.jpeg_quality = _int(quality, "quality")
    for plane in wanted:
        setattr(request.output, plane, True)


def plane(request: pb.RenderIsosurfaceRequest, plane: PlaneName) -> pb.RenderIsosurfaceRequest:
    """Returns the request for one more plane of the frame that `request` asked for."""
    more = pb.RenderIsosurfaceRequest()
    more.CopyFrom(request)
    more.ClearField("output")
    more.output.image_format = cast(Any, _FORMATS["none"])
    setattr(more.output, plane, True)
    # Planes depend on none of these, and with several samples NONE would draw them for nothing.
    for field in ("ambient_occlusion", "silhouette", "samples"):
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
        x, y = _integers(pixel, "pixel", "(column, row)", 2)
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
) -> pb.ExportIsosurfaceRequest:
    """Returns the request for a mesh."""
    selection = _selection(dataset, field, component, time, step)
    request = pb.ExportIsosurfaceRequest(dataset=dataset.name, selection=selection)
    _set_surfaces(request, dataset, isovalue, surfaces, labels)
    if clip is not None:
        clip_region, caps = clip_messages(clip)
        if caps is not None:
            raise InvalidArgumentError("clip caps: meshes are open where they are cut; leave caps out")
        request.clip.CopyFrom(clip_region)
    return request


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
    selection = _selection(dataset, field, component, time, step)
    request = datasets_pb.GetHistogramRequest(
        dataset=dataset.name, max_bin_count=_int(bins, "bins"), selection=selection
    )
    if values is not None:
        lower, upper = _pair(values, "histogram range")
        request.value_range.CopyFrom(dataset_pb2.ValueRange(min=lower, max=upper))
    return request


def expect_dataset(
    request: pb.RenderIsosurfaceRequest | pb.ExportIsosurfaceRequest | datasets_pb.GetHistogramRequest,
    dataset: DatasetInfo,
    capabilities: Capabilities | None,
) -> None:
    """Lets a request fail if the name has other contents by now. Older servers refuse the field."""
    if capabilities is not None and "dataset_id" in capabilities.features:
        request.dataset_id = dataset.id
    surfaces = [] if isinstance(request, datasets_pb.GetHistogramRequest) else request.surfaces
    if capabilities is not None and "labels" not in capabilities.features and any(one.labels for one in surfaces):
        raise FailedPreconditionError(
            f"the server, version {capabilities.version}, does not know surfaces of labels: it is older than the client"
        )
