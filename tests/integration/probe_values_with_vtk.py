#!/usr/bin/env python3
"""Compares the values of a second field at a surface's vertices with those of VTK's vtkProbeFilter.

    probe_values_with_vtk.py ISOSCOPE_VERTEX_VALUES

Prints the largest difference. Exit code 77 (CTest: skipped) where there is no VTK: apt-get install
python3-vtk9.
"""

import os
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
from debian_vtk import vtk  # noqa: E402
import numpy as np  # noqa: E402
from vtk.util import numpy_support  # noqa: E402

# A share of the field's range. A vertex's coordinate is a float of at most 48, so it is off by up to 2^-19
# of a cell; within a cell the field changes by less than half of its range.
TOLERANCE = 1e-6


def probed(grid, field, points):
    """The values of vtkProbeFilter at the points."""
    dims, spacing, origin = [int(n) for n in grid[:3]], grid[3:6], grid[6:]
    image = vtk.vtkImageData()
    image.SetDimensions(*dims)
    image.SetSpacing(*spacing)
    image.SetOrigin(*origin)
    scalars = numpy_support.numpy_to_vtk(field)
    scalars.SetName("field")
    image.GetPointData().SetScalars(scalars)
    vertices = vtk.vtkPoints()
    vertices.SetData(numpy_support.numpy_to_vtk(points))
    surface = vtk.vtkPolyData()
    surface.SetPoints(vertices)
    probe = vtk.vtkProbeFilter()
    probe.SetInputData(surface)
    probe.SetSourceData(image)
    probe.Update()
    found = probe.GetOutput().GetPointData()
    assert numpy_support.vtk_to_numpy(found.GetArray(probe.GetValidPointMaskArrayName())).all()
    return numpy_support.vtk_to_numpy(found.GetArray("field"))


def main(program):
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([program, folder], check=True, timeout=60)

        def read(name):
            return np.fromfile(os.path.join(folder, name), dtype="<f8")

        with open(os.path.join(folder, "grid.txt"), encoding="ascii") as file:
            grid = [float(word) for word in file.read().split()]
        field, points, values = read("field.raw"), read("points.raw").reshape(-1, 3), read("values.raw")
    assert len(values) == len(points) > 10_000, len(values)
    largest = np.abs(probed(grid, field, points) - values).max()
    extent = field.max() - field.min()
    print(f"{len(values)} vertices: largest difference {largest:.3g}, {largest / extent:.3g} of the range")
    assert values.max() - values.min() > extent / 2, "the surface shows little of the field"
    assert largest <= TOLERANCE * extent, largest


if __name__ == "__main__":
    main(*sys.argv[1:])
