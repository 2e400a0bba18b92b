"""What comes back as arrays of xarray, with coordinates. xarray is imported when it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from isoscope.errors import MissingPackageError

_PIXELS = ("row", "column")
_LAST_AXES = {
    "normal": ("axis", ["x", "y", "z"]),
    "position": ("axis", ["x", "y", "z"]),
    "depth_bounds": ("bound", ["nearest", "farthest"]),
}
_LONG_NAMES = {
    "depth": "distance from the eye along the view axis",
    "depth_bounds": "nearest and farthest depth of the exact picture",
    "surface_index": "index of the surface; 255: background",
    "normal": "world normal towards smaller values",
    "position": "world position, float32",
}


def planes(
    arrays: Mapping[str, npt.NDArray[Any]], points: npt.NDArray[np.float64], first: tuple[int, int], attributes: Any
) -> Any:
    """Returns an xarray.Dataset of the planes of a frame.

    Args:
        arrays: planes by name, shape (height, width) or (height, width, n).
        points: world position of each pixel, shape (height, width, 3).
        first: row and column of the first pixel in the viewport.
        attributes: of the Dataset.

    Raises:
        MissingPackageError: xarray is not installed.
    """
    xarray = _import()
    coordinates: dict[str, Any] = {
        name: (name, np.arange(size) + begin, {"long_name": f"{name} of the pixel"})
        for name, size, begin in zip(_PIXELS, points.shape, first)
    }
    for axis, name in enumerate("xyz"):
        coordinates[name] = (_PIXELS, points[:, :, axis], {"long_name": f"world {name}", "axis": name.upper()})
    variables = {}
    for name, plane in arrays.items():
        dims: tuple[str, ...] = _PIXELS
        if name in _LAST_AXES:
            axis_name, labels = _LAST_AXES[name]
            dims = (*_PIXELS, axis_name)
            coordinates[axis_name] = labels
        variables[name] = (dims, plane, {"long_name": _LONG_NAMES.get(name, name)})
    return xarray.Dataset(variables, coords=coordinates, attrs=attributes)


def histogram(
    centers: npt.NDArray[np.float64], counts: Mapping[str, npt.NDArray[Any]], attributes: Mapping[str, Any]
) -> Any:
    """Returns an xarray.Dataset of counts by value.

    Raises:
        MissingPackageError: xarray is not installed.
    """
    xarray = _import()
    coordinates = {"value": ("value", centers, {"long_name": "middle of the bin"})}
    return xarray.Dataset(
        {name: ("value", array) for name, array in counts.items()}, coords=coordinates, attrs=dict(attributes)
    )


def _import() -> Any:
    try:
        return importlib.import_module("xarray")
    except ImportError as error:
        raise MissingPackageError("to_xarray needs xarray: python3 -m pip install xarray") from error
