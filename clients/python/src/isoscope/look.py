"""What a picture shows: surfaces, colours, lights, clipping, effects. Plain values, checked by the server."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Union

from isoscope.camera import Vec3, as_vec3
from isoscope.errors import InvalidArgumentError

__all__ = [
    "AmbientOcclusion",
    "Caps",
    "Clip",
    "ClipLike",
    "ColorBy",
    "ColorLike",
    "ColorMap",
    "Light",
    "LightLike",
    "Material",
    "Plane",
    "Quantity",
    "Silhouette",
    "Surface",
    "SurfaceLike",
]

#: "#rrggbb", "#rrggbbaa", "#rgb", a name such as "ivory", or red, green, blue(, alpha) in [0, 1], sRGB.
ColorLike = Union[str, Sequence[float]]
#: Colour maps of 256 colours.
ColorMap = Literal["viridis", "magma", "cividis", "turbo", "cool-warm", "grey"]
#: What `ColorBy` shows: world coordinates, normals, or the length of the gradient of the samples.
Quantity = Literal["x", "y", "z", "normal", "gradient"]

_NAMED_COLORS = {
    "black": "000000", "silver": "c0c0c0", "gray": "808080", "grey": "808080", "white": "ffffff",
    "maroon": "800000", "red": "ff0000", "purple": "800080", "magenta": "ff00ff", "fuchsia": "ff00ff",
    "green": "008000", "lime": "00ff00", "olive": "808000", "yellow": "ffff00", "navy": "000080",
    "blue": "0000ff", "teal": "008080", "cyan": "00ffff", "aqua": "00ffff", "orange": "ffa500",
    "pink": "ffc0cb", "brown": "a52a2a", "gold": "ffd700", "tan": "d2b48c", "ivory": "fffff0",
    "salmon": "fa8072", "coral": "ff7f50", "tomato": "ff6347", "peru": "cd853f", "wheat": "f5deb3",
    "beige": "f5f5dc", "linen": "faf0e6", "bisque": "ffe4c4", "skyblue": "87ceeb",
    "steelblue": "4682b4", "lightgrey": "d3d3d3", "lightgray": "d3d3d3",
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
        quantity: "x", "y", "z" (world coordinate), "normal", or "gradient" (field units per world unit).
        map: colour map; default "viridis". Not with "normal".
        range: values at the ends of the map; default: the volume's box, or 0 to Dataset.max_gradient.
        opacity: opacities at the ends of the map, in [0, 1]; default: 1 at both.
    """

    quantity: Quantity
    map: ColorMap | None = None
    range: tuple[float, float] | None = None
    opacity: tuple[float, float] | None = None


@dataclass(frozen=True)
class Surface:
    """One isosurface of a frame.

    Attributes:
        isovalue: level in field units; outside the data there is no surface.
        color: default: a light clay.
        opacity: in (0, 1]; below 1 what lies behind shows through. None: the alpha of `color`, else 1.
        material: how it reflects light.
        color_by: quantity that the colour shows instead of `color`.
    """

    isovalue: float
    color: ColorLike | None = None
    opacity: float | None = None
    material: Material | None = None
    color_by: ColorBy | None = None


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
        range: values at the ends of the map; default: the range of the samples.
    """

    map: ColorMap | None = None
    range: tuple[float, float] | None = None


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


#: A Clip, a Plane, or six numbers: a box as in Clip.box.
ClipLike = Union[Clip, Plane, Sequence[float]]


@dataclass(frozen=True)
class AmbientOcclusion:
    """Darkens hollows.

    Attributes:
        radius: how far it looks, in pixels, 4 to 56.
        strength: share of its light that a hollow loses at most, in [0, 1].
    """

    radius: int = 32
    strength: float = 1.0


@dataclass(frozen=True)
class Silhouette:
    """Draws lines where a surface ends in front of something farther away.

    Attributes:
        width: in pixels, 1 to 16.
        color: default black.
    """

    width: int = 2
    color: ColorLike | None = None


def parse_color(color: ColorLike, name: str) -> tuple[float, float, float, float]:
    """Returns red, green, blue, alpha in [0, 1]; InvalidArgumentError names the field otherwise."""
    expected = "'#rrggbb', a name such as 'ivory', or (red, green, blue[, alpha]) from 0 to 1"
    wrong = InvalidArgumentError(f"{name} {color!r}: must be {expected}")
    if isinstance(color, str):
        text = color.strip().lower()
        digits = _NAMED_COLORS.get(text, text[1:] if text.startswith("#") else "")
        if len(digits) == 3:
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


def as_clip(clip: ClipLike) -> Clip:
    """Returns the region, also of one plane or of six numbers."""
    if isinstance(clip, Clip):
        return clip
    if isinstance(clip, Plane):
        return Clip(planes=(clip,))
    return Clip(box=clip)


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
