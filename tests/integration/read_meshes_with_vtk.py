#!/usr/bin/env python3
"""Exports surfaces in every format and reads the files with VTK, which others have written.

    read_meshes_with_vtk.py ISOSCOPE

Counts, bounds, closedness, normals and colours must agree, area and volume with vtkMassProperties, and
the distinct points far from the origin with those at it. Exit code 77 (CTest: skipped) where there is no
VTK: apt-get install python3-vtk9.
"""

import json
import os
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
from debian_vtk import vtk  # noqa: E402

# The first surface is orange in all of them.
SCENES = {
    "whole": ["--isovalue", "0.5"],
    "two clipped": ["--surface", "0.5:1,0.5,0", "--surface", "0.2:0,0,1", "--clip-plane", "1,2,0.5,60"],
}


def read(path):
    """The surface of a file, by VTK's reader for its suffix."""
    suffix = path.rsplit(".", 1)[1]
    if suffix == "glb":
        reader = vtk.vtkGLTFReader()
        reader.SetFileName(path)
        reader.Update()
        surface = vtk.vtkCompositeDataGeometryFilter()
        surface.SetInputConnection(reader.GetOutputPort())
        surface.Update()
        return surface.GetOutput()
    reader = {"ply": vtk.vtkPLYReader, "stl": vtk.vtkSTLReader, "obj": vtk.vtkOBJReader,
              "vtp": vtk.vtkXMLPolyDataReader}[suffix]()
    reader.SetFileName(path)
    reader.Update()
    return reader.GetOutput()


def open_edge_count(surface):
    """Edges with one triangle."""
    edges = vtk.vtkFeatureEdges()
    edges.SetInputData(surface)
    edges.FeatureEdgesOff()
    edges.ManifoldEdgesOff()
    edges.NonManifoldEdgesOff()
    edges.BoundaryEdgesOn()
    edges.Update()
    return edges.GetOutput().GetNumberOfCells()


def crowded_edge_count(surface):
    """Edges with more than two triangles."""
    edges = vtk.vtkFeatureEdges()
    edges.SetInputData(surface)
    edges.FeatureEdgesOff()
    edges.ManifoldEdgesOff()
    edges.NonManifoldEdgesOn()
    edges.BoundaryEdgesOff()
    edges.Update()
    return edges.GetOutput().GetNumberOfCells()


def distinct_point_count(surface):
    """Points that differ in a bit of a coordinate."""
    return len({surface.GetPoint(i) for i in range(surface.GetNumberOfPoints())})


def generate(isoscope, kind, path, dims, *flags):
    """Writes a made-up volume."""
    subprocess.run([isoscope, "generate", kind, "--dims", dims, "--output", path, *flags], check=True,
                   stdout=subprocess.DEVNULL)


# A solid that ends at the border of the volume, at a plane and in a box; the same at whole numbers, where
# samples are equal to the isovalue; labels.
CLOSED_SCENES = {
    "shells": ["--isovalue", "0.2", "--close", "--clip-plane", "1,2,0.5,60", "--clip-box", "3,44,2.5,40,0,39"],
    "whole numbers": ["--isovalue", "3", "--close", "--clip-plane", "1,0,0,10"],
    "labels": ["--label", "1", "--close"],
    "simplified": ["--isovalue", "3", "--close", "--simplify", "0.3"],
}


def check_measures(isoscope, folder, environment):
    """All complaints about closed surfaces and their measures."""
    complaints = []
    volumes = {name: os.path.join(folder, name + ".nrrd") for name in ("shells", "labels")}
    generate(isoscope, "shells", volumes["shells"], "48,44,40", "--type", "float32")
    generate(isoscope, "labels", volumes["labels"], "40,40,40")
    for name, flags in CLOSED_SCENES.items():
        path = os.path.join(folder, "closed.vtp")
        volume = volumes["shells" if name == "shells" else "labels"]
        stats = json.loads(subprocess.run([isoscope, "export", volume, "--output", path, "--stats", "-", *flags],
                                          check=True, capture_output=True, env=environment).stdout)["surfaces"][0]
        surface = read(path)
        mass = vtk.vtkMassProperties()
        mass.SetInputData(surface)
        mass.Update()
        print(name, stats["area"], mass.GetSurfaceArea(), stats["volume"], mass.GetVolume())
        if open_edge_count(surface) or crowded_edge_count(surface) or not stats["is_closed"]:
            complaints.append(f"{name}: {open_edge_count(surface)} open edges, {crowded_edge_count(surface)} crowded")
            continue
        if abs(stats["area"] / mass.GetSurfaceArea() - 1) > 1e-5:
            complaints.append(f"{name}: area {stats['area']}, but VTK has {mass.GetSurfaceArea()}")
        if abs(stats["volume"] / mass.GetVolume() - 1) > 1e-4:
            complaints.append(f"{name}: volume {stats['volume']}, but VTK has {mass.GetVolume()}")
    return complaints


# Spacing and origin of volumes whose neighbouring vertices float32 can't tell apart.
FAR_PLACES = {"0.01": "500000,4600000,0", "0.000001": "1000,-1000,1000"}


def check_far(isoscope, folder, environment):
    """All complaints about surfaces far from the origin."""
    complaints = []
    volume = os.path.join(folder, "far.nrrd")
    path = os.path.join(folder, "far.vtp")

    def distinct(spacing, origin):
        generate(isoscope, "shells", volume, "32,30,28", "--type", "float32", "--spacing",
                 ",".join([spacing] * 3), "--origin", origin)
        subprocess.run([isoscope, "export", volume, "--isovalue", "0.5", "--output", path], check=True,
                       capture_output=True, env=environment)
        return distinct_point_count(read(path))

    expected = distinct("1", "0,0,0")
    for spacing, origin in FAR_PLACES.items():
        count = distinct(spacing, origin)
        print("far", spacing, origin, count, expected)
        if count != expected or count < 1000:
            complaints.append(f"at {origin} {count} points differ, but {expected} at the origin")
    return complaints


def check(isoscope, folder):
    """All complaints."""
    complaints = []
    volume = os.path.join(folder, "volume.nrrd")
    subprocess.run([isoscope, "generate", "shells", "--dims", "48,44,40", "--type", "float32", "--output", volume],
                   check=True, stdout=subprocess.DEVNULL)
    environment = dict(os.environ, XDG_CACHE_HOME=os.path.join(folder, "cache"))
    for name, flags in SCENES.items():
        complaints += check_scene(isoscope, volume, folder, environment, name, flags)
    complaints += check_measures(isoscope, folder, environment)
    complaints += check_far(isoscope, folder, environment)
    flow = os.path.join(folder, "flow.pvd")
    subprocess.run([isoscope, "generate", "flow", "--dims", "48,44,40", "--steps", "2", "--output", flow],
                   check=True, stdout=subprocess.DEVNULL)
    flags = ["--field", "velocity", "--component", "x", "--isovalue", "0.05", "--step", "1"]
    complaints += check_scene(isoscope, flow, folder, environment, "series", flags)
    facts = field_data(os.path.join(folder, "mesh.vtp"))
    expected = {"Field": "velocity", "FieldComponent": "x", "FieldUnit": "m/s", "TimeStep": 1.0, "TimeValue": 0.1,
                "TimeUnit": "s"}
    if facts != expected:
        complaints.append(f"series, vtp: field data {facts}, but {expected} was exported")
    return complaints


def field_data(path):
    """The field data of a .vtp, by name."""
    data = read(path).GetFieldData()
    arrays = [data.GetAbstractArray(i) for i in range(data.GetNumberOfArrays())]
    return {array.GetName(): array.GetValue(0) if isinstance(array, vtk.vtkStringArray) else array.GetTuple1(0)
            for array in arrays}


def check_scene(isoscope, volume, folder, environment, name, flags):
    """All complaints about the files of one export."""
    complaints = []
    expected = None
    for suffix in ("ply", "stl", "obj", "glb", "vtp"):
        path = os.path.join(folder, "mesh." + suffix)
        command = [isoscope, "export", volume, "--output", path]
        for flag in flags:
            # STL has no colours.
            command.append(flag if suffix != "stl" else flag.split(":")[0])
        if suffix != "stl" and "--isovalue" in flags:
            command += ["--color", "1,0.5,0"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
        surface = read(path)
        facts = (surface.GetNumberOfPoints(), surface.GetNumberOfPolys(),
                 tuple(round(x, 4) for x in surface.GetBounds()), open_edge_count(surface))
        print(name, suffix, *facts)
        expected = expected or facts
        if facts != expected:
            complaints.append(f"{name}, {suffix}: {facts}, but ply: {expected}")
        if suffix in ("ply", "obj", "glb", "vtp") and surface.GetPointData().GetNormals() is None:
            complaints.append(f"{name}, {suffix}: no normals")
        if suffix in ("ply", "vtp"):
            colors = surface.GetPointData().GetScalars()
            if colors is None or colors.GetTuple3(0) != (255, 128, 0):
                complaints.append(f"{name}, {suffix}: colours {colors and colors.GetTuple3(0)}")
            last = (0, 0, 255) if "--surface" in flags else (255, 128, 0)
            if colors is not None and colors.GetTuple3(surface.GetNumberOfPoints() - 1) != last:
                complaints.append(f"{name}, {suffix}: the last surface's colour is not {last}")
    if expected[1] < 1000:
        complaints.append(f"{name}: only {expected[1]} triangles: the test tests nothing")
    if "--clip-plane" in flags and expected[3] == 0:
        complaints.append(f"{name}: no open edges: nothing was cut")
    return complaints


def main():
    with tempfile.TemporaryDirectory() as folder:
        complaints = check(sys.argv[1], folder)
    for complaint in complaints:
        print(complaint)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
