"""The progress of samples that `serve` writes or fetches: a line on the terminal or in the notebook, or a call."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Union

#: None: a line where somebody sees it; False: none; True: a line anyhow; else a call with bytes done and bytes in all.
Wanted = Union[bool, Callable[[int, int], None], None]

_QUIET_SECONDS = 1.0  # shorter work shows no line
_BETWEEN_SECONDS = 0.2
_WIDTH = 20


class Progress:
    """Tells how many of all bytes are done.

    Args:
        wanted: see `Wanted`.
        what: words of the line, such as "writing the array".
        total: bytes in all; 0: not known.
    """

    def __init__(self, wanted: Wanted = False, what: str = "", total: int = 0) -> None:
        self._what = what
        self.total = total
        self._done = 0
        self._call = wanted if callable(wanted) else None
        self._is_shown = self._call is None and (_is_seen() if wanted is None else bool(wanted))
        self._begin = self._last = time.monotonic()
        self._length = 0

    def add(self, count: int) -> None:
        """So many bytes more are done."""
        self._done += count
        if self._call is not None:
            self._call(self._done, self.total)
        now = time.monotonic()
        if self._is_shown and now - self._begin >= _QUIET_SECONDS and now - self._last >= _BETWEEN_SECONDS:
            self._last = now
            self._show(self._text(now - self._begin))

    def close(self) -> None:
        """Takes the line away."""
        if self._length:
            self._show("")
            sys.stderr.write("\r")
            sys.stderr.flush()
            self._length = 0

    def _text(self, seconds: float) -> str:
        if not self.total:
            return f"isoscope: {self._what}: {_size(self._done)}"
        share = min(1.0, self._done / self.total)
        bar = "#" * int(share * _WIDTH)
        left = seconds / share - seconds if share else 0
        return (
            f"isoscope: {self._what} [{bar:<{_WIDTH}}] {share:4.0%} of {_size(self.total)}, "
            f"about {int(left) // 60}:{int(left) % 60:02d} min left"
        )

    def _show(self, text: str) -> None:
        sys.stderr.write("\r" + text.ljust(self._length))
        sys.stderr.flush()
        self._length = len(text)


def _is_seen() -> bool:
    """Returns whether somebody sees a line that is written again and again: a terminal, or a notebook's cell."""
    stream = sys.stderr
    if stream is None:
        return False
    return stream.isatty() or type(stream).__module__.startswith("ipykernel")


def _size(count: int) -> str:
    value = float(count)
    for unit in ("B", "KiB", "MiB", "GiB"):
        if value < 1024:
            return f"{value:.0f} {unit}" if unit == "B" else f"{value:.1f} {unit}"
        value /= 1024
    return f"{value:.1f} TiB"
