"""Reads and writes the PNGs of this service with numpy and zlib alone: 8 bits a channel, RGB or RGBA.

Isoscope filters rows with "up" (PNG filter type 2), whose inverse adds whole rows. The other filters
are read too, some of them pixel by pixel.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

from isoscope.errors import DataLossError

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {2: 3, 6: 4}


def decode(png: bytes) -> npt.NDArray[np.uint8]:
    """Returns the pixels of a PNG: uint8 of shape (height, width, 3 or 4), row 0 at the top."""
    width, height, channels, packed = _read_chunks(png)
    row_bytes = width * channels
    try:
        raw = zlib.decompress(packed)
    except zlib.error as error:
        raise DataLossError(f"damaged PNG: its pixels do not decompress ({error})") from error
    if len(raw) != height * (row_bytes + 1):
        raise DataLossError(f"damaged PNG: {len(raw)} bytes of rows, expected {height * (row_bytes + 1)}")
    stored = np.frombuffer(raw, np.uint8).reshape(height, row_bytes + 1)
    filters, rows = stored[:, 0], stored[:, 1:]
    out = np.empty((height, row_bytes), np.uint8)
    y = 0
    while y < height:
        end = y + 1
        while end < height and filters[end] == filters[y]:
            end += 1
        above = out[y - 1] if y > 0 else np.zeros(row_bytes, np.uint8)
        _unfilter(int(filters[y]), rows[y:end], above, out[y:end], channels)
        y = end
    return out.reshape(height, width, channels)


def _read_chunks(png: bytes) -> tuple[int, int, int, bytes]:
    """Returns width, height, channels and the compressed rows."""
    if png[:8] != _SIGNATURE:
        raise DataLossError("no PNG: it does not begin with the signature of one")
    header = b""
    packed: list[bytes] = []
    at = 8
    while at + 12 <= len(png):
        (size,) = struct.unpack_from(">I", png, at)
        kind, body = png[at + 4 : at + 8], png[at + 8 : at + 8 + size]
        if kind == b"IHDR":
            header = body
        elif kind == b"IDAT":
            packed.append(body)
        elif kind == b"IEND":
            break
        at += 12 + size
    else:
        raise DataLossError("damaged PNG: it has no end")
    if len(header) != 13:
        raise DataLossError("damaged PNG: it has no header")
    width, height, depth, color, _, _, interlace = struct.unpack(">IIBBBBB", header)
    if depth != 8 or color not in _CHANNELS or interlace != 0:
        raise DataLossError("a PNG with other pixels than 8-bit RGB or RGBA without interlace")
    return width, height, _CHANNELS[color], b"".join(packed)


def _unfilter(
    kind: int,
    rows: npt.NDArray[np.uint8],
    above: npt.NDArray[np.uint8],
    out: npt.NDArray[np.uint8],
    channels: int,
) -> None:
    """Undoes filter `kind` of neighbouring rows; `above` is the pixel row before the first one."""
    if kind == 0:
        out[:] = rows
    elif kind == 1:
        pixels = rows.reshape(len(rows), -1, channels)
        out[:] = np.cumsum(pixels, axis=1, dtype=np.uint8).reshape(rows.shape)
    elif kind == 2:
        # Row by row: this adds whole rows of bytes at once, but a sum down the columns adds single bytes.
        for row, to in zip(rows, out):
            np.add(row, above, out=to)
            above = to
    elif kind in (3, 4):
        for row, to in zip(rows, out):
            _unfilter_row(kind, row, above, to, channels)
            above = to
    else:
        raise DataLossError(f"damaged PNG: filter type {kind}")


def _unfilter_row(
    kind: int,
    row: npt.NDArray[np.uint8],
    above: npt.NDArray[np.uint8],
    to: npt.NDArray[np.uint8],
    channels: int,
) -> None:
    """Undoes "average" (3) or "Paeth" (4), pixel after pixel."""
    left = np.zeros(channels, np.int32)
    corner = np.zeros(channels, np.int32)
    for x in range(0, len(row), channels):
        up = above[x : x + channels].astype(np.int32)
        if kind == 3:
            guess = (left + up) // 2
        else:
            estimate = left + up - corner
            by_left, by_up, by_corner = (abs(estimate - side) for side in (left, up, corner))
            guess = np.where(
                (by_left <= by_up) & (by_left <= by_corner), left, np.where(by_up <= by_corner, up, corner)
            )
        left = (row[x : x + channels] + guess) & 255
        to[x : x + channels] = left
        corner = up


def encode(pixels: npt.NDArray[np.uint8]) -> bytes:
    """Returns pixels of shape (height, width, 3 or 4) as a PNG."""
    height, width, channels = pixels.shape
    rows = np.ascontiguousarray(pixels).reshape(height, width * channels)
    stored = np.empty((height, 1 + width * channels), np.uint8)
    stored[:, 0] = 2
    stored[0, 1:] = rows[0]
    stored[1:, 1:] = rows[1:] - rows[:-1]
    header = struct.pack(">IIBBBBB", width, height, 8, 2 if channels == 3 else 6, 0, 0, 0)
    packed = zlib.compress(stored.tobytes(), 1)
    return _SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", packed) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
