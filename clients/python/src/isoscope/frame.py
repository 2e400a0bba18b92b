"""The picture of a frame: its exact bytes, its pixels and planes as arrays."""

from __future__ import annotations

import base64
import dataclasses
import functools
import os
import pathlib
from typing import TYPE_CHECKING, Any, Literal, Protocol, Union

import numpy as np
import numpy.typing as npt

from isoscope import _png, _xarray
from isoscope.camera import Camera
from isoscope.data import CapsColoring, DrawnLevel, PickedPoint, Statistics, SurfaceColoring, SurfaceNote
from isoscope.errors import IsoscopeError

if TYPE_CHECKING:
    from isoscope._proto.isosurface_service_pb2 import RenderIsosurfaceRequest

__all__ = ["Frame", "ImageFormat", "PlaneName"]

#: Planes beside the picture.
PlaneName = Literal["depth", "surface_index", "position", "normal", "depth_bounds"]
#: How the picture travels: "png" and "rgba" without loss, "jpeg" with loss, "none" not at all.
ImageFormat = Literal["png", "jpeg", "rgba", "none"]

Planes = dict[str, npt.NDArray[Any]]


class FrameCalls(Protocol):
    """Calls that a frame makes after it came. `_core` has them: it knows frames, and a frame knows no calls."""

    def point(
        self, request: RenderIsosurfaceRequest, pixel: tuple[int, int], all_fields: bool
    ) -> PickedPoint | None: ...

    def plane(self, request: RenderIsosurfaceRequest, name: PlaneName) -> Frame: ...


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """One frame. Its PNG has the bytes that the service sent: the same for the same request, always.

    A plane that was not asked for is fetched with a second call when it is first used; the frame of
    an async client raises an error instead: ask for it in `render(planes=...)`.

    Attributes:
        width, height: pixels of the picture and of each plane.
        camera: the camera of the picture.
        stats: what it cost.
        colorings: how surfaces with `color_by` were coloured.
        caps_coloring: how caps that show samples were coloured; None without such caps.
        notes: why surfaces do not show, if some do not. `render` also warns of each with a SurfaceWarning.
        jpeg: the picture as JPEG; None unless asked for.
        field, component: what the surfaces are of; None if the dataset has no fields, or the field no components.
        step, time: number of the time step, and its time; None if the dataset has no times.
        level: the level that was drawn; None if `render` was not asked to choose one: then it is 0.
    """

    width: int
    height: int
    camera: Camera
    stats: Statistics
    colorings: tuple[SurfaceColoring, ...]
    jpeg: bytes | None
    _png_bytes: bytes
    _rgba_bytes: bytes
    _planes: Planes
    _request: RenderIsosurfaceRequest
    _calls: FrameCalls | None = None
    caps_coloring: CapsColoring | None = None
    notes: tuple[SurfaceNote, ...] = ()
    field: str | None = None
    component: str | None = None
    step: int | None = None
    time: float | None = None
    level: DrawnLevel | None = None

    @property
    def png(self) -> bytes:
        """The picture as PNG: 8 bits a channel, sRGB; RGB if it is opaque, else RGBA."""
        if self._png_bytes:
            return self._png_bytes
        if self._rgba_bytes:
            return _png.encode(self.rgba)
        raise self._lacks("a PNG", 'format="png"')

    @functools.cached_property
    def rgba(self) -> npt.NDArray[np.uint8]:
        """Pixels: uint8, shape (height, width, 4), sRGB, straight alpha, row 0 at the top."""
        if self._rgba_bytes:
            return np.frombuffer(self._rgba_bytes, np.uint8).reshape(self.height, self.width, 4)
        if not self._png_bytes:
            raise self._lacks("exact pixels", 'format="png" or "rgba"')
        pixels = _png.decode(self._png_bytes)
        if pixels.shape[2] == 3:
            opaque = np.full((*pixels.shape[:2], 1), 255, np.uint8)
            pixels = np.concatenate([pixels, opaque], axis=2)
        pixels.setflags(write=False)
        return pixels

    @property
    def rgb(self) -> npt.NDArray[np.uint8]:
        """Pixels without alpha: uint8, shape (height, width, 3)."""
        return self.rgba[:, :, :3]

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        """Distance from the eye along the view axis, world units: float32, shape (height, width).

        Infinity where the background shows.
        """
        return self._plane("depth")

    @property
    def surface_index(self) -> npt.NDArray[np.uint8]:
        """Index of the surface that each pixel shows: uint8, shape (height, width); 255: background."""
        return self._plane("surface_index")

    @property
    def position(self) -> npt.NDArray[np.float32]:
        """World position that each pixel shows: float32, shape (height, width, 3); NaN: background.

        Far from the origin float32 can't tell neighbouring ones apart: `points` can.
        """
        return self._plane("position")

    @property
    def points(self) -> npt.NDArray[np.float64]:
        """World position that each pixel shows: float64, shape (height, width, 3); NaN: background.

        Computed from `depth` and the camera, as `pick` has it but for rounding.
        """
        request, depth = self._request, self.depth.astype(np.float64)
        eye, forward, right, up = (np.array(axis) for axis in self.camera._axes())
        # World units of a pixel: at distance 1 for a perspective, anywhere for parallel rays.
        pixel = self.camera._view_height() / request.viewport.height_px
        x = (np.arange(self.width) + request.region.x + 0.5 - request.viewport.width_px / 2) * pixel
        y = (request.viewport.height_px / 2 - np.arange(self.height) - request.region.y - 0.5) * pixel
        offsets = x[None, :, None] * right + y[:, None, None] * up
        with np.errstate(invalid="ignore"):  # the depth of the background is infinite
            points: npt.NDArray[np.float64] = forward * depth[:, :, None]
            points += offsets if self.camera.is_orthographic else offsets * depth[:, :, None]
        points += eye
        points[~np.isfinite(depth)] = np.nan
        return points

    @property
    def normal(self) -> npt.NDArray[np.float32]:
        """World normal towards smaller values: float32, shape (height, width, 3); NaN: background."""
        return self._plane("normal")

    @property
    def depth_bounds(self) -> npt.NDArray[np.float32]:
        """Nearest and farthest `depth` that the exact picture can have: float32, shape (height, width, 2).

        Both are infinite where the background is proved. Elsewhere the pixel may be background, too.
        """
        return self._plane("depth_bounds")

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), pixels."""
        return (self.width, self.height)

    def pick(self, x: int, y: int, all_fields: bool = False) -> PickedPoint | None:
        """Returns what pixel (column x, row y) of the viewport shows; None: the background."""
        if self._calls is None:
            raise IsoscopeError(
                "this frame has no blocking connection: use dataset.pick((x, y), frame=frame), with await in the "
                "async client"
            )
        return self._calls.point(self._request, (x, y), all_fields)

    def to_xarray(self, *planes: PlaneName) -> Any:
        """Returns an xarray.Dataset: `depth`, and other planes, by row and column of the viewport.

        Its coordinates x, y and z are the world position of each pixel (`points`). `depth` and they are NaN where the
        background shows. `frame.to_xarray().depth.plot(yincrease=False)` shows it as the picture is.

        Args:
            planes: names of further planes; default: those that the frame has.

        Raises:
            MissingPackageError: xarray is not installed.
        """
        names = ["depth", *(planes or self._planes)]
        # `depth` may be fetched first: a frame that lacks it says so.
        arrays = {name: self._plane(name) for name in dict.fromkeys(names)}
        arrays["depth"] = np.where(np.isfinite(arrays["depth"]), arrays["depth"], np.float32(np.nan))
        what = {"field": self.field, "component": self.component, "step": self.step, "time": self.time}
        attributes = {name: value for name, value in what.items() if value is not None}
        return _xarray.planes(arrays, self.points, (self._request.region.y, self._request.region.x), attributes)

    def save(self, path: str | os.PathLike[str]) -> pathlib.Path:
        """Writes the exact bytes: .png, .jpg or .jpeg (if rendered as JPEG), or .npy (the RGBA array)."""
        target = pathlib.Path(path)
        suffix = target.suffix.lower()
        if suffix == ".png":
            target.write_bytes(self.png)
        elif suffix in (".jpg", ".jpeg"):
            if not self.jpeg:
                raise self._lacks("a JPEG", 'format="jpeg"')
            target.write_bytes(self.jpeg)
        elif suffix == ".npy":
            np.save(target, self.rgba)
        else:
            raise IsoscopeError(f"can't save a frame as {os.fspath(path)!r}: the name must end in .png, .jpg or .npy")
        return target

    def __repr__(self) -> str:
        of = ""
        if self.field is not None:
            of = f"{self.field}:{self.component}, " if self.component else f"{self.field}, "
        if self.step is not None:
            of += f"step {self.step}" + (", " if self.time is None else f" at {self.time:g}, ")
        return (
            f"Frame({self.width} x {self.height}, {of}{self.stats.triangle_count} triangles, "
            f"{self.stats.seconds * 1000:.1f} ms in the coordinator)"
        )

    def _repr_png_(self) -> bytes | None:
        return self.png if self._png_bytes or self._rgba_bytes else None

    def _repr_jpeg_(self) -> bytes | None:
        return self.jpeg

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        bundle: dict[str, Any] = {"text/plain": repr(self)}
        if self._png_bytes or self._rgba_bytes:
            bundle["image/png"] = base64.b64encode(self.png).decode("ascii")
        elif self.jpeg:
            bundle["image/jpeg"] = base64.b64encode(self.jpeg).decode("ascii")
        return bundle

    def __array__(self, dtype: Any = None, copy: Union[bool, None] = None) -> npt.NDArray[Any]:
        """np.asarray(frame) is `rgba`."""
        return self.rgba if dtype is None else self.rgba.astype(dtype)

    def __getstate__(self) -> dict[str, Any]:
        """Pickles everything but the connection, the request as its bytes."""
        state = {name: value for name, value in self.__dict__.items() if name != "rgba"}
        state.update(_calls=None, _request=self._request.SerializeToString())
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        from isoscope._proto.isosurface_service_pb2 import RenderIsosurfaceRequest

        self.__dict__.update(state, _request=RenderIsosurfaceRequest.FromString(state["_request"]))

    def _plane(self, name: PlaneName) -> npt.NDArray[Any]:
        if name not in self._planes:
            if self._calls is None:
                raise self._lacks(f"the plane {name!r}", f'planes=["{name}"]')
            self._planes.update(self._calls.plane(self._request, name)._planes)
        return self._planes[name]

    def _lacks(self, thing: str, argument: str) -> IsoscopeError:
        return IsoscopeError(f"this frame lacks {thing}: render it with {argument}")
