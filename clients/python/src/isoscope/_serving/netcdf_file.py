"""A netCDF file, which `isoscope partition` reads by the rules of CF: `xarray` says the rest.

The format is CDF-5, whose header tells all and whose samples follow each other, big-endian:

    "CDF" 5      0 records
    dimensions   tag 10, count; each a name and a length
    attributes   tag 12, count: none of the file
    variables    tag 11, count; each a name, dimensions, attributes, type, size, offset

Counts, sizes and offsets have 8 bytes, tags and types 4. Names and values are padded to 4 bytes. Source: "NetCDF File
Formats", https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html.
"""

from __future__ import annotations

import math
import pathlib
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Union

import numpy as np

from isoscope._serving.progress import Progress
from isoscope._serving.samples import AnyArray, check_room, write_samples

_DIMENSIONS, _VARIABLES, _ATTRIBUTES = 10, 11, 12
_TEXT = 2
#: Numbers of the types in a file.
TYPES = {
    "int8": 1, "int16": 3, "int32": 4, "float32": 5, "float64": 6, "uint8": 7, "uint16": 8, "uint32": 9, "int64": 10,
    "uint64": 11,
}  # fmt: skip
Attribute = Union[str, "np.ndarray[Any, Any]"]


@dataclass(frozen=True, eq=False)
class Variable:
    """An array with names of its dimensions, the slowest first. Its type in the file is `dtype`, else that of samples.

    Types in a file are those of TYPES.
    """

    name: str
    dimensions: tuple[str, ...]
    samples: AnyArray
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    dtype: np.dtype[Any] | None = None

    @property
    def stored_type(self) -> np.dtype[Any]:
        """Type of the samples in the file."""
        dtype: np.dtype[Any] = self.samples.dtype if self.dtype is None else self.dtype
        return dtype


def write(
    path: pathlib.Path,
    dimensions: Mapping[str, int],
    variables: Sequence[Variable],
    progress: Progress | None = None,
) -> None:
    """Writes the file. Each dimension of a variable is one of `dimensions`, of that length."""
    total = sum(map(_size_of, variables))
    check_room(path.parent, total)
    if progress is not None:
        progress.total = total
    # The offsets have the same size, whatever they are.
    begin = len(_header(dimensions, variables, [0] * len(variables)))
    begins = []
    for variable in variables:
        begins.append(begin)
        begin += _padded(_size_of(variable))
    with open(path, "w+b") as file:
        file.write(_header(dimensions, variables, begins))
        for variable in variables:
            write_samples(file, variable.samples, variable.stored_type.newbyteorder(">"), progress)
            file.write(b"\0" * (_padded(_size_of(variable)) - _size_of(variable)))


def _size_of(variable: Variable) -> int:
    return int(variable.stored_type.itemsize) * math.prod(map(int, variable.samples.shape))


def _padded(size: int) -> int:
    return (size + 3) // 4 * 4


def _header(dimensions: Mapping[str, int], variables: Sequence[Variable], begins: Sequence[int]) -> bytes:
    ids = {name: at for at, name in enumerate(dimensions)}
    parts = [b"CDF\5", _count(0), _list(_DIMENSIONS, [_name(name) + _count(size) for name, size in dimensions.items()])]
    parts.append(_list(_ATTRIBUTES, []))
    described = []
    for variable, begin in zip(variables, begins):
        places = b"".join(_count(ids[name]) for name in variable.dimensions)
        attributes = _list(_ATTRIBUTES, [_attribute(name, value) for name, value in variable.attributes.items()])
        type_of = struct.pack(">i", TYPES[variable.stored_type.name])
        described.append(
            _name(variable.name) + _count(len(variable.dimensions)) + places + attributes + type_of
            + _count(_padded(_size_of(variable))) + _count(begin)
        )  # fmt: skip
    parts.append(_list(_VARIABLES, described))
    return b"".join(parts)


def _count(number: int) -> bytes:
    return struct.pack(">q", number)


def _list(tag: int, elements: Sequence[bytes]) -> bytes:
    return struct.pack(">i", tag if elements else 0) + _count(len(elements)) + b"".join(elements)


def _text(data: bytes) -> bytes:
    return data + b"\0" * (_padded(len(data)) - len(data))


def _name(name: str) -> bytes:
    data = name.encode("utf-8")
    return _count(len(data)) + _text(data)


def _attribute(name: str, value: Attribute) -> bytes:
    if isinstance(value, str):
        data = value.encode("utf-8")
        return _name(name) + struct.pack(">i", _TEXT) + _count(len(data)) + _text(data)
    numbers = np.ravel(value)
    data = np.ascontiguousarray(numbers, numbers.dtype.newbyteorder(">")).tobytes()
    return _name(name) + struct.pack(">i", TYPES[numbers.dtype.name]) + _count(len(numbers)) + _text(data)
