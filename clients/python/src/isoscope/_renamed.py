"""Old names of fields, which are readable for one version: the names are those of the protos and of `--json` now."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any


def renamed(old: str, new: str, convert: Callable[[Any], Any] | None = None) -> Any:
    """Returns a property that warns and gives the field `new`, or what `convert` makes of it."""

    def read(self: Any) -> Any:
        warnings.warn(
            f"{type(self).__name__}.{old} is called {new} now, and goes with the next version",
            DeprecationWarning,
            stacklevel=2,
        )
        value = getattr(self, new)
        return value if convert is None else convert(value)

    return property(read, doc=f"The old name of `{new}`.")
