"""Isoscope: isosurfaces of volumes too large for one machine, as exact pictures and meshes.

    import isoscope

    with isoscope.connect("host:50051") as client:
        head = client["head"]
        frame = head.render(isovalue=60, view="anterior", size=(800, 600))
        frame.save("head.png")
        frame.depth                     # float32, shape (600, 800)
        points, triangles = head.mesh(60)

`isoscope.serve("head.nii.gz")` starts the programs of this machine; `isoscope.aio` has the same for
asyncio. World coordinates are those of the volume; colours are sRGB; row 0 of a picture is the top.
"""

from isoscope import _environment  # before gRPC is imported
from isoscope import data, errors, labels, look
from isoscope import aio
from isoscope._channel import DEFAULT_PORT, DEFAULT_TIMEOUT
from isoscope._version import __version__
from isoscope.camera import VIEWS, Camera
from isoscope.client import Client, Dataset, connect
from isoscope.data import *
from isoscope.errors import *
from isoscope.frame import Frame
from isoscope.labels import *
from isoscope.local import serve
from isoscope.look import *
from isoscope.viewer import View
from isoscope import _accessor

__all__ = [
    "DEFAULT_PORT", "DEFAULT_TIMEOUT", "VIEWS", "Camera", "Client", "Dataset", "Frame", "View", "__version__", "aio",
    "connect", "errors", "labels", "serve",
]  # fmt: skip
__all__ += data.__all__
__all__ += errors.__all__
__all__ += labels.__all__
__all__ += look.__all__

_accessor.install()  # array.isoscope of xarray, once that is imported
