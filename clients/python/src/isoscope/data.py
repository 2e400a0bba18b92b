"""Values in a server's answers: datasets, histograms, statistics, picked points, meshes.

Names are those of the protos and of `--json`. Values are immutable, and numbers keep their bits:

    dataset = client["head"]        # DatasetInfo: geometry in x, y, z; a numpy array has the shape dims[::-1]
    dataset.histogram()             # Histogram: one element a bin
    frame.stats.durations_ms        # Statistics: milliseconds by step
    dataset.mesh(60).points         # Mesh: world positions, float32
"""

from __future__ import annotations

import html
import os
import pathlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from isoscope._renamed import renamed
from isoscope.camera import Camera, Vec3, default_camera, named_camera
from isoscope.errors import IsoscopeError
from isoscope.labels import Label

if TYPE_CHECKING:
    from isoscope.look import ColorBy

__all__ = [
    "AgentState",
    "AgentStatistics",
    "Capabilities",
    "DatasetInfo",
    "Field",
    "FieldComponent",
    "FieldValue",
    "Histogram",
    "Mesh",
    "PickedPoint",
    "Statistics",
    "Suggestion",
    "SurfaceColoring",
    "SurfaceStatistics",
    "TimeStep",
]


def _seconds(milliseconds: float) -> float:
    return milliseconds / 1000


@dataclass(frozen=True)
class Capabilities:
    """Version and limits of a server.

    Attributes:
        version: as `isoscope-coordinator --version` prints it.
        max_viewport: largest side of a picture, pixels.
        max_concurrent_frames: most frames in work at a time; more wait.
        max_queued_frames: most frames that wait; more are refused with ResourceExhaustedError.
        max_message_bytes: largest message.
        max_frame_seconds: longest time of a frame.
        gateway_address: address of the web gateway, such as "https://host:8080/"; None if there is none.
        features: what the server can do beyond its first version, such as "dataset_id".
    """

    version: str
    max_viewport: int
    max_concurrent_frames: int
    max_queued_frames: int
    max_message_bytes: int
    max_frame_seconds: float
    gateway_address: str | None = None
    features: frozenset[str] = frozenset()


@dataclass(frozen=True)
class AgentState:
    """One agent of the cluster, as the coordinator last saw it.

    Attributes:
        address: as the coordinator dials it.
        is_reachable: whether it answers; `message` says why not.
        message: "" if all is well.
        is_draining: whether it is about to stop: it gets no new frames.
        version, renderer, picture_revision: for people.
        shards: (dataset name, shard index, number of blocks) of each shard that it serves.
    """

    address: str
    is_reachable: bool
    message: str
    version: str
    renderer: str
    picture_revision: str
    shards: tuple[tuple[str, int, int], ...]
    is_draining: bool = False


@dataclass(frozen=True)
class TimeStep:
    """A time step of a dataset: its number, which never changes, and its time in `DatasetInfo.time_unit`."""

    number: int
    time: float


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


@dataclass(frozen=True)
class Suggestion:
    """An isovalue that is worth a look.

    Attributes:
        method: "between_classes" (Otsu 1979) or "one_percent" (encloses 1 % of the samples).
        isovalue: in field units.
        inside_fraction: share of the samples that are inside (>= isovalue), in (0, 1).
    """

    method: Literal["between_classes", "one_percent", "unknown"]
    isovalue: float
    inside_fraction: float


@dataclass(frozen=True, eq=False)
class Histogram:
    """Samples by value, and what the surface at each value costs. Arrays have one element for each bin.

    Attributes:
        edges: float64, shape (bins + 1,): bin i holds edges[i] <= value < edges[i + 1], field units.
        sample_count: int64: samples in each bin; all 0 without `has_sample_counts`.
        active_block_count: int64: blocks that the surface in the middle of the bin meets.
        active_block_bytes: int64: their size in the shards: the most that a first frame reads.
        estimated_triangle_count: int64: estimated triangles of that surface, mostly within a factor of 2.
        has_sample_counts: whether samples were counted when the volume was partitioned.
        nan_count, negative_infinity_count, positive_infinity_count: samples outside of all bins.
        suggestions: isovalues that are worth a look.
        field, component, step: what was counted; None where the dataset has no fields or no times.
    """

    edges: npt.NDArray[np.float64]
    sample_count: npt.NDArray[np.int64]
    active_block_count: npt.NDArray[np.int64]
    active_block_bytes: npt.NDArray[np.int64]
    estimated_triangle_count: npt.NDArray[np.int64]
    has_sample_counts: bool
    nan_count: int
    negative_infinity_count: int
    positive_infinity_count: int
    suggestions: tuple[Suggestion, ...]
    field: str | None = None
    component: str | None = None
    step: int | None = None

    @property
    def centers(self) -> npt.NDArray[np.float64]:
        """Middle of each bin, field units, shape (bins,)."""
        return (self.edges[:-1] + self.edges[1:]) / 2

    def __len__(self) -> int:
        return len(self.sample_count)

    def __repr__(self) -> str:
        ends = f"{self.edges[0]:g} to {self.edges[-1]:g}" if len(self) else "empty"
        return f"Histogram({len(self)} bins, {ends}, {int(self.sample_count.sum())} samples)"

    counts = renamed("counts", "sample_count")
    active_blocks = renamed("active_blocks", "active_block_count")
    active_bytes = renamed("active_bytes", "active_block_bytes")
    triangles = renamed("triangles", "estimated_triangle_count")
    has_counts = renamed("has_counts", "has_sample_counts")


@dataclass(frozen=True)
class SurfaceStatistics:
    """Cost of one surface of a frame: triangles, and grid edges that it crosses, in the drawn blocks."""

    triangle_count: int
    unique_vertex_count: int

    triangles = renamed("triangles", "triangle_count")
    vertices = renamed("vertices", "unique_vertex_count")


@dataclass(frozen=True)
class AgentStatistics:
    """Cost of one agent's part in a frame. Milliseconds are wall time.

    Attributes:
        address: as the coordinator dialled it.
        shards: shards that it worked on.
        active_block_count, visible_block_count: blocks that a surface meets; that were drawn.
        triangle_count: extracted for this frame.
        read_bytes: read from disk.
        busy_ms: all its work; extract_ms and render_ms are parts of it.
    """

    address: str
    shards: tuple[int, ...]
    active_block_count: int
    visible_block_count: int
    triangle_count: int
    read_bytes: int
    busy_ms: float
    extract_ms: float
    render_ms: float

    active_blocks = renamed("active_blocks", "active_block_count")
    visible_blocks = renamed("visible_blocks", "visible_block_count")
    triangles = renamed("triangles", "triangle_count")
    busy_seconds = renamed("busy_seconds", "busy_ms", _seconds)
    extract_seconds = renamed("extract_seconds", "extract_ms", _seconds)
    render_seconds = renamed("render_seconds", "render_ms", _seconds)


@dataclass(frozen=True)
class Statistics:
    """Cost of one frame, over all agents, with the names of `isoscope render --stats FILE.json`.

    Attributes:
        active_block_count: blocks that a surface meets and that are not clipped.
        ray_hit_block_count: blocks that rays of the depth estimate hit.
        visible_block_count: blocks that were extracted and drawn.
        culled_block_count: active blocks outside the view, or hidden.
        occluding_block_count: blocks that were drawn first.
        triangle_count: extracted for this frame, of all surfaces.
        unique_vertex_count: grid edges that cross an isovalue, in the drawn blocks.
        read_bytes: read from shards; bytes found in a cache don't count.
        network_bytes: of messages between coordinator and agents.
        png_bytes: size of the PNG; 0 if none was asked for.
        truncated_pixel_count: pixels with more translucent fragments than max_layers.
        missing_shards: whose blocks the picture lacks; only with `allow_partial`.
        active_block_coverage: share of the active blocks that the picture has a chance to show; None if no shard is
            missing.
        durations_ms: wall time by step, milliseconds: "occluder_selection", "occluder_rendering",
            "visibility_culling", "composite", "encode".
        agents: parts of the agents.
        surfaces: by surface, in the order of the request.
    """

    active_block_count: int
    ray_hit_block_count: int
    visible_block_count: int
    culled_block_count: int
    occluding_block_count: int
    triangle_count: int
    unique_vertex_count: int
    read_bytes: int
    network_bytes: int
    png_bytes: int
    truncated_pixel_count: int
    missing_shards: tuple[int, ...] = ()
    active_block_coverage: float | None = None
    durations_ms: dict[str, float] = field(default_factory=dict)
    agents: tuple[AgentStatistics, ...] = ()
    surfaces: tuple[SurfaceStatistics, ...] = ()

    @property
    def seconds(self) -> float:
        """Time of the frame in the coordinator, seconds."""
        return sum(self.durations_ms.values()) / 1000

    active_blocks = renamed("active_blocks", "active_block_count")
    visible_blocks = renamed("visible_blocks", "visible_block_count")
    culled_blocks = renamed("culled_blocks", "culled_block_count")
    occluding_blocks = renamed("occluding_blocks", "occluding_block_count")
    triangles = renamed("triangles", "triangle_count")
    vertices = renamed("vertices", "unique_vertex_count")
    truncated_pixels = renamed("truncated_pixels", "truncated_pixel_count")
    coverage = renamed("coverage", "active_block_coverage", lambda share: 1.0 if share is None else share)
    step_seconds = renamed("step_seconds", "durations_ms", lambda steps: {key: _seconds(steps[key]) for key in steps})


@dataclass(frozen=True)
class SurfaceColoring:
    """How a surface with a `color_by` was coloured: with the map and range that were used, for a legend."""

    surface_index: int
    color_by: ColorBy

    surface = renamed("surface", "surface_index")


@dataclass(frozen=True)
class FieldValue:
    """The value of a field's component at a picked point.

    Attributes:
        field: name of the field.
        component: name of the component; "" for the only one.
        unit: unit of the field; None if unknown.
        value: the value that a colour by the field shows there; NaN where there is none.
    """

    field: str
    component: str
    unit: str | None
    value: float


@dataclass(frozen=True)
class PickedPoint:
    """The point at one pixel, with the names of `isoscope pick --json`. For the background there is None instead.

    Attributes:
        pixel: (column, row), row 0 at the top.
        position: point on the surface, world space.
        depth: distance from the eye along the view axis, world units.
        surface_index: index of the surface in the request, from 0.
        normal: unit vector towards smaller values, world space; None if the surface has none there.
        gradient: of the field, field units per world unit; None where it is not finite.
        block_id: id of the block that drew it.
        shard_index: shard that holds the block; None if unknown.
        field_values: values of all fields, in the dataset's order; empty unless `all_fields` asked for them.
        label: value of the label there, if the surface has labels, else None.
        label_name: its name; None if it has none.
    """

    pixel: tuple[int, int]
    position: Vec3
    depth: float
    surface_index: int
    normal: Vec3 | None
    gradient: Vec3 | None
    block_id: int
    shard_index: int | None
    field_values: tuple[FieldValue, ...] = ()
    label: float | None = None
    label_name: str | None = None

    @property
    def is_hit(self) -> bool:
        """True: there is a point."""
        return True

    surface = renamed("surface", "surface_index")
    block = renamed("block", "block_id")
    shard = renamed("shard", "shard_index")


@dataclass(frozen=True, eq=False)
class Mesh:
    """Whole isosurfaces as one mesh, each welded.

    Attributes:
        points: float32, shape (n, 3): world positions.
        normals: float32, shape (n, 3): unit vectors towards smaller values, or 0.
        triangles: int64, shape (m, 3): indices of points, counter-clockwise seen from the side where
            the field is below the isovalue.
        triangle_surface: uint8, shape (m,): index of the surface of each triangle.
        isovalues: isovalue of each surface; NaN of one of labels.
    """

    points: npt.NDArray[np.float32]
    normals: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int64]
    triangle_surface: npt.NDArray[np.uint8]
    isovalues: tuple[float, ...]

    def __repr__(self) -> str:
        values = ", ".join(f"{value:g}" for value in self.isovalues)
        return f"Mesh({len(self.points)} points, {len(self.triangles)} triangles, isovalues {values})"

    def __iter__(self) -> Iterator[npt.NDArray[Any]]:
        """Gives points, triangles: `points, triangles = mesh`."""
        yield self.points
        yield self.triangles

    def __contains__(self, part: object) -> bool:
        """Whether iteration gives this array: by identity, because arrays of other shapes have no truth."""
        return any(part is one for one in self)

    def save(self, path: str | os.PathLike[str]) -> pathlib.Path:
        """Writes a file by the ending of its name: .ply, .stl, .obj, .glb; with PyVista also .vtp and .vtk.

        The mesh is in memory here: `isoscope export` writes the same formats without that.
        """
        from isoscope import _mesh_files

        target = pathlib.Path(path)
        _mesh_files.save(self, target)
        return target

    @property
    def area(self) -> float:
        """Sum of the areas of all triangles, world units squared."""
        return float(self._cross().sum())

    def surface(self, index: int) -> Mesh:
        """Returns one surface alone, its points numbered anew."""
        if not -len(self.isovalues) <= index < len(self.isovalues):
            raise IndexError(f"surface {index}: the mesh has {len(self.isovalues)}")
        index %= len(self.isovalues)
        triangles = self.triangles[self.triangle_surface == index]
        used, renumbered = np.unique(triangles, return_inverse=True)
        return Mesh(
            self.points[used],
            self.normals[used],
            renumbered.reshape(-1, 3).astype(np.int64),
            np.zeros(len(triangles), np.uint8),
            (self.isovalues[index],),
        )

    def to_pyvista(self) -> Any:
        """Returns a pyvista.PolyData with point normals "Normals" and cell data "surface"."""
        try:
            import pyvista
        except ImportError as error:
            raise IsoscopeError("to_pyvista needs PyVista: pip install pyvista") from error
        faces = np.empty((len(self.triangles), 4), np.int64)
        faces[:, 0] = 3
        faces[:, 1:] = self.triangles
        poly = pyvista.PolyData(self.points, faces.ravel())
        poly.point_data["Normals"] = self.normals
        poly.cell_data["surface"] = self.triangle_surface
        return poly

    def _cross(self) -> npt.NDArray[np.float64]:
        a, b, c = (self.points[self.triangles[:, corner]].astype(np.float64) for corner in (0, 1, 2))
        return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)
