"""Warnings that name the line of the caller's code, not of this package's."""

from __future__ import annotations

import sys
import warnings

from isoscope.errors import SurfaceWarning

# This package, and those through which a notebook shows a value.
_BETWEEN = {"isoscope", "IPython", "ipywidgets", "anywidget", "traitlets", "decorator"}


def warn_of_surface(message: str) -> None:
    """Issues a SurfaceWarning at the innermost frame of the caller's own code, also of a coroutine that awaits.

    A notebook that shows a value calls this package through IPython: the frame is that of the cell.
    """
    level = outside = 1
    frame = sys._getframe()
    while frame.f_back is not None and _is_between(frame.f_globals.get("__name__", "")):
        if _is_ours(frame.f_globals.get("__name__", "")):
            outside = level + 1
        frame = frame.f_back
        level += 1
    if _is_between(frame.f_globals.get("__name__", "")):  # no code of the caller's: what called this package
        level = outside
    warnings.warn(message, SurfaceWarning, stacklevel=level)


def _is_ours(module: str) -> bool:
    return module.split(".")[0] == "isoscope"


def _is_between(module: str) -> bool:
    return module.split(".")[0] in _BETWEEN
