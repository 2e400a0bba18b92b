"""Meshes as files, with numpy alone: formats of `isoscope export`. Others are written by PyVista, if it is there."""

from __future__ import annotations

import json
import math
import pathlib
import struct
import warnings
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from isoscope.errors import InvalidArgumentError, IsoscopeError

# glTF 2.0, sections 3.6 and 4.4.
_GLB_MAGIC, _GLB_VERSION, _JSON_CHUNK, _BINARY_CHUNK = b"glTF", 2, b"JSON", b"BIN\0"
_FLOAT, _UNSIGNED_INT, _VERTEX_BUFFER, _INDEX_BUFFER = 5126, 5125, 34962, 34963


class Mesh(Protocol):
    """The parts of an isoscope.Mesh that files have."""

    @property
    def points(self) -> npt.NDArray[Any]: ...
    @property
    def normals(self) -> npt.NDArray[np.float32]: ...
    @property
    def triangles(self) -> npt.NDArray[np.int64]: ...
    @property
    def triangle_surface(self) -> npt.NDArray[Any]: ...
    @property
    def isovalues(self) -> tuple[float, ...]: ...
    @property
    def origin(self) -> tuple[float, float, float] | None: ...
    def to_pyvista(self) -> Any: ...


def save(mesh: Mesh, path: pathlib.Path) -> None:
    """Writes the format that the name's ending says."""
    suffix = path.suffix.lower()
    if suffix == ".stl" and mesh.origin is not None:
        warnings.warn(f"{path}: positions are from the origin {_text_of(mesh.origin)}, because STL has float32", stacklevel=3)
    if suffix in _WRITERS:
        path.write_bytes(_WRITERS[suffix](mesh))
    elif suffix in (".vtp", ".vtk"):
        mesh.to_pyvista().save(path)
    else:
        raise IsoscopeError(
            f"can't save a mesh as {str(path)!r}: the name must end in .ply, .stl, .obj or .glb, or, with PyVista, in "
            ".vtp or .vtk"
        )


def _as_uint32(mesh: Mesh) -> npt.NDArray[np.uint32]:
    if len(mesh.points) > 0xFFFFFFFF:
        raise InvalidArgumentError(f"mesh of {len(mesh.points)} points: files have 32-bit indices")
    return mesh.triangles.astype("<u4")


def _text_of(origin: tuple[float, float, float]) -> str:
    return " ".join(f"{value:.15g}" if float(f"{value:.15g}") == value else repr(value) for value in origin)


def _offsets(mesh: Mesh) -> npt.NDArray[np.float32]:
    """Points as float32, from the origin."""
    return np.asarray(mesh.points - (mesh.origin or (0, 0, 0)), np.float32)


def _ply(mesh: Mesh) -> bytes:
    """Binary PLY: points with normals, faces with the index of their surface."""
    is_wide = mesh.points.dtype == np.float64
    vertices = np.empty(len(mesh.points), [("point", "<f8" if is_wide else "<f4", 3), ("normal", "<f4", 3)])
    vertices["point"], vertices["normal"] = mesh.points, mesh.normals
    surface = "u1" if len(mesh.isovalues) <= 256 else "<i4"
    head = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.points)}\n"
        + "".join(f"property {'double' if is_wide else 'float'} {name}\n" for name in "xyz")
        + "".join(f"property float n{name}\n" for name in "xyz")
        + f"element face {len(mesh.triangles)}\nproperty list uchar uint vertex_indices\n"
        f"property {'uchar' if surface == 'u1' else 'int'} surface\nend_header\n"
    )
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<u4", 3), ("surface", surface)])
    faces["count"], faces["corners"], faces["surface"] = 3, _as_uint32(mesh), mesh.triangle_surface
    return head.encode() + vertices.tobytes() + faces.tobytes()


def _stl(mesh: Mesh) -> bytes:
    """Binary STL: each triangle with its own corners and the normal of its plane; 0 where it has none."""
    facets = np.zeros(len(mesh.triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    corners = _offsets(mesh)[mesh.triangles].astype(np.float64).reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    facets["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    facets["corners"] = corners
    title = "isoscope" if mesh.origin is None else f"isoscope, origin {_text_of(mesh.origin)}"
    return title.encode()[:80].ljust(80) + struct.pack("<I", len(facets)) + facets.tobytes()


def _obj(mesh: Mesh) -> bytes:
    """Wavefront OBJ: a group for each surface. Nine digits keep the bits of a float, 17 those of a double."""
    digits = 17 if mesh.points.dtype == np.float64 else 9
    lines = ["v " + " ".join(f"{value:.{digits}g}" for value in point) for point in mesh.points.tolist()]
    lines += ["vn {:.9g} {:.9g} {:.9g}".format(*normal) for normal in mesh.normals.tolist()]
    for surface in range(len(mesh.isovalues)):
        lines.append(f"g surface_{surface}")
        for corners in (mesh.triangles[mesh.triangle_surface == surface] + 1).tolist():
            lines.append("f " + " ".join(f"{corner}//{corner}" for corner in corners))
    return ("\n".join(lines) + "\n").encode()


def _glb(mesh: Mesh) -> bytes:
    """glTF 2.0 in one binary file: a primitive for each surface that has triangles."""
    if not len(mesh.triangles):
        raise InvalidArgumentError("mesh without triangles: a .glb can't hold it")
    views: list[dict[str, Any]] = []
    accessors: list[dict[str, Any]] = []
    binary = bytearray()

    def add(values: npt.NDArray[Any], component: int, kind: str, target: int, **bounds: Any) -> int:
        data = values.tobytes()
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data), "target": target})
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind, **bounds}
        )
        binary.extend(data)
        return len(accessors) - 1

    points = _offsets(mesh).astype("<f4")
    ends = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    # The normals of a glTF have length 1.
    has_none = ~mesh.normals.any(axis=1, keepdims=True)
    normals = np.where(has_none, np.array([0, 0, 1], np.float32), mesh.normals).astype("<f4")
    attributes = {
        "POSITION": add(points, _FLOAT, "VEC3", _VERTEX_BUFFER, **ends),
        "NORMAL": add(normals, _FLOAT, "VEC3", _VERTEX_BUFFER),
    }
    node: dict[str, Any] = {"mesh": 0}
    if mesh.origin is not None:
        node["translation"] = list(mesh.origin)
    primitives = []
    for surface in np.unique(mesh.triangle_surface).tolist():
        indices = _as_uint32(mesh)[mesh.triangle_surface == surface].ravel()
        primitives.append(
            {
                "attributes": attributes,
                "indices": add(indices, _UNSIGNED_INT, "SCALAR", _INDEX_BUFFER),
                "extras": {} if math.isnan(mesh.isovalues[surface]) else {"isovalue": mesh.isovalues[surface]},
            }
        )
    document = {
        "asset": {"version": "2.0", "generator": "isoscope"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": primitives}],
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), _JSON_CHUNK) + text
    chunks += struct.pack("<I4s", len(binary), _BINARY_CHUNK) + bytes(binary)
    return struct.pack("<4sII", _GLB_MAGIC, _GLB_VERSION, 12 + len(chunks)) + chunks


_WRITERS = {".ply": _ply, ".stl": _stl, ".obj": _obj, ".glb": _glb}
