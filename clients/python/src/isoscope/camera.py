"""Cameras, with VTK's conventions, computed with the same bits as `isoscope render` computes them.

A camera made here is a plain value: turn it, zoom it, save it as JSON for `isoscope render --camera`,
or give it to `Dataset.render` again; `Frame.camera` is the one that a picture was made with.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Union

from isoscope.errors import InvalidArgumentError

__all__ = ["VIEWS", "Camera", "CameraLike", "Vec3"]

Vec3 = tuple[float, float, float]

_RADIANS_PER_DEGREE = math.pi / 180

# The rows of core/view/named_views.inc: direction of the eye from the target; up; the patient's sides in the same
# order.
_NOWHERE: Vec3 = (0, 0, 0)
_NAMED_VIEWS: dict[str, tuple[Vec3, Vec3, str]] = {
    "front": ((0, 0, 1), (0, 1, 0), ""),
    "back": ((0, 0, -1), (0, 1, 0), ""),
    "anterior": (_NOWHERE, _NOWHERE, "AS"),
    "posterior": (_NOWHERE, _NOWHERE, "PS"),
    "left": ((-1, 0, 0), (0, 1, 0), "LS"),
    "right": ((1, 0, 0), (0, 1, 0), "RS"),
    "top": ((0, 1, 0), (0, 0, -1), ""),
    "bottom": ((0, -1, 0), (0, 0, 1), ""),
    "superior": (_NOWHERE, _NOWHERE, "SA"),
    "inferior": (_NOWHERE, _NOWHERE, "IA"),
}
# Names that `view=` takes. The last four need a dataset with a patient frame; with one, `left` and `right` are the
# patient's.
VIEWS = tuple(sorted(_NAMED_VIEWS, key=lambda name: _NAMED_VIEWS[name][0] == _NOWHERE))


@dataclass(frozen=True)
class Camera:
    """A camera, world space. Perspective, unless `height` makes it orthographic.

    Attributes:
        eye: position of the camera, world units; differs from `target`.
        target: point that it looks at.
        up: up direction; any length but 0, not parallel to target - eye.
        fov_y: full vertical angle of view in degrees, in (0, 180); has no effect with `height`.
        height: orthographic: height of the picture in world units, > 0.
    """

    eye: Vec3
    target: Vec3
    up: Vec3 = (0.0, 1.0, 0.0)
    fov_y: float = 30.0
    height: float | None = None

    @property
    def is_orthographic(self) -> bool:
        """Whether rays are parallel."""
        return self.height is not None

    @property
    def distance(self) -> float:
        """Distance from eye to target, world units."""
        return _length(_sub(self.target, self.eye))

    def _view_height(self) -> float:
        """Returns the height of the picture: at distance 1, or anywhere for parallel rays."""
        return 2 * math.tan(math.radians(self.fov_y) / 2) if self.height is None else self.height

    def _axes(self) -> tuple[Vec3, Vec3, Vec3, Vec3]:
        """Returns the eye, and unit vectors forward, to the right and up."""
        forward = _normalized(_sub(self.target, self.eye))
        right = _normalized(_cross(forward, self.up))
        return self.eye, forward, right, _cross(right, forward)

    def azimuth(self, degrees: float) -> Camera:
        """Returns the camera with its eye turned about `up` through the target (vtkCamera.Azimuth)."""
        axis = _normalized(self.up)
        turned = _rotated(_sub(self.eye, self.target), axis, degrees * _RADIANS_PER_DEGREE)
        return replace(self, eye=_add(self.target, turned))

    def elevation(self, degrees: float) -> Camera:
        """Returns the camera turned about its right axis, with `up` made perpendicular again."""
        right = _normalized(_cross(_sub(self.target, self.eye), self.up))
        axis = (-right[0], -right[1], -right[2])
        turned = _rotated(_sub(self.eye, self.target), axis, degrees * _RADIANS_PER_DEGREE)
        camera = replace(self, eye=_add(self.target, turned))
        forward = _normalized(_sub(camera.target, camera.eye))
        side = _cross(forward, camera.up)
        # As on the server: the least distance of the up direction from the view direction.
        if not _length(side) >= 1e-6 * _length(camera.up):
            raise InvalidArgumentError(
                f"elevation {degrees:g} degrees: the camera would look along its up direction {self.up}; "
                "stay below 90 degrees"
            )
        return replace(camera, up=_cross(_normalized(side), forward))

    def zoom(self, factor: float) -> Camera:
        """Returns the camera with its angle (or height) divided by `factor`, > 0: 2 is twice as near."""
        if not (factor > 0 and math.isfinite(factor)):
            raise InvalidArgumentError(f"zoom {factor!r}: must be a finite number above 0")
        if self.height is not None:
            return replace(self, height=self.height / factor)
        return replace(self, fov_y=_degrees_of(self.fov_y * _RADIANS_PER_DEGREE / factor))

    def orthographic(self, height: float | None = None) -> Camera:
        """Returns the camera with parallel rays; by default as high as the view is at the target."""
        if height is None:
            height = 2 * self.distance * math.tan(self.fov_y * _RADIANS_PER_DEGREE / 2)
        return replace(self, height=height)

    def to_dict(self) -> dict[str, Any]:
        """Returns the camera as `isoscope render --save-camera` writes it to JSON."""
        out: dict[str, Any] = {"eye": list(self.eye), "target": list(self.target), "up": list(self.up)}
        if self.height is not None:
            out["orthographic"] = {"height": self.height}
        else:
            out["perspective"] = {"fov_y_degrees": self.fov_y}
        return out

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Camera:
        """Returns the camera of such a JSON object; the numbers keep their bits."""
        known = {"eye", "target", "up", "perspective", "orthographic"}
        unknown = sorted(set(values) - known)
        if unknown or "eye" not in values or "target" not in values:
            raise InvalidArgumentError(
                f"no camera: {'unknown member ' + repr(unknown[0]) if unknown else 'eye and target are required'}; "
                f"expected {', '.join(sorted(known))}"
            )
        if ("perspective" in values) == ("orthographic" in values):
            raise InvalidArgumentError('no camera: expected one of "perspective" and "orthographic"')
        return cls(
            eye=as_vec3(values["eye"], "camera eye"),
            target=as_vec3(values["target"], "camera target"),
            up=as_vec3(values.get("up", (0.0, 1.0, 0.0)), "camera up"),
            fov_y=float(values["perspective"]["fov_y_degrees"]) if "perspective" in values else 30.0,
            height=float(values["orthographic"]["height"]) if "orthographic" in values else None,
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes JSON for `isoscope render --camera FILE.json` and `Camera.load`."""
        with open(path, "w", encoding="utf-8") as file:
            json.dump(self.to_dict(), file, indent=2)
            file.write("\n")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Camera:
        """Reads what `save` or `isoscope render --save-camera` wrote."""
        with open(path, encoding="utf-8") as file:
            return cls.from_dict(json.load(file))


#: A camera, or as PyVista's camera_position: (eye, target, up).
CameraLike = Union[Camera, Sequence[Sequence[float]]]


def as_vec3(value: Any, name: str) -> Vec3:
    """Returns three finite numbers; InvalidArgumentError names the field otherwise."""
    try:
        x, y, z = (float(component) for component in value)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} {value!r}: must be three numbers (x, y, z)") from error
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        raise InvalidArgumentError(f"{name} {value!r}: each must be a finite number")
    return (x, y, z)


def as_camera(value: CameraLike) -> Camera:
    """Returns a camera, also of (eye, target, up)."""
    if isinstance(value, Camera):
        return value
    if isinstance(value, str) or len(value) not in (2, 3):
        raise InvalidArgumentError(f"camera {value!r}: must be an isoscope.Camera or (eye, target, up)")
    eye, target, *rest = (as_vec3(part, f"camera {name}") for part, name in zip(value, ("eye", "target", "up")))
    return Camera(eye, target, rest[0]) if rest else Camera(eye, target)


def default_camera(lower: Vec3, upper: Vec3) -> Camera:
    """Returns the camera that sees all of a world box along -z with +y up (vtkRenderer.ResetCamera)."""
    target = _mul(_add(lower, upper), 0.5)
    radius = 0.5 * _length(_sub(upper, lower))
    fov = math.pi / 6
    distance = (radius if radius > 0 else 0.5) / math.sin(fov / 2)
    return Camera(eye=_add(target, (0.0, 0.0, distance)), target=target, fov_y=_degrees_of(fov))


def named_camera(view: str, lower: Vec3, upper: Vec3, patient_frame: str) -> Camera:
    """Returns the default camera of a world box from another side; VIEWS has the names."""
    if view not in VIEWS:
        raise InvalidArgumentError(f"view {view!r}: must be one of {', '.join(VIEWS)}")
    to_eye, up, sides = _NAMED_VIEWS[view]
    if patient_frame and sides:
        to_eye, up = (_direction_to(side, patient_frame) for side in sides)
    elif to_eye == _NOWHERE:
        raise InvalidArgumentError(
            f"view {view!r}: a view of a patient, but the source of the dataset has no patient frame (NIfTI with "
            "a qform or sform, DICOM, and NRRD with the space LPS or RAS have one): use front, back, left, right, "
            "top or bottom"
        )
    camera = default_camera(lower, upper)
    distance = camera.eye[2] - camera.target[2]
    eye = _add(camera.target, _mul(to_eye, distance))
    return replace(camera, eye=eye, up=(float(up[0]), float(up[1]), float(up[2])))


def _direction_to(side: str, patient_frame: str) -> Vec3:
    """Returns the unit vector towards a side of the patient, such as "A"; frame "LPS" or the like."""
    pair = next(letters for letters in ("LR", "PA", "SI") if side in letters)
    direction = [0.0, 0.0, 0.0]
    for axis, positive in enumerate(patient_frame):
        if positive in pair:
            direction[axis] = 1.0 if positive == side else -1.0
    return (direction[0], direction[1], direction[2])


def _degrees_of(radians: float) -> float:
    """Returns the degrees that become `radians` again; the short decimal if there is one."""
    degrees = radians / _RADIANS_PER_DEGREE
    rounded = math.floor(degrees * 1e9 + 0.5) / 1e9
    return rounded if rounded * _RADIANS_PER_DEGREE == radians else degrees


# In the order of operations of core/math/vec.h, so that the bits are the same.
def _add(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _sub(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _mul(a: Vec3, s: float) -> Vec3:
    return (a[0] * s, a[1] * s, a[2] * s)


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vec3, b: Vec3) -> Vec3:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _length(a: Vec3) -> float:
    return math.sqrt(_dot(a, a))


def _normalized(a: Vec3) -> Vec3:
    length = _length(a)
    if not length > 0:
        raise InvalidArgumentError("camera: eye and target must differ, and up must not be parallel to the view")
    return _mul(a, 1 / length)


def _rotated(v: Vec3, axis: Vec3, radians: float) -> Vec3:
    c, s = math.cos(radians), math.sin(radians)
    return _add(_add(_mul(v, c), _mul(_cross(axis, v), s)), _mul(axis, _dot(axis, v) * (1 - c)))
