"""Arrays with fields and times as files that `isoscope partition` reads: a VTI for each step, a PVD that lists them.

    series.pvd
    step-00000.vti      ImageData: one array for each field, appended raw

Samples go from the arrays to the files as they are, x fastest, the components of a sample together. Units stand where
`isoscope generate flow` writes them: the UNITS_LABEL of an array, `TimeUnit` of the collection, `Unit` of the image.
"""

from __future__ import annotations

import math
import pathlib
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import numpy.typing as npt

from isoscope._serving.progress import Progress
from isoscope._serving.samples import AnyArray, as_array, check_room, write_samples
from isoscope.errors import InvalidArgumentError

#: VTK's names of the types of samples.
_VTK_TYPES = {
    "uint8": "UInt8", "int8": "Int8", "uint16": "UInt16", "int16": "Int16", "uint32": "UInt32", "int32": "Int32",
    "uint64": "UInt64", "int64": "Int64", "float32": "Float32", "float64": "Float64",
}  # fmt: skip
# Types that are converted, as each of their values is one of the other type.
_EXACT = {"bool": "uint8", "float16": "float32"}


def stored_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """Returns the type of samples in a file."""
    return np.dtype(_EXACT.get(dtype.name, dtype))


def advice_for(dtype: np.dtype[Any]) -> str:
    """Returns what to do with an array of a type that is not taken."""
    if dtype.names:
        first = dtype.names[0]
        return f"serve its fields, as in {{{first!r}: array[{first!r}]}}"
    if dtype.kind == "c":
        return "serve what is meant of it, such as abs(array) or {'re': array.real, 'im': array.imag}"
    return "convert it with array.astype(...)"


@dataclass(frozen=True, eq=False)
class _FieldOfArrays:
    name: str
    samples: AnyArray  # (t, z, y, x) or (t, z, y, x, c)
    unit: str | None = None

    @property
    def component_count(self) -> int:
        return int(self.samples.shape[4]) if self.samples.ndim == 5 else 1


@dataclass(frozen=True, eq=False)
class Series:
    """Arrays that fit each other."""

    fields: tuple[_FieldOfArrays, ...]
    times: tuple[float, ...] | None  # None: one step without a time
    time_unit: str | None = None
    length_unit: str | None = None

    @property
    def dims(self) -> tuple[int, int, int]:
        """Samples along x, y, z."""
        z, y, x = self.fields[0].samples.shape[1:4]
        return int(x), int(y), int(z)


def as_series(
    source: npt.NDArray[Any] | Mapping[str, npt.ArrayLike],
    times: Sequence[float] | None,
    vectors: bool | Sequence[str],
    *,
    units: Mapping[str, str] | str | None = None,
    time_unit: str | None = None,
    length_unit: str | None = None,
) -> Series:
    """Checks arrays, one or several by name, and gives all of them a time axis.

    Args:
        source: shape (z, y, x) or (t, z, y, x); with a last axis of components if `vectors` says so.
        times: of the steps, strictly ascending; default: 0, 1, 2, ...
        vectors: names of the arrays that have a last axis of components; True: all of them.
        units: of the samples, by name of the array, or of all.
        time_unit, length_unit: of times and of the grid.
    """
    named = dict(source) if isinstance(source, Mapping) else {"samples": source}
    if not named:
        raise InvalidArgumentError("the dict of arrays is empty: give at least one field, {'name': array}")
    with_components = list(named) if vectors is True else [] if vectors is False else list(vectors)
    for name in with_components:
        if name not in named:
            raise InvalidArgumentError(f"vectors names {name!r}: the arrays are {', '.join(map(repr, named))}")
    if not (units is None or isinstance(units, (str, Mapping))):
        raise InvalidArgumentError(f"units {units!r}: must be text, or a dict of texts by name, {{'p': 'Pa'}}")
    unit_of = dict(units) if isinstance(units, Mapping) else dict.fromkeys(named, units)
    for name in unit_of:
        if name not in named:
            raise InvalidArgumentError(f"units names {name!r}: the arrays are {', '.join(map(repr, named))}")
    other_units = [("time_unit", time_unit), ("length_unit", length_unit)]
    for what, unit in [*(("units", unit) for unit in unit_of.values()), *other_units]:
        if unit is not None and not (isinstance(unit, str) and unit.isprintable()):
            raise InvalidArgumentError(f"{what} {unit!r}: must be text to print, such as 'm/s'")
    has_time = times is not None
    fields = []
    for name, values in named.items():
        samples = _checked(name, as_array(values, f"field {name!r}"), name in with_components)
        axes = samples.ndim - (name in with_components)
        has_time = has_time or axes == 4
        fields.append(_FieldOfArrays(name, samples if axes == 4 else samples[np.newaxis], unit_of.get(name)))
    first = fields[0]
    for one in fields[1:]:
        if one.samples.shape[:4] != first.samples.shape[:4]:
            raise InvalidArgumentError(
                f"field {one.name!r} has (t, z, y, x) = {one.samples.shape[:4]}, and field {first.name!r} has "
                f"{first.samples.shape[:4]}: all fields need the same grid and steps"
            )
    checked_times = _checked_times(times, len(first.samples)) if has_time else None
    return Series(tuple(fields), checked_times, time_unit, length_unit)


def _checked(name: str, samples: AnyArray, has_components: bool) -> AnyArray:
    if not isinstance(name, str) or not name or not name.isprintable() or ":" in name:
        raise InvalidArgumentError(f"field name {name!r}: must be text to print, not empty, without a colon")
    if stored_type(samples.dtype).name not in _VTK_TYPES:
        raise InvalidArgumentError(
            f"field {name!r} is of {samples.dtype.name}: must be one of {', '.join((*_VTK_TYPES, *_EXACT))}; "
            f"{advice_for(samples.dtype)}"
        )
    shapes = "(z, y, x, c) or (t, z, y, x, c)" if has_components else "(z, y, x) or (t, z, y, x)"
    axes = samples.ndim - has_components
    grid = samples.shape[axes - 3 : axes]
    if axes not in (3, 4) or min(grid) < 2 or 0 in samples.shape:
        hint = "" if has_components else "; for components on the last axis, say so with vectors=True"
        raise InvalidArgumentError(
            f"field {name!r} has shape {samples.shape}: must be {shapes}, with at least 2 samples along z, y, x{hint}"
        )
    if has_components and samples.shape[-1] not in range(2, 10):
        raise InvalidArgumentError(f"field {name!r} has {samples.shape[-1]} components: must be 2 to 9")
    return samples


def _checked_times(times: Sequence[float] | None, count: int) -> tuple[float, ...]:
    if times is None:
        return tuple(map(float, range(count)))
    try:
        values = tuple(float(time) for time in times)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(
            f"times {times!r}: must be numbers, such as those of hours, (times - times[0]) / numpy.timedelta64(1, 'h')"
        ) from error
    if len(values) != count:
        raise InvalidArgumentError(f"times has {len(values)} values, and the arrays have {count} steps")
    if not all(map(math.isfinite, values)) or any(b <= a for a, b in zip(values, values[1:])):
        raise InvalidArgumentError("times must be finite and strictly ascending")
    return values


def write(
    series: Series,
    folder: pathlib.Path,
    *,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    progress: Progress | None = None,
) -> pathlib.Path:
    """Writes the files into a folder that is there; returns the one that names all of it."""
    total = sum(map(_size_of, (one.samples for one in series.fields)))
    check_room(folder, total)
    if progress is not None:
        progress.total = total
    paths = []
    for step in range(len(series.fields[0].samples)):
        path = folder / f"step-{step:05d}.vti"
        _write_step(series, step, path, _numbers(spacing, "spacing", 1), _numbers(origin, "origin", 0), progress)
        paths.append(path)
    if series.times is None:
        return paths[0]
    rows = "".join(
        f'    <DataSet timestep="{time!r}" file="{path.name}"/>\n' for time, path in zip(series.times, paths)
    )
    listing = folder / "series.pvd"
    listing.write_text(
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n'
        f"  <Collection{_attribute('TimeUnit', series.time_unit)}>\n"
        f"{rows}  </Collection>\n</VTKFile>\n",
        encoding="utf-8",
    )
    return listing


def _size_of(samples: AnyArray) -> int:
    return int(stored_type(samples.dtype).itemsize) * math.prod(map(int, samples.shape))


def _numbers(values: Sequence[float] | None, name: str, default: float) -> str:
    if values is None:
        values = (default, default, default)
    numbers: list[float] = np.asarray(values, np.float64).ravel().tolist()
    if len(numbers) != 3 or not all(map(math.isfinite, numbers)):
        raise InvalidArgumentError(f"{name} {values!r}: must be three numbers, of x, y and z")
    return " ".join(map(repr, numbers))


def _attribute(name: str, value: str | None) -> str:
    return f" {name}={quoteattr(value)}" if value else ""


def _write_step(
    series: Series, step: int, path: pathlib.Path, spacing: str, origin: str, progress: Progress | None
) -> None:
    extent = " ".join(f"0 {side - 1}" for side in series.dims)
    arrays, offset = "", 0
    parts = [one.samples[step] for one in series.fields]
    for one, samples in zip(series.fields, parts):
        arrays += (
            f'        <DataArray type="{_VTK_TYPES[stored_type(samples.dtype).name]}" Name={quoteattr(one.name)} '
            f'NumberOfComponents="{one.component_count}" format="appended" offset="{offset}">'
        )
        if one.unit:
            arrays += f'<InformationKey name="UNITS_LABEL" location="vtkDataArray">{escape(one.unit)}</InformationKey>'
        arrays += "</DataArray>\n"
        offset += 8 + _size_of(samples)
    header = (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'  <ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{spacing}"'
        f"{_attribute('Unit', series.length_unit)}>\n"
        f'    <Piece Extent="{extent}">\n      <PointData>\n{arrays}      </PointData>\n    </Piece>\n  </ImageData>\n'
        '  <AppendedData encoding="raw">\n   _'
    )
    with open(path, "w+b") as file:
        file.write(header.encode("utf-8"))
        for samples in parts:
            file.write(struct.pack("<Q", _size_of(samples)))
            write_samples(file, samples, stored_type(samples.dtype).newbyteorder("<"), progress)
        file.write(b"\n  </AppendedData>\n</VTKFile>\n")
