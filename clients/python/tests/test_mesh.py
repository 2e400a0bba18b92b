"""`Mesh.save`: every format holds the points and triangles, as a reader that isn't ours finds them."""

import importlib.util
import json
import pathlib
import re
import struct
import sys
import types

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


TAN = (210 / 255, 180 / 255, 140 / 255, 0.5)


@pytest.fixture
def painted(mesh):
    """The same, the first surface in a translucent colour."""
    colors = (TAN, (1.0, 0.0, 0.0, 1.0))
    return isoscope.Mesh(
        mesh.points, mesh.normals, mesh.triangles, mesh.triangle_surface, mesh.isovalues, surface_colors=colors
    )


def test_triangles_have_the_colours_of_their_surfaces(mesh, painted):
    assert (painted.triangle_colors[:4] == [210, 180, 140, 128]).all()
    assert (painted.triangle_colors[4:] == [255, 0, 0, 255]).all() and painted.triangle_colors.dtype == np.uint8
    assert (painted.surface(1).triangle_colors == [255, 0, 0, 255]).all()
    # Without colours it is the clay that pictures have.
    header = (pathlib.Path(__file__).resolve().parents[3] / "core" / "frame" / "appearance.h").read_text()
    clay = re.search(r"base_color\{(\d+), (\d+), (\d+), (\d+)\}", header).groups()
    assert (mesh.triangle_colors == [int(channel) for channel in clay]).all()


class Trimesh:
    """As much of trimesh.Trimesh as the package uses."""

    def __init__(self, **given):
        self.__dict__.update(given, face_attributes={})


class PolyData:
    """As much of pyvista.PolyData as the package uses."""

    class Attributes(dict):
        active_normals_name = None

    def __init__(self, points, faces):
        self.points, self.faces = points, faces
        self.point_data, self.cell_data = self.Attributes(), self.Attributes()


def test_trimesh_gets_normals_colours_and_surfaces(painted, monkeypatch):
    if importlib.util.find_spec("trimesh") is None:
        monkeypatch.setitem(sys.modules, "trimesh", types.SimpleNamespace(Trimesh=Trimesh))
        made = painted.to_trimesh()
        assert made.process is False and made.face_colors.shape == (8, 4)
    else:
        made = painted.to_trimesh()
        assert made.visual.face_colors[0].tolist() == [210, 180, 140, 128] and made.is_watertight
    assert (made.vertices == painted.points).all() and (made.faces == painted.triangles).all()
    assert np.allclose(made.vertex_normals[:7], painted.normals[:7])
    assert made.face_attributes["surface"].tolist() == [0] * 4 + [1] * 4 and made.metadata["isovalues"] == (10.0, 20.0)


def test_pyvista_gets_normals_colours_and_surfaces(painted, monkeypatch):
    if importlib.util.find_spec("pyvista") is None:
        monkeypatch.setitem(sys.modules, "pyvista", types.SimpleNamespace(PolyData=PolyData))
    made = painted.to_pyvista()
    faces = made.faces.reshape(-1, 4)
    assert (made.points == painted.points).all() and (faces[:, 0] == 3).all() and (faces[:, 1:] == painted.triangles).all()
    assert (made.point_data["Normals"] == painted.normals).all() and made.point_data.active_normals_name == "Normals"
    assert (made.cell_data["colors"] == painted.triangle_colors).all() and list(made.cell_data["surface"]) == [0] * 4 + [1] * 4


@pytest.mark.parametrize("package", ["trimesh", "pyvista"])
def test_a_missing_package_is_an_error_with_what_installs_it(painted, monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(isoscope.MissingPackageError, match=f"python3 -m pip install {package}") as caught:
        getattr(painted, f"to_{package}")()
    assert isinstance(caught.value, ImportError) and isinstance(caught.value, isoscope.IsoscopeError)


def test_a_mesh_has_the_colours_that_a_picture_would_have(dataset):
    mesh = dataset.mesh(surfaces=[isoscope.Surface(127.5, color="tan", opacity=0.5), 60])
    assert mesh.surface_colors[0] == pytest.approx(TAN)
    assert mesh.triangle_colors[-1].tolist() == [222, 209, 190, 255]
    (label,) = dataset.mesh(labels=[255]).surface_colors
    assert label == pytest.approx(isoscope.look.parse_color(isoscope.labels.label_color(255), "color"))


def test_a_closed_mesh_has_the_volume_of_its_solids(mesh):
    assert mesh.is_closed and mesh.open_edge_count == 0
    assert mesh.volume == pytest.approx(2 * (1 / 3) * 2 / 6)
    assert mesh.surface(0).volume == pytest.approx(1 / 9)
    assert mesh.area == pytest.approx(2 * mesh.surface(1).area)
    open_mesh = isoscope.Mesh(mesh.points, mesh.normals, mesh.triangles[1:], mesh.triangle_surface[1:], mesh.isovalues)
    assert open_mesh.open_edge_count == 3 and not open_mesh.is_closed and open_mesh.volume is None
    turned = isoscope.Mesh(mesh.points, mesh.normals, mesh.triangles[:, ::-1], mesh.triangle_surface, mesh.isovalues)
    assert turned.volume == pytest.approx(-mesh.volume)
    order = np.random.default_rng(3).permutation(len(mesh.triangles))
    other = isoscope.Mesh(mesh.points, mesh.normals, mesh.triangles[order], mesh.triangle_surface, mesh.isovalues)
    assert (other.area, other.volume) == (mesh.area, mesh.volume)
    empty = isoscope.Mesh(mesh.points[:0], mesh.normals[:0], mesh.triangles[:0], mesh.triangle_surface[:0], (1.0,))
    assert (empty.area, empty.volume) == (0, 0)


@pytest.fixture
def far(mesh):
    """The same in centimetres, in metres of UTM: float32 has steps of 0.5 there."""
    origin = (500000.0, 4600000.0, -2.5)
    points = mesh.points.astype(np.float64) / 100 + origin
    return isoscope.Mesh(points, mesh.normals, mesh.triangles, mesh.triangle_surface, mesh.isovalues, origin)


def test_positions_far_from_the_origin_keep_their_digits(mesh, far, tmp_path):
    assert far.volume == pytest.approx(mesh.volume / 100**3, rel=1e-6)
    far.save(tmp_path / "m.ply")
    data = (tmp_path / "m.ply").read_bytes()
    head, body = data[: data.index(b"end_header\n") + 11].decode(), data[data.index(b"end_header\n") + 11 :]
    assert head.count("property double") == 3
    vertices = np.frombuffer(body, [("point", "<f8", 3), ("normal", "<f4", 3)], 8)
    assert (vertices["point"] == far.points).all() and (vertices["normal"] == far.normals).all()
    far.save(tmp_path / "m.obj")
    lines = [line.split() for line in (tmp_path / "m.obj").read_text().splitlines()]
    assert (np.float64([line[1:] for line in lines if line[0] == "v"]) == far.points).all()
    with pytest.warns(UserWarning, match="from the origin 500000 4600000 -2.5"):
        far.save(tmp_path / "m.stl")
    data = (tmp_path / "m.stl").read_bytes()
    assert data[:80] == b"isoscope, origin 500000 4600000 -2.5".ljust(80)
    corners = np.frombuffer(data, "<f4", 12, 84).reshape(4, 3)[1:]
    assert np.allclose(corners, mesh.points[[0, 2, 1]] / 100)
    far.save(tmp_path / "m.glb")
    data = (tmp_path / "m.glb").read_bytes()
    document = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    assert document["nodes"] == [{"mesh": 0, "translation": [500000.0, 4600000.0, -2.5]}]
    assert document["accessors"][0]["max"] == pytest.approx((mesh.points.max(axis=0) / 100).tolist())
    assert far.surface(1).origin == far.origin


def test_more_than_256_surfaces_have_wider_indices(tmp_path):
    points = np.zeros((3, 3), np.float32)
    mesh = isoscope.Mesh(points, points, np.array([[0, 1, 2]]), np.int32([256]), tuple(map(float, range(257))))
    mesh.save(tmp_path / "m.ply")
    data = (tmp_path / "m.ply").read_bytes()
    assert b"property int surface\n" in data and data.endswith(struct.pack("<i", 256))


def test_a_closed_surface_of_a_server_is_measured_as_its_mesh(dataset):
    clip = isoscope.Clip(planes=[(1, 0, 0, 10)])
    is_open = dataset.mesh(127.5, clip=clip)
    assert not is_open.is_closed
    mesh = dataset.mesh(127.5, clip=clip, closed=True)
    assert mesh.is_closed and mesh.volume > 0 and mesh.points.dtype == np.float32 and mesh.origin is None
    (measures,) = dataset.measure(127.5, clip=clip, closed=True)
    assert measures.area == pytest.approx(mesh.area, rel=1e-6) and measures.volume == pytest.approx(mesh.volume, rel=1e-5)
    assert measures.is_closed and measures.triangle_count == len(mesh.triangles)
    two = dataset.measure(surfaces=[127.5, 60], clip=clip)
    assert two[0].volume is None and two[0].open_edge_count == is_open.open_edge_count
    assert two[0].area == pytest.approx(is_open.area, rel=1e-6)
    with pytest.raises(isoscope.InvalidArgumentError, match="closed=True"):
        dataset.mesh(127.5, clip=isoscope.Clip(planes=[(1, 0, 0, 10)], caps=True))


def test_an_older_server_is_not_asked_to_close(dataset):
    import dataclasses

    from isoscope import _request

    old = dataclasses.replace(dataset._client._capabilities, features=frozenset({"labels"}))
    request = _request.export(dataset, 127.5, None, None, capabilities=old)
    assert not request.with_origin
    with pytest.raises(isoscope.FailedPreconditionError, match="older"):
        _request.measure(request)
    with pytest.raises(isoscope.FailedPreconditionError, match="older"):
        _request.export(dataset, 127.5, None, None, closed=True, capabilities=old)


def test_a_volume_far_from_the_origin_gives_float64_points(run, tmp_path):
    counts = []
    for number, (spacing, origin) in enumerate((("1", "0,0,0"), ("0.01", "500000,4600000,0"), ("0.000001", "1000,1000,1000"))):
        path = tmp_path / f"{number}.nrrd"
        run("generate", "shells", "--dims", "24,24,24", "--type", "float32", "--spacing", ",".join([spacing] * 3),
            "--origin", origin, "--output", path)  # fmt: skip
        with isoscope.serve(path) as client:
            mesh = client.dataset().mesh(0.5)
        assert (mesh.points.dtype == np.float64) == (number > 0) and (mesh.origin is None) == (number == 0)
        counts.append(len(np.unique(mesh.points, axis=0)))
        assert counts[-1] == len(mesh.points)
    assert counts[0] > 1000 and set(counts) == {counts[0]}
