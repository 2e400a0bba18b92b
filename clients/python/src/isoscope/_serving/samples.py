"""Samples of arrays on their way to a file, in parts: an array of dask's need not fit in memory."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from isoscope.errors import InvalidArgumentError

#: An array of numpy or dask: both have shape, dtype, ndim, nbytes and slices.
AnyArray = Any

# The most bytes of a part, unless a chunk of the array has more.
_PART_BYTES = 64 << 20


def is_dask(value: object) -> bool:
    """Returns whether this is an array of dask's, which is computed in chunks when it is written."""
    dask_array: Any = sys.modules.get("dask.array")  # nobody has such an array before it is imported
    return dask_array is not None and isinstance(value, dask_array.Array)


def as_array(value: Any, name: str) -> AnyArray:
    """Returns an array of dask's as it is, all else by numpy.

    Raises:
        InvalidArgumentError: an array of dask's of unknown shape; masked samples.
    """
    if is_dask(value):
        if any(not isinstance(side, (int, np.integer)) for side in value.shape):
            raise InvalidArgumentError(
                f"{name} has the shape {value.shape}, of which dask does not know all: call compute_chunk_sizes() first"
            )
        return value
    if isinstance(value, np.ma.MaskedArray):
        count = int(np.count_nonzero(value.mask))
        if count:
            raise InvalidArgumentError(
                f"{name} has {count} masked samples: say what they are, as NaN for holes, "
                "array.astype(float).filled(numpy.nan)"
            )
        return np.asarray(value.data)
    return np.asarray(value)


def write_samples(file: IO[bytes], samples: AnyArray, dtype: np.dtype[Any]) -> None:
    """Appends samples, the last axis fastest, as `dtype`, which has the order of the bytes.

    Raises:
        InvalidArgumentError: masked samples of dask, which are known only now.
    """
    file.flush()  # tofile writes past the file's buffer
    chunks = getattr(samples, "chunks", None)
    for index in _parts(samples.shape, samples.dtype.itemsize, chunks):
        part = samples[index]
        part = as_array(part.compute() if is_dask(part) else part, "the array")
        np.ascontiguousarray(part, dtype).tofile(file)


def _parts(
    shape: Sequence[int], item_bytes: int, chunks: Sequence[Sequence[int]] | None
) -> Iterator[tuple[slice, ...]]:
    """Yields indices of parts that follow each other in the order of the file.

    A chunk is computed once: it is in one part, unless it has one element along the first axis, and so lies in order.
    """
    row_bytes = max(1, item_bytes * math.prod(shape[1:]))
    begin = 0
    for count in chunks[0] if chunks else _even(shape[0], max(1, _PART_BYTES // row_bytes)):
        here = slice(begin, begin + count)
        if count == 1 and row_bytes > _PART_BYTES and len(shape) > 1:
            for rest in _parts(shape[1:], item_bytes, chunks[1:] if chunks else None):
                yield here, *rest
        else:
            yield (here,)
        begin += count


def _even(size: int, most: int) -> Iterator[int]:
    for begin in range(0, size, most):
        yield min(most, size - begin)
