#!/usr/bin/env python3
"""Generates a flow and reads it with VTK, which others have written.

    read_flow_with_vtk.py ISOSCOPE

Grid, times, names, units, components and values must be those of `isoscope generate --help`. Exit
code 77 (CTest: skipped) where there is no VTK: apt-get install python3-vtk9.
"""

import os
import subprocess
import sys
import tempfile
import xml.etree.ElementTree

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
from debian_vtk import vtk  # noqa: E402
from flow_formulas import fluid  # noqa: E402

DIMS = (24, 17, 13)
TIME_STEP = 0.7
STEPS = 4


def unit(array):
    return array.GetInformation().Get(vtk.vtkDataArray.UNITS_LABEL())


def check(truth, text):
    if not truth:
        sys.exit(f"read_flow_with_vtk: {text}")


def check_step(path, time):
    reader = vtk.vtkXMLImageDataReader()
    reader.SetFileName(path)
    check(reader.CanReadFile(path), f"VTK does not read {path}")
    reader.Update()
    check(reader.GetErrorCode() == 0, f"VTK fails on {path}")
    image = reader.GetOutput()
    check(image.GetDimensions() == DIMS, f"dimensions {image.GetDimensions()}")
    center = image.GetCenter()
    check(max(abs(c) for c in center) < 1e-15, f"the middle is at {center}")
    length = max(image.GetBounds()[2 * i + 1] - image.GetBounds()[2 * i] for i in range(3))
    check(abs(length - 1) < 1e-15, f"the longest axis spans {length}")

    times = image.GetFieldData().GetArray("TimeValue")
    check(times.GetValue(0) == time and unit(times) == "s", f"time {times}")
    points = image.GetPointData()
    check([points.GetArrayName(i) for i in range(points.GetNumberOfArrays())] ==
          ["pressure", "temperature", "velocity"], "other arrays")
    check(points.GetScalars().GetName() == "pressure" and points.GetVectors().GetName() == "velocity",
          "other active arrays")
    pressure, temperature, velocity = (points.GetArray(i) for i in range(3))
    check([unit(a) for a in (pressure, temperature, velocity)] == ["Pa", "K", "m/s"], "other units")
    check([velocity.GetComponentName(i) for i in range(3)] == ["x", "y", "z"], "other components")
    check(all(a.GetDataType() == vtk.VTK_FLOAT for a in (pressure, temperature, velocity)), "other types")
    for i in range(image.GetNumberOfPoints()):
        p, t, v = fluid(image.GetPoint(i), time)
        check(abs(pressure.GetValue(i) - p) <= 1e-12 + 6e-8 * abs(p), f"pressure of point {i}")
        check(abs(temperature.GetValue(i) - t) <= 1.6e-5, f"temperature of point {i}")
        check(max(abs(a - b) for a, b in zip(velocity.GetTuple3(i), v)) <= 8e-9, f"velocity of point {i}")


def main():
    isoscope = sys.argv[1]
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([isoscope, "generate", "flow", "--dims", ",".join(map(str, DIMS)), "--steps", str(STEPS),
                        "--time-step", str(TIME_STEP), "--output", os.path.join(folder, "flow.pvd"), "--quiet"],
                       check=True)
        collection = xml.etree.ElementTree.parse(os.path.join(folder, "flow.pvd")).getroot()
        check(collection.get("type") == "Collection", "no collection")
        check(collection.find("Collection").get("TimeUnit") == "s", "another unit of time")
        steps = collection.findall("Collection/DataSet")
        check(len(steps) == STEPS, f"{len(steps)} steps")
        for i, step in enumerate(steps):
            check(float(step.get("timestep")) == i * TIME_STEP, f"step {i} at {step.get('timestep')}")
            check_step(os.path.join(folder, step.get("file")), i * TIME_STEP)
    print(f"read_flow_with_vtk: {STEPS} steps, VTK {vtk.VTK_VERSION}")


if __name__ == "__main__":
    main()
