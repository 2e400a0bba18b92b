"""VTK, for programs that read with it what isoscope writes: `from debian_vtk import vtk`.

Debian's VTK belongs to Debian's Python. Under another one the program begins again there. Where there is no VTK it
ends as skipped.
"""

import os
import sys

import skips

DEBIAN_PYTHON = "/usr/bin/python3"

try:
    import vtk  # noqa: F401
    import vtk.util.numpy_support  # noqa: F401
except ImportError:
    if os.path.exists(DEBIAN_PYTHON) and os.environ.get("ISOSCOPE_DEBIAN_PYTHON") is None:
        os.environ["ISOSCOPE_DEBIAN_PYTHON"] = "1"
        os.execv(DEBIAN_PYTHON, [DEBIAN_PYTHON] + sys.argv)
    skips.skip_program("vtk", "no VTK (Debian: python3-vtk9)")
