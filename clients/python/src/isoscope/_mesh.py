"""A mesh in memory."""

from __future__ import annotations

import math
import os
import pathlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from isoscope import _mesh_files
from isoscope.errors import MissingPackageError

#: Red, green, blue and alpha of one surface, from 0 to 1.
Rgba = tuple[float, float, float, float]
#: Of surfaces without a colour: the light clay that pictures have (core/frame/appearance.h).
CLAY = (222 / 255, 209 / 255, 190 / 255, 1.0)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Whole isosurfaces as one mesh, each welded.

    Attributes:
        points: float32, shape (n, 3): world positions; float64 where float32 can't tell neighbouring ones apart.
        normals: float32, shape (n, 3): unit vectors towards smaller values, or 0.
        triangles: int64, shape (m, 3): indices of points, counter-clockwise seen from the side where
            the field is below the isovalue.
        triangle_surface: shape (m,): index of the surface of each triangle; uint8, int32 of more than 256 surfaces.
        isovalues: isovalue of each surface; NaN of one of labels.
        origin: where points are float64: the world position that .stl and .glb files have offsets from, as float32.
        surface_colors: colour of each surface, sRGB from 0 to 1 with alpha; empty: the light clay of pictures.
    """

    points: npt.NDArray[np.float32] | npt.NDArray[np.float64]
    normals: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int64]
    triangle_surface: npt.NDArray[Any]
    isovalues: tuple[float, ...]
    origin: tuple[float, float, float] | None = None
    surface_colors: tuple[Rgba, ...] = ()

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

        A mesh with an origin has doubles in .ply and .obj, and offsets from it in .stl and .glb, as these formats
        have float32 alone. The mesh is in memory here: `isoscope export` writes the same formats without that.
        """
        target = pathlib.Path(path)
        _mesh_files.save(self, target)
        return target

    @property
    def area(self) -> float:
        """Sum of the areas of all triangles, world units squared; rounded once, so their order doesn't show."""
        a, b, c = self._corners()
        return math.fsum(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)

    @property
    def open_edge_count(self) -> int:
        """Number of edges that have fewer triangles on one side than on the other: 0 for closed surfaces."""
        if not len(self.triangles):
            return 0
        start = self.triangles.ravel().astype(np.int64)
        end = np.roll(self.triangles, -1, axis=1).ravel().astype(np.int64)
        low, high = np.minimum(start, end), np.maximum(start, end)
        _, edge = np.unique(low * len(self.points) + high, return_inverse=True)
        balance = np.bincount(edge.ravel(), np.where(start < end, 1, -1))
        return int(np.abs(balance).sum())

    @property
    def is_closed(self) -> bool:
        """Whether each edge of a triangle is that of one more."""
        return self.open_edge_count == 0

    @property
    def volume(self) -> float | None:
        """Volume that the surfaces enclose, world units cubed, rounded once; None if one is open.

        It is negative for a surface that encloses what is outside, as around a bubble.
        """
        if not self.is_closed:
            return None
        a, b, c = self._corners()
        return math.fsum(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)

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
            self.origin,
            self.surface_colors[index : index + 1],
        )

    @property
    def triangle_colors(self) -> npt.NDArray[np.uint8]:
        """Colour of each triangle, that of its surface: uint8, shape (m, 4), sRGB with alpha."""
        colors = [*self.surface_colors, *[CLAY] * (len(self.isovalues) - len(self.surface_colors))]
        table = np.rint(np.clip(np.asarray(colors, np.float64).reshape(-1, 4), 0, 1) * 255).astype(np.uint8)
        found: npt.NDArray[np.uint8] = table[self.triangle_surface]
        return found

    def to_pyvista(self) -> Any:
        """Returns a pyvista.PolyData: point normals "Normals"; "surface" and colours "colors" of its cells.

        `mesh.to_pyvista().plot(scalars="colors", rgb=True)` shows the colours.

        Raises:
            MissingPackageError: PyVista is not installed.
        """
        try:
            import pyvista
        except ImportError as error:
            raise MissingPackageError("to_pyvista needs PyVista: python3 -m pip install pyvista") from error
        faces = np.empty((len(self.triangles), 4), np.int64)
        faces[:, 0] = 3
        faces[:, 1:] = self.triangles
        poly = pyvista.PolyData(self.points, faces.ravel())
        poly.point_data["Normals"] = self.normals
        poly.point_data.active_normals_name = "Normals"
        poly.cell_data["surface"] = self.triangle_surface
        poly.cell_data["colors"] = self.triangle_colors
        return poly

    def to_trimesh(self) -> Any:
        """Returns a trimesh.Trimesh with the normals of points and the colours of triangles, its points not merged.

        The surface of each triangle is in `face_attributes["surface"]`, the isovalues in `metadata`.

        Raises:
            MissingPackageError: trimesh is not installed.
        """
        try:
            import trimesh
        except ImportError as error:
            raise MissingPackageError("to_trimesh needs trimesh: python3 -m pip install trimesh") from error
        made = trimesh.Trimesh(
            vertices=self.points, faces=self.triangles, vertex_normals=self.normals, face_colors=self.triangle_colors,
            metadata={"isovalues": self.isovalues}, process=False, validate=False,
        )  # fmt: skip
        made.face_attributes["surface"] = self.triangle_surface
        return made

    def _corners(self) -> list[npt.NDArray[np.float64]]:
        """Returns the first, second and third corners, from a point near them."""
        base = self.points.min(axis=0).astype(np.float64) if len(self.points) else np.zeros(3)
        return [self.points[self.triangles[:, corner]].astype(np.float64) - base for corner in (0, 1, 2)]
