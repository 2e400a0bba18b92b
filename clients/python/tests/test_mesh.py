"""`Mesh.save`: every format holds the points and triangles, as a reader that isn't ours finds them."""

import importlib.util
import json
import re
import struct

import numpy as np
import pytest

import isoscope
import skips

ENDINGS = ("ply", "stl", "obj", "glb")


@pytest.fixture
def mesh():
    """Two tetrahedra, a surface each; the last point has no normal."""
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1 / 3, 0], [0, 0, 2]])
    triangles = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    normals = np.full((8, 3), 3**-0.5, np.float32)
    normals[7] = 0
    return isoscope.Mesh(
        np.vstack([corners, corners + 5]), normals, np.vstack([triangles, triangles + 4]),
        np.repeat(np.uint8([0, 1]), 4), (10.0, 20.0),
    )  # fmt: skip


def test_iteration_and_in_agree(mesh):
    points, triangles = mesh
    assert points in mesh and triangles in mesh
    assert mesh.normals not in mesh and 7 not in mesh and "points" not in mesh


def test_ply_holds_points_normals_and_surfaces(mesh, tmp_path):
    assert mesh.save(tmp_path / "m.PLY") == tmp_path / "m.PLY"
    data = (tmp_path / "m.PLY").read_bytes()
    head, body = data[: data.index(b"end_header\n") + 11].decode(), data[data.index(b"end_header\n") + 11 :]
    assert re.search("format binary_little_endian 1.0\nelement vertex 8\n(property float n?[xyz]\n){6}", head)
    vertices = np.frombuffer(body, "<f4", 48).reshape(8, 6)
    assert (vertices[:, :3] == mesh.points).all() and (vertices[:, 3:] == mesh.normals).all()
    faces = np.frombuffer(body, [("count", "u1"), ("corners", "<u4", 3), ("surface", "u1")], 8, 8 * 24)
    assert (faces["count"] == 3).all() and (faces["corners"] == mesh.triangles).all()
    assert (faces["surface"] == mesh.triangle_surface).all() and len(body) == 8 * 24 + 8 * 14


def test_stl_holds_corners_and_the_normals_of_planes(mesh, tmp_path):
    mesh.save(tmp_path / "m.stl")
    data = (tmp_path / "m.stl").read_bytes()
    assert struct.unpack_from("<I", data, 80) == (8,) and len(data) == 84 + 8 * 50 and not data.startswith(b"solid")
    first = np.frombuffer(data, "<f4", 12, 84).reshape(4, 3)
    assert first[0].tolist() == [0, 0, -1] and (first[1:] == mesh.points[[0, 2, 1]]).all()


def test_obj_keeps_every_bit_and_groups_surfaces(mesh, tmp_path):
    mesh.save(tmp_path / "m.obj")
    lines = [line.split() for line in (tmp_path / "m.obj").read_text().splitlines()]
    points = np.float32([line[1:] for line in lines if line[0] == "v"])
    assert (points == mesh.points).all()
    faces = [line for line in lines if line[0] in "gf"]
    assert faces[0] == ["g", "surface_0"] and faces[5] == ["g", "surface_1"] and faces[6] == "f 5//5 7//7 6//6".split()


def test_glb_holds_a_primitive_for_each_surface_and_unit_normals(mesh, tmp_path):
    mesh.save(tmp_path / "m.glb")
    data = (tmp_path / "m.glb").read_bytes()
    magic, version, length, text_length, kind = struct.unpack_from("<4sII I4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON") and text_length % 4 == 0
    document = json.loads(data[20 : 20 + text_length])
    size, kind = struct.unpack_from("<I4s", data, 20 + text_length)
    binary = data[28 + text_length :]
    assert (size, kind) == (len(binary), b"BIN\0") and document["buffers"][0]["byteLength"] == size

    def read(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        kind = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
        return np.frombuffer(binary[view["byteOffset"] :][: view["byteLength"]], kind)

    first, second = document["meshes"][0]["primitives"]
    assert (read(first["attributes"]["POSITION"]).reshape(-1, 3) == mesh.points).all()
    assert np.allclose(np.linalg.norm(read(first["attributes"]["NORMAL"]).reshape(-1, 3), axis=1), 1)
    assert (read(second["indices"]).reshape(-1, 3) == mesh.triangles[4:]).all()
    assert second["extras"] == {"isovalue": 20.0}
    assert document["accessors"][first["attributes"]["POSITION"]]["max"] == mesh.points.max(axis=0).tolist()


def test_other_endings_and_empty_files_are_errors(mesh, tmp_path):
    with pytest.raises(isoscope.IsoscopeError, match=r"\.ply, \.stl, \.obj or \.glb"):
        mesh.save(tmp_path / "m.step")
    empty = isoscope.Mesh(mesh.points[:0], mesh.normals[:0], mesh.triangles[:0], mesh.triangle_surface[:0], (1.0,))
    with pytest.raises(isoscope.InvalidArgumentError, match="without triangles"):
        empty.save(tmp_path / "m.glb")
    for ending in ("ply", "stl", "obj"):
        empty.save(tmp_path / f"m.{ending}")


@pytest.mark.parametrize("ending", ENDINGS[:3])
def test_vtk_reads_what_was_saved(dataset, tmp_path, ending):
    if importlib.util.find_spec("vtkmodules") is None:
        skips.skip("vtk", "no VTK (python3-vtk9)")
    from vtkmodules.vtkFiltersCore import vtkMassProperties
    from vtkmodules.vtkIOGeometry import vtkOBJReader, vtkSTLReader
    from vtkmodules.vtkIOPLY import vtkPLYReader

    mesh = dataset.mesh(127.5)
    reader = {"ply": vtkPLYReader, "stl": vtkSTLReader, "obj": vtkOBJReader}[ending]()
    reader.SetFileName(str(mesh.save(tmp_path / f"m.{ending}")))
    properties = vtkMassProperties()
    properties.SetInputConnection(reader.GetOutputPort())
    properties.Update()
    assert reader.GetOutput().GetNumberOfPolys() == pytest.approx(len(mesh.triangles), rel=1e-2)
    assert properties.GetSurfaceArea() == pytest.approx(mesh.area, rel=1e-4)
