"""A mesh in memory."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from isoscope import _mesh_files
from isoscope.errors import IsoscopeError


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
