"""An xarray.DataArray or xarray.Dataset as a netCDF file, so that the rules of files hold for it.

Dimensions, coordinates and attributes are written as they are; times as numbers, as xarray writes them. What is X, Y, Z
and time, units, the direction of each axis, and whether its steps are even, is then found by `isoscope partition`, and
its refusals name the variable and the axis (docs/formats.md, netCDF). Samples are written in parts: those of dask and
of files that were opened lazily need not fit in memory.

netCDF takes some values for holes where nobody said so, such as -32767 of 16 bits. In an array of xarray they are
samples. So floats get the fill value NaN, and integers of 16 and 32 bits become floats that hold each of their values.
"""

from __future__ import annotations

import pathlib
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from isoscope._serving import netcdf_file, samples
from isoscope._serving.netcdf_file import Attribute, Variable
from isoscope._serving.progress import Progress
from isoscope.errors import InvalidArgumentError

# As core/source/grid/axis_order.cc and cf_words.cc have them.
_VECTOR_AXES = ("component", "components", "channel", "channels", "c")
_MEMBER_AXES = ("member", "members", "ensemble", "ensemble_member", "ens")

_TEXTS = ("axis", "units", "standard_name", "long_name", "positive", "_Unsigned")
_SCALES = ("scale_factor", "add_offset")
_LIMITS = ("valid_min", "valid_max", "valid_range")
_PACKING = ("_FillValue", "missing_value", *_SCALES, *_LIMITS)
_MAX_NUMBERS = 64  # of an attribute
# Types that hold all values of other ones.
_EXACT = {"bool": "uint8", "float16": "float32"}
_HOLDS = {"int16": "float32", "uint16": "float32", "int32": "float64", "uint32": "float64"}
_AXES_OF_A_VOLUME = 3
_COMPONENTS = range(2, 10)


def is_xarray(value: object) -> bool:
    """Returns whether this is a DataArray or a Dataset; does not import xarray."""
    xarray: Any = sys.modules.get("xarray")  # nobody has one before it is imported
    return xarray is not None and isinstance(value, (xarray.DataArray, xarray.Dataset))


def write(
    source: Any, path: pathlib.Path, vectors: bool | Sequence[str] = False, progress: Progress | None = None
) -> list[str]:
    """Writes the variables of numbers with three dimensions or more; returns their names.

    Args:
        source: a DataArray or a Dataset.
        vectors: names of the variables whose last dimension is that of components; True: all of them.

    Raises:
        InvalidArgumentError: there is no such variable; one is not of numbers; a dimension has a coordinate of texts.
    """
    arrays, coordinates = _parts_of(source)
    fields = {name: array for name, array in arrays.items() if array.ndim >= _AXES_OF_A_VOLUME}
    if not fields:
        found = ", ".join(f"{name!r} {tuple(array.dims)}" for name, array in arrays.items()) or "none"
        raise InvalidArgumentError(f"no variable has three dimensions or more; the variables are {found}")
    renamed = _component_axes(fields, vectors, source.sizes)
    used = {
        dim: int(source.sizes[dim])
        for name, array in fields.items()
        for dim in (array.dims[:-1] if name in renamed else array.dims)
    }
    lengths = {_checked_name(dim, "dimension"): size for dim, size in used.items()}
    lengths |= {new: int(fields[name].shape[-1]) for name, new in renamed.items()}
    written = [_coordinate(dim, coordinates[dim].variable) for dim in used if _is_told(dim, coordinates)]
    others = {
        str(name): other
        for name, other in coordinates.items()
        if name not in used and 0 < other.ndim and set(other.dims) <= used.keys() and other.dtype.kind in "biuf"
    }
    written += [_coordinate(name, other.variable) for name, other in others.items()]
    for name, array in fields.items():
        dims = [str(dim) for dim in array.dims]
        if name in renamed:
            dims[-1] = renamed[name]
        attributes = _attributes(array, (*_TEXTS, *_PACKING))
        along = [
            other for other, values in others.items() if set(values.dims) <= set(array.dims) and not _has_space(other)
        ]
        if along:
            attributes["coordinates"] = " ".join(along)
        dtype = _stored_type(name, array)
        if not any(one in attributes for one in (*_PACKING, "_Unsigned")):
            dtype = np.dtype(_HOLDS.get(dtype.name, dtype))
            if dtype.kind == "f":
                attributes["_FillValue"] = np.array([np.nan], dtype)
        written.append(Variable(_checked_name(name, "variable"), tuple(dims), _Samples(array), attributes, dtype))
    netcdf_file.write(path, lengths, written, progress)
    return [str(name) for name in fields]


def _parts_of(source: Any) -> tuple[dict[Any, Any], Mapping[Any, Any]]:
    """Returns the variables by name, and the coordinates."""
    if hasattr(source, "data_vars"):
        return {name: source[name].variable for name in source.data_vars}, source.coords
    # A DataArray may have the name of one of its coordinates.
    named = source.name is not None and source.name not in source.coords
    return {source.name if named else "values": source.variable}, source.coords


def _checked_name(name: Any, what: str) -> str:
    text = str(name)
    if not text or not text.isprintable() or "/" in text or ":" in text:
        raise InvalidArgumentError(f"{what} {name!r}: a name must be text to print, without a slash or a colon")
    return text


def _has_space(text: str) -> bool:
    return any(character.isspace() for character in text)


def _component_axes(
    fields: Mapping[Any, Any], vectors: bool | Sequence[str], sizes: Mapping[Any, int]
) -> dict[Any, str]:
    """Returns the dimension of components of each variable that `vectors` names, by a name that tells it."""
    named = list(fields) if vectors is True else [] if vectors is False else list(vectors)
    by_size: dict[int, str] = {}
    found = {}
    for name in named:
        if name not in fields:
            raise InvalidArgumentError(f"vectors names {name!r}: the variables are {', '.join(map(repr, fields))}")
        array = fields[name]
        count = int(array.shape[-1])
        if array.ndim <= _AXES_OF_A_VOLUME or count not in _COMPONENTS:
            raise InvalidArgumentError(
                f"vectors names {name!r}, of the dimensions {tuple(array.dims)} and the shape {array.shape}: must be "
                "three axes of space and then one of 2 to 9 components"
            )
        if array.dims[-1] in _VECTOR_AXES:
            continue
        free = [one for one in _VECTOR_AXES if one not in sizes and one not in by_size.values()]
        if count not in by_size and not free:
            raise InvalidArgumentError(f"vectors names variables of {len(by_size) + 1} counts of components: serve fewer")
        found[name] = by_size.setdefault(count, free[0] if free else "")
    return found


def _is_told(dim: Any, coordinates: Mapping[Any, Any]) -> bool:
    """Returns whether a dimension has a coordinate of numbers or times. Names tell only components apart."""
    if dim not in coordinates:
        return False
    variable = coordinates[dim].variable
    if variable.dtype.kind in "biuf" or _is_time(variable):
        return True
    is_components = dim in (*_VECTOR_AXES, *_MEMBER_AXES) or variable.attrs.get("standard_name") == "realization"
    if not is_components:
        raise InvalidArgumentError(
            f"the coordinate {dim!r} is of {variable.dtype}, not of numbers: give it numbers, or drop it with "
            f"drop_vars({dim!r}), to count its samples"
        )
    return False


def _is_time(variable: Any) -> bool:
    if variable.dtype.kind in "mM":
        return True
    if variable.dtype.kind != "O" or not variable.size:
        return False
    return type(np.ravel(variable.values)[0]).__module__.partition(".")[0] == "cftime"


def _coordinate(name: Any, variable: Any) -> Variable:
    if _is_time(variable):
        conventions: Any = sys.modules["xarray"].conventions
        variable = conventions.encode_cf_variable(variable, name=name)
        variable.attrs.setdefault("axis", "T")
    dims = tuple(map(str, variable.dims))
    return Variable(
        _checked_name(name, "coordinate"), dims, _Samples(variable), _attributes(variable, _TEXTS),
        _stored_type(name, variable),
    )  # fmt: skip


def _attributes(variable: Any, names: Sequence[str]) -> dict[str, Attribute]:
    """Returns those of an array that mean something to the reader.

    Limits are of values as they are stored: of an array that xarray has unpacked they mean nothing any more. Sums and
    means of such an array may have kept its attributes, but not how it was stored: limits of integers give it away.
    """
    found: dict[str, Attribute] = {}
    is_unpacked = any(name in variable.encoding for name in _SCALES)
    is_derived = "dtype" not in variable.encoding and variable.dtype.kind == "f"
    for name in names:
        value = variable.attrs.get(name)
        if value is None or (is_unpacked and name in _LIMITS):
            continue
        if is_derived and name in _LIMITS and getattr(value, "dtype", np.dtype(float)).kind in "iu":
            continue
        if isinstance(value, str):
            if name in _TEXTS:
                found[name] = value
            continue
        numbers = np.asarray(value)
        if name in _PACKING and numbers.dtype.kind in "iuf" and 1 <= numbers.size <= _MAX_NUMBERS:
            found[name] = numbers if numbers.dtype.name in netcdf_file.TYPES else numbers.astype(np.float64)
    return found


class _Samples:
    """The samples of an xarray.Variable, which are read or computed when they are written: `samples.LazyArray`."""

    def __init__(self, variable: Any) -> None:
        self.shape: tuple[int, ...] = tuple(map(int, variable.shape))
        self.dtype: np.dtype[Any] = variable.dtype
        self.chunks: samples.Chunks = (
            samples.whole_chunks(self.shape, _chunk_of(variable), self.dtype.itemsize)
            if variable.chunks is None
            else variable.chunks
        )
        self._variable = variable

    def compute(self, indices: Sequence[samples.Index]) -> Sequence[npt.NDArray[Any]]:
        # `data` of an array that was opened lazily would read all of it.
        if self._variable.chunks is not None and samples.is_dask(self._variable.data):
            return samples.DaskArray(self._variable.data).compute(indices)
        return [np.asarray(self._variable[index].values) for index in indices]


def _chunk_of(variable: Any) -> Sequence[int]:
    """Returns the shape of the chunks of the file or store that an array was opened from; else of one sample."""
    by_dimension = variable.encoding.get("preferred_chunks")
    if isinstance(by_dimension, Mapping):
        found = [by_dimension.get(dim, 1) for dim in variable.dims]
        # Uneven ones are tuples.
        return [int(one) if isinstance(one, (int, np.integer)) and one > 0 else 1 for one in found]
    return [1] * len(variable.shape)


def _stored_type(name: Any, variable: Any) -> np.dtype[Any]:
    dtype = _EXACT.get(variable.dtype.name, variable.dtype.name)
    if dtype not in netcdf_file.TYPES:
        raise InvalidArgumentError(
            f"variable {name!r} is of {variable.dtype}: must be one of {', '.join((*netcdf_file.TYPES, *_EXACT))}; "
            f"convert it with astype(...), or leave it out with drop_vars({name!r})"
        )
    return np.dtype(dtype)
