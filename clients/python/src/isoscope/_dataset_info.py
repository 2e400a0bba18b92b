"""A dataset: its grid, its fields and its time steps."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from isoscope.camera import Camera, Vec3, default_camera, named_camera
from isoscope.labels import Label


@dataclass(frozen=True)
class TimeStep:
    """A time step of a dataset: its number, which never changes, and its time in `DatasetInfo.time_unit`."""

    number: int
    time: float


@dataclass(frozen=True)
class DatasetLevel:
    """A level of a dataset: a volume with fewer samples, made from those of level 0.

    Attributes:
        level: its number, from 1; each has half the samples of the one before on each axis.
        dims: samples along x, y, z.
        spacing: world units between samples along x, y, z.
        block_count: number of blocks.
        filter: how samples were made, "mean" or "majority"; newer servers may have others.
    """

    level: int
    dims: tuple[int, int, int]
    spacing: Vec3
    block_count: int
    filter: str


@dataclass(frozen=True)
class FieldComponent:
    """One scalar of a field.

    Attributes:
        name: "" for the only one of a field; else "x", "y", "z", a number or "magnitude".
        dtype: type of the samples.
        range: smallest and largest sample over all steps; None if all are NaN.
        max_gradient: bound of the gradient's length over all steps, field units per world unit; None if unknown.
    """

    name: str
    dtype: np.dtype[Any]
    range: tuple[float, float] | None
    max_gradient: float | None = None


@dataclass(frozen=True)
class Field:
    """A quantity that each sample of the grid has, at each time step.

    Attributes:
        name: what `render(field=...)` takes.
        long_name: name for people; None: `name`.
        unit: unit of the samples, such as "Pa"; None if unknown.
        components: what surfaces can be drawn of: one, or each component and then "magnitude", their length.
        steps: numbers of the steps that are served.
    """

    name: str
    long_name: str | None
    unit: str | None
    components: tuple[FieldComponent, ...]
    steps: tuple[int, ...] = ()

    @property
    def default_component(self) -> FieldComponent:
        """The component that is drawn by default: the only one, or the magnitude."""
        return self.components[-1]

    @property
    def range(self) -> tuple[float, float] | None:
        """Range of the default component over all steps."""
        return self.default_component.range

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the default component."""
        return self.default_component.dtype


@dataclass(frozen=True, kw_only=True)
class DatasetInfo:
    """Describes a partitioned volume.

    Attributes:
        name: name in the cluster.
        id: digest of content and partitioning, 32 hexadecimal digits.
        source: file name of the volume, for people.
        dims: samples along x, y, z; a numpy array of the volume has the shape dims[::-1].
        spacing: world units between samples along x, y, z.
        origin: world position of sample (0, 0, 0).
        direction: the world directions of the index axes: three vectors, of x, of y, of z.
        dtype: type of the samples.
        range: smallest and largest sample; None if all are NaN.
        block_cells: cells of a block along x, y, z.
        block_count: number of blocks.
        shard_count: number of shards.
        missing_shards: shards that no agent serves; empty if frames can be rendered.
        samples_digest: digest of samples and grid, however they were partitioned; None if unknown.
        patient_frame: sides of the patient that +x, +y, +z point to, such as "LPS"; None if there is none.
        labels: names and colours of sample values, ascending by value; () if there are none.
        max_gradient: bound of the gradient's length, field units per world unit; None if unknown.
        fields: fields of the samples; empty: one without a name. With fields, dtype, range and max_gradient are those
            of the first one, over all steps.
        time_steps: steps that are served, by time; empty if there is one step without a time.
        time_unit, length_unit: of times and of world space, such as "s" and "mm", for people; None if unknown.
        levels: levels beside the samples, ascending; with fields, those of the first one at its last step.
    """

    name: str
    id: str
    source: str
    dims: tuple[int, int, int]
    spacing: Vec3
    origin: Vec3
    direction: tuple[Vec3, Vec3, Vec3]
    dtype: np.dtype[Any]
    range: tuple[float, float] | None
    block_cells: tuple[int, int, int]
    block_count: int
    shard_count: int
    missing_shards: tuple[int, ...] = ()
    samples_digest: str | None = None
    patient_frame: str | None = None
    labels: tuple[Label, ...] = ()
    max_gradient: float | None = None
    fields: tuple[Field, ...] = ()
    time_steps: tuple[TimeStep, ...] = ()
    time_unit: str | None = None
    length_unit: str | None = None
    levels: tuple[DatasetLevel, ...] = ()

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """Times of `time_steps`, ascending, in `time_unit`."""
        return np.array([step.time for step in self.time_steps], np.float64)

    def field(self, name: str) -> Field:
        """Returns a field by its name; KeyError says which there are."""
        for one in self.fields:
            if one.name == name:
                return one
        names = ", ".join(repr(one.name) for one in self.fields) or "none with a name"
        raise KeyError(f"no field {name!r}: there are {names}")

    @property
    def is_ready(self) -> bool:
        """Whether all shards are served, so that frames can be rendered."""
        return not self.missing_shards

    @property
    def world_from_index(self) -> npt.NDArray[np.float64]:
        """Matrix of shape (4, 4): world position (x, y, z, 1) of an index position (i, j, k, 1)."""
        matrix = np.eye(4)
        for axis in (0, 1, 2):
            matrix[:3, axis] = np.asarray(self.direction[axis]) * self.spacing[axis]
        matrix[:3, 3] = self.origin
        return matrix

    @property
    def bounds(self) -> tuple[float, float, float, float, float, float]:
        """World box of the samples: (x_min, x_max, y_min, y_max, z_min, z_max), as PyVista's bounds."""
        lower, upper = self._box()
        return (lower[0], upper[0], lower[1], upper[1], lower[2], upper[2])

    @property
    def center(self) -> Vec3:
        """Middle of the bounds, world space."""
        return self.default_camera.target

    @property
    def default_camera(self) -> Camera:
        """The camera that sees all of the volume along -z with +y up."""
        return default_camera(*self._box())

    def camera(self, view: str = "front", azimuth: float = 0, elevation: float = 0, zoom: float = 1) -> Camera:
        """Returns the camera from a side (isoscope.VIEWS), turned (degrees) and zoomed from there."""
        camera = named_camera(view, *self._box(), self.patient_frame or "")
        camera = camera.azimuth(azimuth) if azimuth else camera
        camera = camera.elevation(elevation) if elevation else camera
        return camera.zoom(zoom) if zoom != 1 else camera

    def _box(self) -> tuple[Vec3, Vec3]:
        """Least and greatest world coordinates, in the order of operations of the C++ code."""
        columns = [[d * s for d in column] for column, s in zip(self.direction, self.spacing)]
        corners = []
        for corner in np.ndindex(2, 2, 2):
            index = [float(self.dims[axis] - 1) if corner[axis] else 0.0 for axis in (0, 1, 2)]
            corners.append(
                [
                    columns[0][row] * index[0]
                    + columns[1][row] * index[1]
                    + columns[2][row] * index[2]
                    + self.origin[row]
                    for row in (0, 1, 2)
                ]
            )
        lower = tuple(min(corner[row] for corner in corners) for row in (0, 1, 2))
        upper = tuple(max(corner[row] for corner in corners) for row in (0, 1, 2))
        return (lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2])

    def _repr_html_(self) -> str:
        return html_table(
            self.name,
            [
                ("samples", f"{self.dims[0]} × {self.dims[1]} × {self.dims[2]}, {self.dtype.name}"),
                ("spacing", " × ".join(f"{value:g}" for value in self.spacing)),
                ("range", "no finite sample" if self.range is None else f"{self.range[0]:g} to {self.range[1]:g}"),
                ("source", self.source),
                ("patient frame", self.patient_frame or "none"),
                *self._series_rows(),
                ("shards", f"{self.shard_count}" + ("" if self.is_ready else f", missing {self.missing_shards}")),
            ],
        )

    def _series_rows(self) -> list[tuple[str, str]]:
        """Returns the table rows of fields and times; none without them."""
        fields = [one.name + (f" ({one.unit})" if one.unit else "") for one in self.fields]
        rows = [("fields", ", ".join(fields))] if fields else []
        if self.time_steps:
            first, last = self.time_steps[0].time, self.time_steps[-1].time
            unit = f" {self.time_unit}" if self.time_unit else ""
            rows.append(("times", f"{len(self.time_steps)}, {first:g} to {last:g}{unit}"))
        return rows


def html_table(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Returns a small table for notebooks."""
    cells = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
        f"<td style='text-align:left'>{html.escape(value)}</td></tr>"
        for name, value in rows
    )
    return f"<table><caption style='text-align:left'><b>{html.escape(title)}</b></caption>{cells}</table>"
