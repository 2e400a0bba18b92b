"""The appearance of a picture: surfaces, colours, lights, clipping, effects. Plain values, checked by the server.

    Surface(30, color="tan", opacity=0.35, color_by=ColorBy("gradient"))
    Light((1, 1, 1), intensity=0.8)
    Clip(planes=[Plane.through((0, 0, 40), (0, 0, 1))], caps=True)

The functions `as_...` accept the short forms of these values: an isovalue, a direction, six numbers.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Union, cast, get_args

from isoscope._proto import isosurface_service_pb2 as pb
from isoscope._proto import options_pb2
from isoscope.camera import Vec3, as_vec3
from isoscope.errors import InvalidArgumentError
from isoscope.labels import LabelLike

__all__ = ["AmbientOcclusion", "Caps", "Clip", "ColorBy", "Light", "Material", "Plane", "Silhouette", "Surface"]

#: "#rrggbb", "#rrggbbaa", "#rgb", "#rgba", a name of CSS such as "ivory", or red, green, blue(, alpha) in [0, 1], sRGB.
ColorLike = Union[str, Sequence[float]]
#: Colour maps of 256 colours.
ColorMap = Literal["viridis", "magma", "cividis", "turbo", "cool-warm", "grey"]
#: Percentiles of the samples that caps with a map show.
DEFAULT_WINDOW = (2.0, 98.0)
#: Ends of a colour map: two values, or those of what the picture shows, of the step that is drawn, or of all steps.
RangeLike = Union["tuple[float, float]", Literal["visible", "step", "all"]]
# Quantities of `ColorBy`: world coordinates, normals, the length of the gradient of the samples, or a field.
Quantity = Literal["x", "y", "z", "normal", "gradient", "field"]

# The colours of CSS Color Module Level 4, section 6.1; "transparent" has an alpha.
_NAMED_COLORS = {
    "aliceblue": "f0f8ff", "antiquewhite": "faebd7", "aqua": "00ffff", "aquamarine": "7fffd4", "azure": "f0ffff",
    "beige": "f5f5dc", "bisque": "ffe4c4", "black": "000000", "blanchedalmond": "ffebcd", "blue": "0000ff",
    "blueviolet": "8a2be2", "brown": "a52a2a", "burlywood": "deb887", "cadetblue": "5f9ea0", "chartreuse": "7fff00",
    "chocolate": "d2691e", "coral": "ff7f50", "cornflowerblue": "6495ed", "cornsilk": "fff8dc", "crimson": "dc143c",
    "cyan": "00ffff", "darkblue": "00008b", "darkcyan": "008b8b", "darkgoldenrod": "b8860b", "darkgray": "a9a9a9",
    "darkgreen": "006400", "darkgrey": "a9a9a9", "darkkhaki": "bdb76b", "darkmagenta": "8b008b",
    "darkolivegreen": "556b2f", "darkorange": "ff8c00", "darkorchid": "9932cc", "darkred": "8b0000",
    "darksalmon": "e9967a", "darkseagreen": "8fbc8f", "darkslateblue": "483d8b", "darkslategray": "2f4f4f",
    "darkslategrey": "2f4f4f", "darkturquoise": "00ced1", "darkviolet": "9400d3", "deeppink": "ff1493",
    "deepskyblue": "00bfff", "dimgray": "696969", "dimgrey": "696969", "dodgerblue": "1e90ff", "firebrick": "b22222",
    "floralwhite": "fffaf0", "forestgreen": "228b22", "fuchsia": "ff00ff", "gainsboro": "dcdcdc",
    "ghostwhite": "f8f8ff", "gold": "ffd700", "goldenrod": "daa520", "gray": "808080", "green": "008000",
    "greenyellow": "adff2f", "grey": "808080", "honeydew": "f0fff0", "hotpink": "ff69b4", "indianred": "cd5c5c",
    "indigo": "4b0082", "ivory": "fffff0", "khaki": "f0e68c", "lavender": "e6e6fa", "lavenderblush": "fff0f5",
    "lawngreen": "7cfc00", "lemonchiffon": "fffacd", "lightblue": "add8e6", "lightcoral": "f08080",
    "lightcyan": "e0ffff", "lightgoldenrodyellow": "fafad2", "lightgray": "d3d3d3", "lightgreen": "90ee90",
    "lightgrey": "d3d3d3", "lightpink": "ffb6c1", "lightsalmon": "ffa07a", "lightseagreen": "20b2aa",
    "lightskyblue": "87cefa", "lightslategray": "778899", "lightslategrey": "778899", "lightsteelblue": "b0c4de",
    "lightyellow": "ffffe0", "lime": "00ff00", "limegreen": "32cd32", "linen": "faf0e6", "magenta": "ff00ff",
    "maroon": "800000", "mediumaquamarine": "66cdaa", "mediumblue": "0000cd", "mediumorchid": "ba55d3",
    "mediumpurple": "9370db", "mediumseagreen": "3cb371", "mediumslateblue": "7b68ee", "mediumspringgreen": "00fa9a",
    "mediumturquoise": "48d1cc", "mediumvioletred": "c71585", "midnightblue": "191970", "mintcream": "f5fffa",
    "mistyrose": "ffe4e1", "moccasin": "ffe4b5", "navajowhite": "ffdead", "navy": "000080", "oldlace": "fdf5e6",
    "olive": "808000", "olivedrab": "6b8e23", "orange": "ffa500", "orangered": "ff4500", "orchid": "da70d6",
    "palegoldenrod": "eee8aa", "palegreen": "98fb98", "paleturquoise": "afeeee", "palevioletred": "db7093",
    "papayawhip": "ffefd5", "peachpuff": "ffdab9", "peru": "cd853f", "pink": "ffc0cb", "plum": "dda0dd",
    "powderblue": "b0e0e6", "purple": "800080", "rebeccapurple": "663399", "red": "ff0000", "rosybrown": "bc8f8f",
    "royalblue": "4169e1", "saddlebrown": "8b4513", "salmon": "fa8072", "sandybrown": "f4a460", "seagreen": "2e8b57",
    "seashell": "fff5ee", "sienna": "a0522d", "silver": "c0c0c0", "skyblue": "87ceeb", "slateblue": "6a5acd",
    "slategray": "708090", "slategrey": "708090", "snow": "fffafa", "springgreen": "00ff7f", "steelblue": "4682b4",
    "tan": "d2b48c", "teal": "008080", "thistle": "d8bfd8", "tomato": "ff6347", "turquoise": "40e0d0",
    "violet": "ee82ee", "wheat": "f5deb3", "white": "ffffff", "whitesmoke": "f5f5f5", "yellow": "ffff00",
    "yellowgreen": "9acd32",
    "transparent": "00000000",
}  # fmt: skip


@dataclass(frozen=True)
class Material:
    """How a surface reflects light; None takes the server's default.

    Attributes:
        ambient: share of the colour that shows without light, in [0, 1]; default 0.12.
        diffuse: share that depends on the light, in [0, 1]; default 1 - ambient.
        specular: white added where the surface faces the eye, in [0, 1]; default 0.22.
        shininess: exponent of the highlight, in [1, 1000]; default 32.
    """

    ambient: float | None = None
    diffuse: float | None = None
    specular: float | None = None
    shininess: float | None = None


@dataclass(frozen=True)
class ColorBy:
    """A quantity that the colour of a surface shows.

    Attributes:
        quantity: "x", "y", "z" (world coordinate), "normal", "gradient" (field units per world unit), or "field".
        map: colour map; default "viridis". Not with "normal".
        range: values at the ends of the map; default ("all"): the volume's box, 0 to Dataset.max_gradient, or the range
            of the field over all steps. "step": the same at the step that is drawn. "visible": the values that the
            picture shows; `Frame.colorings` has them, to be kept for other views.
        opacity: opacities at the ends of the map, in [0, 1]; default: 1 at both.
        field: name of the field whose samples show, at the step that is drawn; "velocity:x" names a component, too.
        component: its component; default: the only one, or the magnitude.
    """

    quantity: Quantity = "field"
    map: ColorMap | None = None
    range: RangeLike | None = None
    opacity: tuple[float, float] | None = None
    field: str | None = None
    component: str | int | None = None


#: A ColorBy, or the words of `--color-by`: "temperature", "velocity:x:magma:0,2", "z:turbo", "normal", "none".
ColorByLike = Union[ColorBy, str]


@dataclass(frozen=True)
class Surface:
    """One surface of a frame: of an isovalue, or of labels.

        Surface(60, color="tan", opacity=0.4)
        Surface(labels=["left lung", "right lung"])

    Attributes:
        isovalue: level in field units; outside the data there is no surface. None with labels.
        color: default: a light clay; of labels that of the first in the dataset, else `label_color` of its value.
        opacity: in (0, 1]; below 1 what lies behind shows through. None: the alpha of `color`, else 1.
        material: how it reflects light.
        color_by: quantity that the colour shows instead of `color`.
        labels: the surface of the samples that are one of these values, 1 to 256; or of their names.
        smooth: moves vertices by up to a quarter of a sample: small steps become slopes. Not with an isovalue.
    """

    isovalue: float | None = None
    color: ColorLike | None = None
    opacity: float | None = None
    material: Material | None = None
    color_by: ColorByLike | None = None
    labels: LabelLike | Sequence[LabelLike] | None = None
    smooth: bool = False


#: A surface, or just its isovalue.
SurfaceLike = Union[Surface, float]


@dataclass(frozen=True)
class Light:
    """A light infinitely far away; up to four take the place of the head light.

    Attributes:
        direction: from the scene to the light; any length but 0.
        intensity: in [0, 10].
        color: default white.
        space: "view" (x right, y up, z to the eye; moves with the camera) or "world".
    """

    direction: Vec3
    intensity: float = 1.0
    color: ColorLike | None = None
    space: Literal["view", "world"] = "view"


#: A light, or just its direction in view space.
LightLike = Union[Light, Sequence[float]]


@dataclass(frozen=True)
class Plane:
    """The half of the world with normal . p >= offset, which is shown.

    Attributes:
        normal: towards the part that is kept; any length but 0.
        offset: along the normal, in world units times the normal's length.
    """

    normal: Vec3
    offset: float

    @classmethod
    def through(cls, point: Sequence[float], normal: Sequence[float]) -> Plane:
        """Returns the plane through a point, world space; the side that `normal` points to is kept."""
        p, n = as_vec3(point, "plane point"), as_vec3(normal, "plane normal")
        return cls(n, n[0] * p[0] + n[1] * p[1] + n[2] * p[2])


@dataclass(frozen=True)
class Caps:
    """How cuts through the inside of opaque surfaces are filled.

    Attributes:
        map: colour map of the samples on the cut; None: the colour of the surface.
        range: values at the ends of the map, as of ColorBy; default: those of the window.
        window: percentiles of the samples at the ends of the map, counted from the lowest isovalue of an opaque surface
            on; None: the range of all samples. Servers older than windows have that range, too.
    """

    map: ColorMap | None = None
    range: RangeLike | None = None
    window: tuple[float, float] | None = DEFAULT_WINDOW


@dataclass(frozen=True)
class Clip:
    """The part of the world that is shown: inside of all planes and of the box.

    Attributes:
        planes: at most 6; each a Plane or (nx, ny, nz, offset).
        box: (x_min, x_max, y_min, y_max, z_min, z_max), world units, as PyVista's bounds.
        caps: fills the cuts; True for the colours of the surfaces.
    """

    planes: Sequence[Union[Plane, Sequence[float]]] = ()
    box: Sequence[float] | None = None
    caps: Union[Caps, bool, None] = None


#: A Clip, a Plane, planes, or six numbers: a box as in Clip.box.
ClipLike = Union[Clip, Plane, Sequence[Plane], Sequence[float]]


def _default(effect: Any, field: str) -> float:
    """Returns the default of a field of an effect, as the proto has it."""
    options = effect.DESCRIPTOR.fields_by_name[field].GetOptions()
    return float(options.Extensions[options_pb2.value_options].default_text)


# Effects. An attribute has the name of the proto's field, without "_px".


@dataclass(frozen=True)
class AmbientOcclusion:
    """Darkens hollows.

    Attributes:
        radius: how far it looks, in pixels, 4 to 56.
        strength: share of its light that a hollow loses at most, in [0, 1].
    """

    radius: int = int(_default(pb.AmbientOcclusion, "radius_px"))
    strength: float = _default(pb.AmbientOcclusion, "strength")


@dataclass(frozen=True)
class Silhouette:
    """Draws lines where a surface ends in front of something farther away.

    Attributes:
        width: in pixels, 1 to 16.
        color: default black.
    """

    width: int = int(_default(pb.Silhouette, "width_px"))
    color: ColorLike | None = None


def parse_color(color: ColorLike, name: str) -> tuple[float, float, float, float]:
    """Returns red, green, blue, alpha in [0, 1]; InvalidArgumentError names the field otherwise."""
    expected = "'#rrggbb', a name of CSS such as 'ivory', or (red, green, blue[, alpha]) from 0 to 1"
    wrong = InvalidArgumentError(f"{name} {color!r}: must be {expected}")
    if isinstance(color, str):
        text = color.strip().lower()
        digits = _NAMED_COLORS.get(text, text[1:] if text.startswith("#") else "")
        if len(digits) in (3, 4):
            digits = "".join(digit * 2 for digit in digits)
        if len(digits) not in (6, 8) or any(digit not in "0123456789abcdef" for digit in digits):
            raise wrong
        values = [int(digits[at : at + 2], 16) / 255 for at in range(0, len(digits), 2)]
    else:
        try:
            values = [float(value) for value in color]
        except (TypeError, ValueError) as error:
            raise wrong from error
    if len(values) not in (3, 4) or not all(0 <= value <= 1 for value in values):
        raise wrong
    return (values[0], values[1], values[2], values[3] if len(values) == 4 else 1.0)


def as_color_by(value: ColorByLike) -> ColorBy | None:
    """Returns what to colour by, also of the words of `--color-by`; None for "none"."""
    if not isinstance(value, str):
        return value
    if value == "none":
        return None
    first, *rest = value.split(":")
    maps = get_args(ColorMap)
    is_field = first not in get_args(Quantity) or first == "field"
    component = rest.pop(0) if is_field and rest and rest[0] not in maps else None
    name, ends, opacities, *more = [*rest, *[""] * (3 - len(rest))]
    if first in ("", "none") or component == "" or more or (rest and name not in maps):
        raise InvalidArgumentError(
            f"color_by {value!r}: must be FIELD[:COMPONENT], x, y, z or gradient, then "
            f"[:MAP[:MIN,MAX[:OPACITY,OPACITY]]]; or normal or none; maps are {', '.join(maps)}"
        )
    return ColorBy(
        quantity="field" if is_field else cast(Quantity, first),
        map=cast(ColorMap, name) or None,
        range=_ends(ends, value),
        opacity=_ends(opacities, value),
        field=first if is_field else None,
        component=component,
    )


def _ends(text: str, whole: str) -> tuple[float, float] | None:
    if not text:
        return None
    numbers = cast(Sequence[float], text.split(","))
    lower, upper = _numbers(numbers, 2, f"color_by {whole!r}:", "two numbers with a comma between them")
    return lower, upper


def as_clip(clip: ClipLike) -> Clip:
    """Returns the region, also of one plane, of planes or of six numbers."""
    if isinstance(clip, Clip):
        return clip
    if isinstance(clip, Plane):
        return Clip(planes=(clip,))
    planes = [one for one in clip if isinstance(one, Plane)]
    return Clip(planes=planes) if planes and len(planes) == len(clip) else Clip(box=cast(Sequence[float], clip))


def as_plane(plane: Plane | Sequence[float]) -> Plane:
    """Returns a plane, also of (nx, ny, nz, offset)."""
    if isinstance(plane, Plane):
        return plane
    values = _numbers(plane, 4, "clip plane", "(nx, ny, nz, offset)")
    return Plane((values[0], values[1], values[2]), values[3])


def as_bounds(box: Sequence[float]) -> tuple[float, ...]:
    """Returns six finite numbers."""
    return _numbers(box, 6, "clip box", "(x_min, x_max, y_min, y_max, z_min, z_max)")


def as_light(light: LightLike) -> Light:
    """Returns a light, also of a direction."""
    return light if isinstance(light, Light) else Light(as_vec3(light, "light direction"))


def as_lights(lights: Sequence[LightLike] | LightLike) -> list[LightLike]:
    """Returns lights, also of one light or of one direction."""
    if isinstance(lights, Light):
        return [lights]
    several: list[Any] = list(lights)
    return [several] if several and isinstance(several[0], numbers.Real) else several


def as_pixels(pixels: Any) -> tuple[list[tuple[int, int]], bool]:
    """Returns pixels, and whether it was one, (column, row), instead of a sequence or an array of them."""
    several: list[Any] = list(pixels)
    is_one = bool(several) and isinstance(several[0], numbers.Real)
    return ([cast(Any, tuple(several))] if is_one else several), is_one


def as_surface(surface: SurfaceLike) -> Surface:
    """Returns a surface, also of an isovalue."""
    if isinstance(surface, Surface):
        return surface
    try:
        return Surface(float(surface))
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"surface {surface!r}: must be an isoscope.Surface or an isovalue") from error


def _numbers(values: Sequence[float], count: int, name: str, shape: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} {values!r}: must be {shape}") from error
    if len(numbers) != count or not all(math.isfinite(number) for number in numbers):
        raise InvalidArgumentError(f"{name} {values!r}: must be {shape}, finite numbers")
    return numbers
