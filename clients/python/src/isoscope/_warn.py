"""Warnings that name the line of the caller's code, not of this package's."""

from __future__ import annotations

import sys
import warnings

from isoscope.errors import SurfaceWarning


def warn_of_surface(message: str) -> None:
    """Issues a SurfaceWarning at the innermost frame outside of this package, also of a coroutine that awaits."""
    level = 1
    frame = sys._getframe()
    while frame.f_back is not None and _is_ours(frame.f_globals.get("__name__", "")):
        frame = frame.f_back
        level += 1
    warnings.warn(message, SurfaceWarning, stacklevel=level)


def _is_ours(module: str) -> bool:
    return module == "isoscope" or module.startswith("isoscope.")
