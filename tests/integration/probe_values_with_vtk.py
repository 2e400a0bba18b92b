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
import skips  # noqa: E402

DEBIAN_PYTHON = "/usr/bin/python3"

try:
    import vtk
    from vtk.util import numpy_support
    import numpy as np
except ImportError:
    # Debian's VTK belongs to Debian's Python.
    if os.path.exists(DEBIAN_PYTHON) and os.environ.get("ISOSCOPE_DEBIAN_PYTHON") is None:
        os.environ["ISOSCOPE_DEBIAN_PYTHON"] = "1"
        os.execv(DEBIAN_PYTHON, [DEBIAN_PYTHON] + sys.argv)
    skips.skip_program("vtk", "no VTK (Debian: python3-vtk9)")

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
