"""Values in a server's answers: datasets, histograms, statistics, picked points, meshes.

Names are those of the protos and of `--json`. Values are immutable, and numbers keep their bits:

    dataset = client["head"]        # DatasetInfo: geometry in x, y, z; a numpy array has the shape dims[::-1]
    dataset.histogram()             # Histogram: one element a bin
    frame.stats.durations_ms        # Statistics: milliseconds by step
    dataset.mesh(60).points         # Mesh: world positions, float32
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from isoscope import _xarray
from isoscope._dataset_info import DatasetInfo, DatasetLevel, Field, FieldComponent, TimeStep
from isoscope._mesh import Mesh
from isoscope._statistics import AgentStatistics, Statistics, SurfaceStatistics
from isoscope.camera import Vec3

if TYPE_CHECKING:
    from isoscope.look import Caps, ColorBy

__all__ = [
    "AgentState",
    "AgentStatistics",
    "Capabilities",
    "CapsColoring",
    "DatasetInfo",
    "DatasetLevel",
    "DrawnLevel",
    "Field",
    "FieldComponent",
    "FieldValue",
    "Histogram",
    "LabelValues",
    "Mesh",
    "PickedPoint",
    "Statistics",
    "Suggestion",
    "SurfaceColoring",
    "SurfaceMeasures",
    "SurfaceNote",
    "SurfaceStatistics",
    "TimeStep",
]


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
        suggested_labels: labels to begin with, ascending, if the samples seem to be those of a segmentation: at most
            128, none is 0. Empty: begin with an isovalue.
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
    suggested_labels: tuple[float, ...] = ()

    @property
    def centers(self) -> npt.NDArray[np.float64]:
        """Middle of each bin, field units, shape (bins,)."""
        return (self.edges[:-1] + self.edges[1:]) / 2

    def to_xarray(self) -> Any:
        """Returns an xarray.Dataset of the counts by `value`, the middle of each bin.

        Raises:
            MissingPackageError: xarray is not installed.
        """
        names = ["active_block_count", "active_block_bytes", "estimated_triangle_count"]
        names = ["sample_count", *names] if self.has_sample_counts else names
        what = {"field": self.field, "component": self.component, "step": self.step}
        attributes = {name: value for name, value in what.items() if value is not None}
        return _xarray.histogram(self.centers, {name: getattr(self, name) for name in names}, attributes)

    def __len__(self) -> int:
        return len(self.sample_count)

    def __repr__(self) -> str:
        ends = f"{self.edges[0]:g} to {self.edges[-1]:g}" if len(self) else "empty"
        return f"Histogram({len(self)} bins, {ends}, {int(self.sample_count.sum())} samples)"


@dataclass(frozen=True)
class SurfaceColoring:
    """How a surface with a `color_by` was coloured, for a legend.

    Attributes:
        surface_index: of the frame, from 0.
        color_by: with the map and range that were used.
        nan_color: "#rrggbb" where the field has no value (NaN); None of other quantities.
        shows_nan: whether the picture shows that colour.
    """

    surface_index: int
    color_by: ColorBy
    nan_color: str | None = None
    shows_nan: bool = False


@dataclass(frozen=True)
class CapsColoring:
    """How caps that show samples were coloured, for a legend.

    Attributes:
        caps: the map, and the range that was used.
        nan_color: "#rrggbb" of missing samples.
        shows_nan: whether the picture shows that colour.
    """

    caps: Caps
    nan_color: str
    shows_nan: bool


@dataclass(frozen=True)
class DrawnLevel:
    """The level of a picture, if `render` was asked to choose one.

    Attributes:
        level: its number; 0 is exact.
        max_spacing: pixels that its largest distance between samples covers, where the volume is nearest to the eye.
        spacing: world units between samples along x, y, z.
    """

    level: int
    max_spacing: float
    spacing: Vec3


@dataclass(frozen=True)
class SurfaceNote:
    """Why a surface does not show in a picture, or which of its labels no sample has.

    Attributes:
        surface_index: of the frame, from 0.
        reason: "no_samples", "outside_range", "no_label", "some_labels_missing", "no_cell", "clipped", "outside_picture"
            or "transparent"; newer servers may have others.
        message: a sentence that names the surface, the reason, and the values or labels that there are.
    """

    surface_index: int
    reason: str
    message: str


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
class SurfaceMeasures:
    """Area and enclosed volume of a surface, as the triangles of its mesh have them.

    Attributes:
        area: world units squared.
        volume: world units cubed; None if the surface is open; negative if it encloses what is outside.
        triangle_count: number of triangles.
        open_edge_count: edges that one triangle alone has.
    """

    area: float
    volume: float | None
    triangle_count: int
    open_edge_count: int

    @property
    def is_closed(self) -> bool:
        """Whether there is no open edge."""
        return self.open_edge_count == 0


@dataclass(frozen=True)
class LabelValues:
    """The different values of samples that may be labels: whole numbers.

    Attributes:
        values: ascending; not all, if one of the others is set.
        has_more: whether there are more.
        other_value: a value that is no label; None if there is none.
    """

    values: tuple[float, ...]
    has_more: bool
    other_value: float | None


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
