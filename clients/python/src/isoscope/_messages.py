"""Values become messages of isoscope.v1: cameras, surfaces, clip regions, lights, colours and selections.

The server checks ranges; the types are checked here. An error is an InvalidArgumentError that names the argument, its
value and the allowed values.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, cast

from isoscope._proto import dataset_pb2, frame_pb2, geometry_pb2, options_pb2
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope.camera import Camera, as_vec3
from isoscope.data import DatasetInfo
from isoscope.errors import InvalidArgumentError
from isoscope.labels import Label, color_of, values_of
from isoscope.look import (
    Caps,
    ClipLike,
    ColorByLike,
    ColorLike,
    LightLike,
    Material,
    RangeLike,
    SurfaceLike,
    as_bounds,
    as_clip,
    as_color_by,
    as_light,
    as_plane,
    as_surface,
    parse_color,
)

def _words(values: Any) -> dict[str, int]:
    """Returns the numbers of an enum by its words: COLOR_MAP_COOL_WARM is "cool-warm"."""
    prefix = len(values.DESCRIPTOR.values_by_number[0].name.removesuffix("UNSPECIFIED"))
    return {name[prefix:].lower().replace("_", "-"): number for name, number in values.items() if number != 0}


MAPS = _words(pb.ColorMap)
CULLINGS = _words(frame_pb2.Culling)
FITS = _words(pb.CameraFit)
QUANTITIES = {name: 1 + at for at, name in enumerate(("x", "y", "z", "normal", "gradient", "field"))}
_SPACES = _words(pb.Light.Space)
_RANGE_SOURCES = {"all": 0, **_words(pb.ColorRange.Source)}
_ENDS = {"first": 0, "last": -1}


#: The first look at a dataset, as the proto has it: samples and material where nothing of the camera is given.
FIRST_LOOK: Any = cast(Any, pb.RenderIsosurfaceRequest.DESCRIPTOR.GetOptions()).Extensions[options_pb2.first_look]


def choice(values: dict[str, int], value: Any, name: str) -> int:
    if value not in values:
        raise InvalidArgumentError(f"{name} {value!r}: must be one of {', '.join(map(repr, values))}")
    return values[value]


def as_int(value: Any, name: str) -> int:
    """Returns a whole number that fits the message."""
    try:
        number = int(value)
        exact = number == value
    except (TypeError, ValueError, OverflowError):
        number, exact = 0, False
    if not exact or abs(number) >= 2**31:
        raise InvalidArgumentError(f"{name} {value!r}: must be a whole number")
    return number


def as_number(value: Any, name: str) -> float:
    """Returns a number; the server checks its range."""
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} {value!r}: must be a number") from error


def _vec(value: Iterable[float]) -> geometry_pb2.Vec3:
    x, y, z = value
    return geometry_pb2.Vec3(x=x, y=y, z=z)


def color_message(value: ColorLike, name: str, opacity: float | None = None) -> geometry_pb2.Color:
    red, green, blue, alpha = parse_color(value, name)
    if opacity is not None:
        alpha = as_number(opacity, "surface opacity")
    return geometry_pb2.Color(red=red, green=green, blue=blue, alpha=alpha)


#: The effects of a frame: the fields of its request that have effect_options.
EFFECTS = tuple(
    field.name
    for field in pb.RenderIsosurfaceRequest.DESCRIPTOR.fields
    if field.GetOptions().HasExtension(options_pb2.effect_options)
)


def set_effect(message: Any, effect: Any, name: str) -> None:
    """Turns an effect on, and sets the fields that `effect` has as attributes: radius_px is its radius."""
    message.SetInParent()
    for field in message.DESCRIPTOR.fields:
        attribute = field.name.removesuffix("_px")
        value = getattr(effect, attribute, None)
        what = f"{name} {attribute}"
        if value is None:
            continue
        if field.message_type is not None:
            getattr(message, field.name).CopyFrom(color_message(value, what))
        elif field.cpp_type == field.CPPTYPE_INT32:
            setattr(message, field.name, as_int(value, what))
        else:
            setattr(message, field.name, as_number(value, what))


def surfaces_of(request: Any) -> list[pb.Surface]:
    """Returns the surfaces of a frame or a mesh, also the only one of an isovalue."""
    if request.surfaces:
        return list(request.surfaces)
    only = pb.Surface(isovalue=request.isovalue)
    if isinstance(request, pb.RenderIsosurfaceRequest) and request.HasField("base_color"):
        only.color.CopyFrom(request.base_color)
    return [only]


def as_pair(values: Sequence[float], name: str) -> tuple[float, float]:
    try:
        lower, upper = (float(value) for value in values)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} {values!r}: must be two numbers (min, max)") from error
    return lower, upper


def _range(values: Sequence[float], name: str) -> pb.ColorRange:
    lower, upper = as_pair(values, name)
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
    return value if isinstance(value, str) else str(as_int(value, "component"))


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


def selection_message(
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
        proto.time = as_number(time, "time")
    elif step is not None:
        proto.time_step = _ENDS[step] if isinstance(step, str) and step in _ENDS else as_int(step, "step")
    return proto


def color_by_message(like: ColorByLike) -> pb.ColorBy | None:
    value = as_color_by(like)
    if value is None:
        return None
    proto = pb.ColorBy(quantity=cast(Any, choice(QUANTITIES, value.quantity, "color_by quantity")))
    if (value.quantity == "field") != (value.field is not None):
        raise InvalidArgumentError(
            "color_by: give either a quantity such as ColorBy('z'), or a field: ColorBy(field='temperature')"
        )
    if value.field is not None:
        proto.field, proto.component = _field_and_component(value.field, value.component)
    elif value.component is not None:
        raise InvalidArgumentError(f"color_by component {value.component!r}: only a field has one")
    if value.map is not None:
        proto.color_map = cast(Any, choice(MAPS, value.map, "color_by map"))
    color_range = None if value.range is None else _range_or_source(value.range, "color_by range")
    if color_range is not None:
        proto.range.CopyFrom(color_range)
    if value.opacity is not None:
        at_min, at_max = as_pair(value.opacity, "color_by opacity")
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
        if value.smooth:
            raise InvalidArgumentError("surface smooth: must have labels; an isosurface has no steps between labels")
        proto = pb.Surface(isovalue=as_number(value.isovalue, "surface isovalue"))
    else:
        proto = pb.Surface(labels=values_of(value.labels, labels), smooth_labels=bool(value.smooth))
        default_color = color_of(proto.labels, labels)
    if value.color is not None or value.opacity is not None or proto.labels:
        color = default_color if value.color is None else value.color
        proto.color.CopyFrom(color_message(color, "surface color", value.opacity))
    if value.material is not None:
        proto.material.CopyFrom(_material(value.material))
    color_by = None if value.color_by is None else color_by_message(value.color_by)
    if color_by is not None:
        proto.color_by.CopyFrom(color_by)
    return proto


def _material(value: Material) -> pb.Material:
    proto = pb.Material()
    for name in ("ambient", "diffuse", "specular", "shininess"):
        number = getattr(value, name)
        if number is not None:
            setattr(proto, name, as_number(number, f"material {name}"))
    return proto


def _range_or_source(value: RangeLike, name: str) -> pb.ColorRange | None:
    """Returns the message of a range; None for "all", the server's default."""
    if not isinstance(value, str):
        return _range(value, name)
    source = choice(_RANGE_SOURCES, value, name)
    return pb.ColorRange(source=cast(Any, source)) if source else None


def _range_of_caps(caps: Caps) -> pb.ColorRange | None:
    if caps.map is None or caps.range is not None:
        return None if caps.range is None else _range_or_source(caps.range, "caps range")
    if caps.window is None:
        return None
    low, high = as_pair(caps.window, "caps window")
    if not 0 <= low < high <= 100:
        raise InvalidArgumentError(f"caps window {caps.window!r}: must be two percentages, 0 <= low < high <= 100")
    return pb.ColorRange(percentiles=pb.Percentiles(low=low, high=high))


def clip_messages(clip: ClipLike) -> tuple[pb.ClipRegion, pb.ClipCaps | None]:
    """Returns the messages of a region and of its caps."""
    value = as_clip(clip)
    proto = pb.ClipRegion()
    for plane in map(as_plane, value.planes):
        proto.half_spaces.add(
            normal=_vec(as_vec3(plane.normal, "clip plane normal")), offset=as_number(plane.offset, "clip plane offset")
        )
    if value.box is not None:
        x0, x1, y0, y1, z0, z1 = as_bounds(value.box)
        proto.box.CopyFrom(geometry_pb2.Box(min=_vec((x0, y0, z0)), max=_vec((x1, y1, z1))))
    caps: pb.ClipCaps | None = None
    if value.caps:
        caps = pb.ClipCaps()
        if isinstance(value.caps, Caps):
            if value.caps.map is not None:
                caps.color_map = cast(Any, choice(MAPS, value.caps.map, "caps map"))
            caps_range = _range_of_caps(value.caps)
            if caps_range is not None:
                caps.range.CopyFrom(caps_range)
    return proto, caps


def light_message(light: LightLike) -> pb.Light:
    value = as_light(light)
    proto = pb.Light(direction=_vec(as_vec3(value.direction, "light direction")))
    proto.intensity = as_number(value.intensity, "light intensity")
    proto.space = cast(Any, choice(_SPACES, value.space, "light space"))
    if value.color is not None:
        proto.color.CopyFrom(color_message(value.color, "light color"))
    return proto


def as_ints(values: Any, name: str, shape: str, count: int) -> tuple[int, ...]:
    try:
        numbers = tuple(int(value) for value in values)
        exact = all(number == value for number, value in zip(numbers, values))
    except (TypeError, ValueError, OverflowError):
        numbers, exact = (), False
    if len(numbers) != count or not exact or any(abs(number) >= 2**31 for number in numbers):
        raise InvalidArgumentError(f"{name} {values!r}: must be {shape}, whole numbers of pixels")
    return numbers
