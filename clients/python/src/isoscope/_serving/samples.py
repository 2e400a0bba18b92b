"""Samples of arrays on their way to a file, in parts: an array that comes in chunks need not fit in memory.

1. `as_array` gives an array of dask as it is, all else by numpy. Those of xarray are a `LazyArray`.
2. `write_samples` reserves the bytes in the file, so that a full disk is known before the first chunk is computed.
3. Arrays of numpy are written in order, 64 MiB at a time.
4. Of others batches of whole chunks are computed, each chunk once. Each lands at its place in the file.

A chunk's rows are short runs in the file. Planes of a chunk are mapped one at a time, so that numpy copies the rows.
Only reserved bytes are mapped: a map of others would end the process when the disk is full.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import math
import mmap
import os
import sys
from collections.abc import Iterator, Sequence
from typing import IO, Any, Protocol

import numpy as np
import numpy.typing as npt

from isoscope._serving.progress import Progress
from isoscope.errors import InvalidArgumentError, ResourceExhaustedError

# The most bytes of a part of an array in memory.
_PART_BYTES = 64 << 20
# The most bytes of the chunks that are computed together, unless one chunk has more.
_BATCH_BYTES = 256 << 20
# Runs of at least so many bytes are written one by one; shorter ones through a map.
_RUN_BYTES = 16 << 10
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

Index = tuple[slice, ...]
Chunks = Sequence[Sequence[int]]


class LazyArray(Protocol):
    """An array whose samples come in chunks, when they are asked for."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    @property
    def dtype(self) -> np.dtype[Any]: ...

    @property
    def chunks(self) -> Chunks:
        """Sizes of the chunks along each axis, as dask has them."""

    def compute(self, indices: Sequence[Index]) -> Sequence[npt.NDArray[Any]]:
        """Returns the samples of these parts, which are in memory together."""


#: An array of numpy or dask, or a LazyArray: all have shape and dtype.
AnyArray = Any


def is_dask(value: object) -> bool:
    """Returns whether this is an array of dask's, which is computed in chunks when it is written."""
    dask_array: Any = sys.modules.get("dask.array")  # nobody has such an array before it is imported
    return dask_array is not None and isinstance(value, dask_array.Array)


class DaskArray:
    """An array of dask's: `LazyArray`."""

    def __init__(self, array: Any) -> None:
        self.shape: tuple[int, ...] = tuple(map(int, array.shape))
        self.dtype: np.dtype[Any] = array.dtype
        self.chunks: Chunks = array.chunks
        self._array = array

    def compute(self, indices: Sequence[Index]) -> Sequence[npt.NDArray[Any]]:
        dask: Any = sys.modules["dask"]
        parts: Sequence[npt.NDArray[Any]] = dask.compute(*(self._array[index] for index in indices))
        return parts


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
    return _in_memory(value, name)


def _in_memory(value: Any, name: str) -> npt.NDArray[Any]:
    if isinstance(value, np.ma.MaskedArray):
        count = int(np.count_nonzero(value.mask))
        if count:
            raise InvalidArgumentError(
                f"{name} has {count} masked samples: say what they are, as NaN for holes, "
                "array.astype(float).filled(numpy.nan)"
            )
        return np.asarray(value.data)
    return np.asarray(value)


def write_samples(file: IO[bytes], samples: AnyArray, dtype: np.dtype[Any], progress: Progress | None = None) -> None:
    """Appends samples, the last axis fastest, as `dtype`, which has the order of the bytes.

    Args:
        file: open for writing and reading, in binary mode.
        samples: an array of numpy or dask, or a LazyArray.
        progress: is told of the bytes.

    Raises:
        InvalidArgumentError: masked samples of dask; a chunk of another type or shape than the array says: both are
            known only now.
        ResourceExhaustedError: the disk is full.
    """
    if is_dask(samples):
        samples = DaskArray(samples)
    progress = Progress() if progress is None else progress
    file.flush()
    begin = file.tell()
    shape = tuple(map(int, samples.shape))
    size = math.prod(shape) * dtype.itemsize
    # A file system may take all that is left before it finds that this is not enough, and others fail meanwhile.
    check_room(os.path.dirname(str(file.name)), size)
    try:
        can_map = _reserve(file, begin, size)
        if isinstance(samples, np.ndarray):
            for index in parts(shape, dtype.itemsize):
                part = np.ascontiguousarray(_in_memory(samples[index], "the array"), dtype)
                part.tofile(file)
                progress.add(part.nbytes)
        else:
            for batch in _batches(samples.chunks, max(dtype.itemsize, samples.dtype.itemsize)):
                for index, part in zip(batch, samples.compute(batch)):
                    part = np.ascontiguousarray(_checked(part, samples.dtype, index), dtype)
                    _place(file.fileno(), begin, shape, index, part, can_map)
                    progress.add(part.nbytes)
                    del part
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        raise _no_room(os.path.dirname(str(file.name)), size, error.strerror) from error
    file.seek(begin + size)


def check_room(folder: str | os.PathLike[str], size: int) -> None:
    """Refuses what is larger than the free room of the disk, without the blocks that are kept for root.

    Raises:
        ResourceExhaustedError: there is less room.
    """
    if not hasattr(os, "statvfs"):
        return
    disk = os.statvfs(folder)
    free = disk.f_bavail * disk.f_frsize
    if disk.f_blocks and size > free:  # some file systems do not count
        raise _no_room(folder, size, f"{free} bytes are free")


def _no_room(folder: str | os.PathLike[str], size: int, why: str | None) -> ResourceExhaustedError:
    return ResourceExhaustedError(
        f"{size} bytes of samples do not fit into {os.fspath(folder)}: {why}; make room, or name another folder by the "
        "variable TMPDIR"
    )


def _reserve(file: IO[bytes], begin: int, size: int) -> bool:
    """Takes the bytes of the file from the disk. Returns whether they can be mapped."""
    if not size or not hasattr(os, "posix_fallocate"):
        return False
    try:
        os.posix_fallocate(file.fileno(), begin, size)
    except OSError as error:
        if error.errno in _NO_ROOM:
            raise
        return False  # a file system without it
    return file.readable()


def _checked(part: Any, dtype: np.dtype[Any], index: Index) -> npt.NDArray[Any]:
    """Returns a chunk as numpy has it, if it is one that the array promised."""
    found = _in_memory(part, "the array")
    where = f"the samples [{', '.join(f'{one.start}:{one.stop}' for one in index)}]"
    expected = tuple(one.stop - one.start for one in index)
    if found.shape != expected:
        raise InvalidArgumentError(f"{where} have the shape {found.shape}, and the array promises {expected}")
    if found.dtype.name != dtype.name:
        raise InvalidArgumentError(
            f"{where} are of {found.dtype.name}, and the array says that it is of {dtype.name}: give the function that "
            "computes them its dtype, as in map_blocks(..., dtype=...)"
        )
    return found


def _place(
    descriptor: int, begin: int, shape: tuple[int, ...], index: Index, part: npt.NDArray[Any], can_map: bool
) -> None:
    """Writes a part of an array, which is contiguous, to its place in the file of the whole."""
    if not part.size:
        return
    strides = _strides(shape, part.itemsize)
    starts = [one.start for one in index]
    # The axes behind `axis` are whole, so a run is along `axis`.
    axis = part.ndim - 1
    while axis > 0 and part.shape[axis] == shape[axis]:
        axis -= 1
    run_bytes = part.shape[axis] * strides[axis]
    if axis and can_map and run_bytes < _RUN_BYTES:
        # A file system may know no maps.
        with contextlib.suppress(OSError):
            _map_planes(descriptor, begin, strides, starts, part)
            return
    data = part.reshape(-1).view(np.uint8).data
    for number, place in enumerate(np.ndindex(*part.shape[:axis])):
        row = sum((s + p) * stride for s, p, stride in zip(starts, place, strides))
        at = begin + row + starts[axis] * strides[axis]
        _write_all(descriptor, data[number * run_bytes : (number + 1) * run_bytes], at)


def _map_planes(
    descriptor: int, begin: int, strides: Sequence[int], starts: Sequence[int], part: npt.NDArray[Any]
) -> None:
    rows, columns = part.shape[-2:]
    for place in np.ndindex(*part.shape[:-2]):
        first = begin + sum((s + p) * stride for s, p, stride in zip(starts, (*place, 0, 0), strides))
        aligned = first // mmap.ALLOCATIONGRANULARITY * mmap.ALLOCATIONGRANULARITY
        end = first + (rows - 1) * strides[-2] + columns * strides[-1]
        with mmap.mmap(descriptor, end - aligned, offset=aligned) as mapped:
            plane: npt.NDArray[Any] = np.ndarray(
                (rows, columns), part.dtype, buffer=mapped, offset=first - aligned, strides=tuple(strides[-2:])
            )
            plane[...] = part[place]
            del plane  # a map with a view of it can't be closed


def _write_all(descriptor: int, data: memoryview, at: int) -> None:
    while data:
        written = os.pwrite(descriptor, data, at)
        data, at = data[written:], at + written


def _strides(shape: Sequence[int], item_bytes: int) -> tuple[int, ...]:
    return tuple(item_bytes * math.prod(shape[axis + 1 :]) for axis in range(len(shape)))


def parts(shape: Sequence[int], item_bytes: int) -> Iterator[Index]:
    """Yields indices of parts that follow each other in the order of the file."""
    row_bytes = max(1, item_bytes * math.prod(shape[1:]))
    if row_bytes > _PART_BYTES and len(shape) > 1:
        for row in range(shape[0]):
            for rest in parts(shape[1:], item_bytes):
                yield slice(row, row + 1), *rest
        return
    most = max(1, _PART_BYTES // row_bytes)
    for begin in range(0, shape[0], most):
        yield (slice(begin, min(begin + most, shape[0])),)


def _batches(chunks: Chunks, item_bytes: int) -> Iterator[list[Index]]:
    """Yields the indices of all chunks, in the order of the file, some of them together."""
    batch: list[Index] = []
    batch_bytes = 0
    for index in itertools.product(*(_slices(sizes) for sizes in chunks)):
        size = item_bytes * math.prod(one.stop - one.start for one in index)
        if batch and batch_bytes + size > _BATCH_BYTES:
            yield batch
            batch, batch_bytes = [], 0
        batch.append(index)
        batch_bytes += size
    if batch:
        yield batch


def _slices(sizes: Sequence[int]) -> list[slice]:
    ends = list(itertools.accumulate(map(int, sizes)))
    return [slice(end - int(size), end) for end, size in zip(ends, sizes)]


def whole_chunks(shape: Sequence[int], chunk: Sequence[int], item_bytes: int) -> Chunks:
    """Returns chunks of some chunks each, the last axis first, so that a part has up to 64 MiB.

    Args:
        shape: of the array.
        chunk: shape of a chunk of the file or store: a part never has less than a whole one.
    """
    sizes = [max(1, min(int(one), int(side))) for one, side in zip(chunk, shape)]
    for axis in reversed(range(len(shape))):
        factor = max(1, _PART_BYTES // max(1, item_bytes * math.prod(sizes)))
        if sizes[axis] * factor < shape[axis]:
            sizes[axis] *= factor
            break
        sizes[axis] = max(1, int(shape[axis]))
    return [
        [min(size, int(side) - begin) for begin in range(0, int(side), size)] for side, size in zip(shape, sizes)
    ]
