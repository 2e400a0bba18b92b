"""`isoscope.serve`: starts the programs of this machine for one volume, and connects to them.

1. `find_program` finds `isoscope`.
2. `_volume` gives its arguments: a dataset folder as it is, a file, or arrays in a scratch file.
3. _Server makes a token, starts the program under a keeper, and waits for the address that it prints.
4. The client that connects there ends program and scratch folder when it is closed, lost, or its process ends.
5. The first view in a notebook starts the web gateway, which ends with them.
"""

from __future__ import annotations

import atexit
import hashlib
import json
import math
import os
import pathlib
import re
import secrets
import subprocess
import tempfile
import warnings
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from isoscope import _series_files
from isoscope._channel import DEFAULT_TIMEOUT
from isoscope._serving import stores, xarray_source
from isoscope._serving.gateway import LocalGateway
from isoscope._serving.progress import Progress
from isoscope._serving.programs import KeptProgram, ScratchFolder, find_program, last_line
from isoscope._serving.samples import as_array, is_dask, write_samples
from isoscope.client import Client, connect
from isoscope.errors import InvalidArgumentError, ProgramError

__all__ = ["find_program", "serve"]

_NUMPY_TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")
_TAKEN = (
    "serve takes a path (str or os.PathLike), an address, a numpy or dask array, a dict of such arrays by name, an "
    "xarray DataArray or Dataset, an array or group of zarr, or a mapper or file of fsspec"
)
# Types that are converted, as each of their values is one of the other type.
_EXACT = {"bool": "uint8", "float16": "float32"}
_ADDRESSES_OF_PROGRAM = ("https://", "http://", "s3://")


def serve(
    source: Union[str, os.PathLike[str], npt.NDArray[Any], Mapping[str, npt.ArrayLike], Any],
    *,
    name: str | None = None,
    folder: str | os.PathLike[str] | None = None,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    direction: npt.ArrayLike | None = None,
    times: Sequence[float] | None = None,
    vectors: bool | Sequence[str] = False,
    units: Mapping[str, str] | str | None = None,
    time_unit: str | None = None,
    length_unit: str | None = None,
    dims: Sequence[int] | None = None,
    dtype: npt.DTypeLike | None = None,
    axes: str | None = None,
    resample: bool = False,
    shards: int = 1,
    renderer: str = "auto",
    threads: int | None = None,
    memory_limit: str | None = None,
    timeout: float = DEFAULT_TIMEOUT,
    progress: bool | Callable[[int, int], None] | None = None,
) -> Client:
    """Serves a volume from this machine and returns a connected client; closing it ends the programs.

    The server asks for a token that only this process and its user know: others of the machine see nothing.
    `isoscope.connect(client.address, token_file=client.token_file)` connects once more.

        client = isoscope.serve("head.nii.gz")
        client.dataset().render(isovalue=60)
        client.dataset().view(60)                                  # in a notebook: under the mouse

        client = isoscope.serve(array, spacing=(0.5, 0.5, 1.0))    # array[z, y, x]
        client = isoscope.serve("slices/", spacing=(1, 1, 4))      # in place of what the files say
        client = isoscope.serve({"p": pressure, "v": velocity}, times=times, vectors=["v"])
        client = isoscope.serve(xarray.open_dataset("ocean.nc"))   # by its coordinates and units
        client = isoscope.serve(zarr.open("scan.zarr"))            # of any store; likewise fsspec.get_mapper(...)
        client = isoscope.serve("s3://bucket/scan.zarr")           # an address

    Args:
        source: a dataset folder; or a volume that `isoscope partition` takes, a file, a folder or a pattern:
            `isoscope info --list-formats` lists its formats; or an array of numpy or dask of shape (nz, ny, nx), or
            (nt, nz, ny, nx) with steps; or a dict of such arrays: fields by name; or an xarray DataArray or Dataset,
            which is read as its netCDF file would be: by its coordinates and the attributes `axis`, `units`,
            `standard_name` and `positive` of CF. Coordinates that are not even are refused by name. Or an array or group
            of zarr, a mapper or an open file of fsspec, or an address ("s3://...", "https://...", and what fsspec
            knows): the program reads it where it is, or what it needs of it is copied for this client.
        name: name of the dataset: a dataset folder of that name is made for this client alone.
        folder: folder to keep the dataset in, which must not exist yet. Without name and folder, a volume file is
            partitioned into the cache that the programs share (`isoscope cache list`), unless it is there already; then
            its dataset is named as there, and `client.dataset()` needs no name. An array is "array", not cached.
        spacing: world units between samples along x, y, z, in place of what a file says; of an array: 1, 1, 1.
        origin: world position of the first sample, likewise; of an array: 0, 0, 0.
        direction: matrix of 3 x 3, whose columns are the world directions of x, y and z, likewise, as ITK has it.
        times: times of the steps of arrays, strictly ascending; default: 0, 1, 2, ...
        vectors: names of the arrays of a dict that have a last axis of components, (nz, ny, nx, nc) or (nt, nz, ny, nx,
            nc); True: all arrays have it. Likewise of an xarray Dataset, whose other axes may have any order.
        units: units of the arrays of a dict by name, such as {"p": "Pa"}, or of all of them.
        time_unit, length_unit: units of times and of spacing and origin, of arrays.
        dims: samples along x, y, z: of raw samples.
        dtype: type of raw samples, little-endian.
        axes: meaning of the dimensions of an xarray, a netCDF or an HDF5 file that does not say it, slowest first: "TZYX"
            of the letters T, C (components), Z, Y, X, and - for one of one element.
        resample: whether samples at uneven distances are interpolated onto even ones, instead of an error.
        shards: shards to cut a volume into, one agent each.
        renderer: "auto", "egl" or "cpu".
        threads: threads of all agents together; default: one for each core.
        memory_limit: of all agents together, as in "2G"; default: a quarter of the machine's.
        timeout: deadline of the client's calls, seconds.
        progress: of the samples that are written or fetched: a line on the terminal or in the notebook (default: where
            one is and it takes more than a second), or a function of the bytes done and the bytes in all, 0 if these
            are not known.

    Raises:
        InvalidArgumentError: the source is of a type that is not taken, or the arguments do not fit it.
        MissingPackageError: an address needs fsspec.
        ResourceExhaustedError: the samples do not fit into the folder of temporary files (`TMPDIR`).
        ProgramError: the program is not installed, or ended with an error, which the message quotes.
    """
    _check_source(source)
    program = find_program()
    wanted = _Wanted(
        name=name, folder=folder, spacing=spacing, origin=origin, direction=direction, times=times, vectors=vectors,
        units=units, time_unit=time_unit, length_unit=length_unit, dims=dims, dtype=dtype, axes=axes, resample=resample,
        shards=shards, progress=progress,
    )  # fmt: skip
    _check_grid(wanted)
    server = _Server()
    try:
        volume, fields = _volume(program, source, server, wanted)
        flags = ["--listen", "127.0.0.1:0", "--renderer", renderer]
        flags += [] if threads is None else ["--threads", str(threads)]
        flags += [] if memory_limit is None else ["--memory-limit", memory_limit]
        token_file, digest_file = server.make_token()
        address = server.start([program, "serve", *volume, "--tokens", digest_file, *flags])
        gateway = server.gateway = LocalGateway(program, address, token_file, server.write_private)
        client = connect(address, tls=False, token_file=token_file, timeout=timeout)
        _warn_of_missing(client, fields)
    except BaseException:
        server.close()
        raise
    client._on_close = server.close
    client._start_gateway = gateway.start
    # A client without references ends its programs.
    weakref.finalize(client, server.close)
    return client


def _check_source(source: Any) -> None:
    """Refuses a source of a type that is not taken, and says what is."""
    if type(source).__module__.partition(".")[0] in ("h5py", "netCDF4"):
        raise InvalidArgumentError(
            f"source is a {_type_name(source)}: serve its file by its path, 'run.h5', or one array of it, 'run.h5:p'; it "
            "is read in parts"
        )
    if isinstance(source, Mapping) and not xarray_source.is_xarray(source) and not stores.is_store(source):
        if any(key in source for key in (".zarray", ".zgroup", "zarr.json")):
            raise InvalidArgumentError(f"source is a {_type_name(source)}, a store of zarr: give zarr.open(store)")
        for name, values in source.items():
            if xarray_source.is_xarray(values):
                raise InvalidArgumentError(
                    f"the dict has {name!r}, a {_type_name(values)}, whose coordinates would be lost: give "
                    "xarray.Dataset({...}) instead of the dict"
                )
            if stores.is_zarr(values):
                raise InvalidArgumentError(
                    f"the dict has {name!r}, a {_type_name(values)}, all of which would be in memory: give "
                    "dask.array.from_zarr(...) instead, or the group of such arrays instead of the dict"
                )
        return
    if isinstance(source, (str, os.PathLike, np.ndarray)) or is_dask(source) or xarray_source.is_xarray(source):
        return
    if stores.is_store(source):
        return
    is_like_an_array = isinstance(source, (list, tuple)) or hasattr(source, "__array__")
    hint = "; numpy.asarray(...) makes an array of it" if is_like_an_array else ""
    raise InvalidArgumentError(f"source is a {_type_name(source)}: {_TAKEN}{hint}")


def _type_name(value: object) -> str:
    module = type(value).__module__.partition(".")[0]
    return type(value).__name__ if module == "builtins" else f"{module}.{type(value).__name__}"


def _warn_of_missing(client: Client, fields: Sequence[str]) -> None:
    """Warns of variables of a source that are not served: those of another grid."""
    if len(fields) < 2:
        return
    served = {one.name for one in client.dataset().fields}
    missing = [one for one in fields if one not in served]
    if not missing:
        return
    if served:
        said = f"not served: {_quoted(missing)}, of another grid than {_quoted(sorted(served))}"
    else:
        said = f"only one of {_quoted(fields)} is served: their grids differ"
    warnings.warn(f"{said}; serve them by themselves, serve(dataset['NAME'])", stacklevel=3)


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names))


@dataclass(frozen=True, eq=False)
class _Wanted:
    """What `serve` was asked to make of a source: its arguments of these names."""

    name: str | None = None
    folder: str | os.PathLike[str] | None = None
    spacing: Sequence[float] | None = None
    origin: Sequence[float] | None = None
    direction: npt.ArrayLike | None = None
    times: Sequence[float] | None = None
    vectors: bool | Sequence[str] = False
    units: Mapping[str, str] | str | None = None
    time_unit: str | None = None
    length_unit: str | None = None
    dims: Sequence[int] | None = None
    dtype: npt.DTypeLike | None = None
    axes: str | None = None
    resample: bool = False
    shards: int = 1
    progress: bool | Callable[[int, int], None] | None = None

    def given(self, *names: str) -> list[str]:
        """Returns those of the names whose argument was given."""
        return [name for name in names if getattr(self, name) is not None and getattr(self, name) is not False]


def _check_grid(wanted: _Wanted) -> None:
    """Refuses numbers that place no grid, with what is expected."""
    shapes = {"spacing": (3,), "origin": (3,), "direction": (3, 3)}
    meanings = {
        "spacing": "three finite numbers above 0, along x, y and z", "origin": "three finite numbers, of x, y and z",
        "direction": "3 x 3 finite numbers, whose columns are the directions of x, y and z",
    }  # fmt: skip
    for name, shape in shapes.items():
        value = getattr(wanted, name)
        if value is None:
            continue
        try:
            numbers = np.asarray(value)
            is_grid = numbers.dtype.kind in "iuf" and numbers.shape == shape and bool(np.isfinite(numbers).all())
        except ValueError:
            is_grid = False  # rows of different lengths
        if not is_grid or (name == "spacing" and min(numbers) <= 0):
            raise InvalidArgumentError(f"{name} {value!r}: must be {meanings[name]}")
    if wanted.axes is not None and not isinstance(wanted.axes, str):
        raise InvalidArgumentError(f"axes {wanted.axes!r}: must be text, the slowest axis first, such as 'TZYX'")


@dataclass(frozen=True, eq=False)
class _Source:
    """A file or folder for `isoscope`, and what its flags say of it.

    Attributes:
        path: of the file or folder.
        grid: the arguments that are flags still: spacing, origin.
        dims, dtype: of raw samples.
        is_own: whether the file is one of `serve`, which goes when the client is closed.
        fields: names of the variables in it; empty: not known, or just one.
        name: of its dataset, if `serve` is given none; empty: as the program names it.
    """

    path: str
    grid: tuple[str, ...] = ("spacing", "origin", "direction")
    dims: Sequence[int] | None = None
    dtype: npt.DTypeLike | None = None
    is_own: bool = False
    fields: Sequence[str] = field(default_factory=list)
    name: str = ""


def _volume(program: str, source: Any, server: _Server, wanted: _Wanted) -> tuple[list[str], Sequence[str]]:
    """Returns the arguments of `isoscope serve` for `source`, and the fields that it should have.

    That is a dataset folder, or a volume that goes into the cache. An array, and a volume with a name or folder of its
    own, become a dataset folder by `isoscope partition`.
    """
    if stores.is_store(source) or isinstance(source, (str, os.PathLike)):
        if wanted.given("times", "vectors", "units", "time_unit", "length_unit"):
            raise InvalidArgumentError("times, vectors and units are for arrays: a file or a store has its own")
        found = _located(program, source, server, wanted)
        path = found.path
        if os.path.isfile(os.path.join(path, "manifest.json")):
            given = wanted.given("spacing", "origin", "direction", "axes", "resample")
            if given:
                raise InvalidArgumentError(
                    f"{', '.join(given)}: spacing, origin, direction, axes and resample are for volumes: a dataset "
                    "folder has its own"
                )
            return [path], []
        made = _Source(path, dims=wanted.dims, dtype=wanted.dtype, is_own=found.is_copy, name=found.name)
    else:
        made = _file_of_arrays(source, server, wanted)
    flags = _flags(made, wanted)
    name, folder = wanted.name, wanted.folder
    if folder is None:
        if not made.is_own and name is None:
            return [made.path, *flags], []
        folder = os.path.join(server.scratch(), name or made.name or ("array" if made.is_own else "volume"))
    elif name is not None:
        raise InvalidArgumentError("name and folder exclude each other: a dataset has the name of its folder")
    command = [program, "partition", made.path, "--output", os.fspath(folder), *flags]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace")
    if done.returncode != 0:
        said = last_line(done.stderr)
        if made.is_own:
            # The path means nothing to the caller, who gave an array or an address.
            for path in (made.path, made.path.partition(":")[0]):
                said = said.replace(path + ": ", "").replace(path + ":", "").replace(path, "the source")
        raise ProgramError(f"isoscope partition failed: {_in_python(said)}")
    return [os.fspath(folder)], made.fields


def _in_python(said: str) -> str:
    """Returns a sentence of the program with the arguments of `serve` in place of its flags."""
    said = re.sub(r"`isoscope \w+ [^`]*?--axes ([A-Z0-9-]+)[^`]*`", r"axes='\1'", said)
    said = said.replace("--resample", "resample=True").replace(" (see 'isoscope partition --help')", "")
    said = re.sub(r"--(spacing|origin) X,Y,Z", r"\1=(x, y, z)", said)
    return re.sub(r"--(spacing|origin|direction|axes|shards)\b", r"\1", said)


def _flags(made: _Source, wanted: _Wanted) -> list[str]:
    """Returns the flags of `isoscope` that say what a file does not say itself."""
    flags = ["--shards", str(wanted.shards)]
    if made.dims is not None:
        flags += ["--dims", _joined(made.dims), "--type", np.dtype(made.dtype if made.dtype is not None else "uint8").name]
    elif made.dtype is not None:
        raise InvalidArgumentError("dtype is for arrays and for raw files, which need dims too")
    for name in made.grid:
        value = getattr(wanted, name)
        flags += [f"--{name}", _joined(value)] if value is not None else []
    flags += ["--axes", wanted.axes] if wanted.axes is not None else []
    return [*flags, "--resample"] if wanted.resample else flags


def _file_of_arrays(source: Any, server: _Server, wanted: _Wanted) -> _Source:
    """Writes arrays into the scratch folder."""
    if wanted.dims is not None or wanted.dtype is not None:
        raise InvalidArgumentError("dims and dtype are for raw files: an array has its own")
    scratch = pathlib.Path(server.scratch())
    progress = Progress(wanted.progress, "writing the samples")
    try:
        return _written(source, scratch, wanted, progress)
    finally:
        progress.close()


def _written(source: Any, scratch: pathlib.Path, wanted: _Wanted, progress: Progress) -> _Source:
    if xarray_source.is_xarray(source):
        given = wanted.given("times", "units", "time_unit", "length_unit")
        if given:
            raise InvalidArgumentError(
                f"{', '.join(given)}: an xarray has its own, in its coordinates and in their attributes, such as "
                "attrs['units']"
            )
        path = scratch / "source.nc"
        fields = xarray_source.write(source, path, wanted.vectors, progress)
        return _Source(str(path), is_own=True, fields=fields)
    given = wanted.given("axes", "resample")
    if given:
        raise InvalidArgumentError(
            f"{', '.join(given)}: for xarray and for files; an array is array[z, y, x], with even steps"
        )
    is_series = bool(wanted.given("times", "vectors") or wanted.units or wanted.time_unit or wanted.length_unit)
    # Raw files have no integers of 64 bits.
    is_wide = not isinstance(source, Mapping) and source.dtype.name in ("int64", "uint64")
    if isinstance(source, Mapping) or source.ndim > 3 or is_series or is_wide:
        series = _series_files.as_series(
            source, wanted.times, wanted.vectors, units=wanted.units, time_unit=wanted.time_unit,
            length_unit=wanted.length_unit,
        )  # fmt: skip
        written = _series_files.write(
            series, scratch, spacing=wanted.spacing, origin=wanted.origin, progress=progress
        )
        return _Source(str(written), grid=("direction",), is_own=True)
    array = as_array(source, "the array")
    if array.ndim != 3 or min(array.shape) < 2:
        raise InvalidArgumentError(
            f"array of shape {array.shape}: must be (nz, ny, nx), or (nt, nz, ny, nx) with steps, with at least 2 "
            "samples on each axis of the grid"
        )
    dtype = _sample_type(array)
    path = scratch / "samples.raw"
    progress.total = dtype.itemsize * math.prod(map(int, array.shape))
    with open(path, "w+b") as file:
        write_samples(file, array, dtype.newbyteorder("<"), progress)
    return _Source(str(path), dims=array.shape[::-1], dtype=dtype, is_own=True)


def _sample_type(array: Any) -> np.dtype[Any]:
    """Returns the type of the samples of an array in a raw file."""
    name = _EXACT.get(array.dtype.name, array.dtype.name)
    if name not in _NUMPY_TYPES:
        raise InvalidArgumentError(
            f"array of {array.dtype.name}: must be one of {', '.join((*_NUMPY_TYPES, 'int64', 'uint64', *_EXACT))}; "
            f"{_series_files.advice_for(array.dtype)}"
        )
    return np.dtype(name)


class _ProgramForAddresses:
    """What the program `isoscope` can do with an address: `stores.Opener`."""

    def __init__(self, program: str) -> None:
        self._program = program

    def can_open(self, address: str) -> bool:
        if not address.startswith(_ADDRESSES_OF_PROGRAM):
            return False
        return self._run("info", address).returncode == 0

    def copy(self, address: str, folder: pathlib.Path) -> pathlib.Path | None:
        if not address.startswith(_ADDRESSES_OF_PROGRAM):
            return None
        done = self._run("copy", "--quiet", address, str(folder))
        if done.returncode != 0:
            raise ProgramError(f"isoscope copy failed: {last_line(done.stderr)}")
        (copied,) = folder.iterdir()
        return copied

    def _run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [self._program, *arguments], stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace"
        )


def _located(program: str, source: Any, server: _Server, wanted: _Wanted) -> stores.Located:
    """Returns the path of a volume: as it is, of a store, or of a copy in the scratch folder."""
    if not stores.is_store(source):
        return stores.Located(os.fspath(source), False)
    progress = Progress(wanted.progress, "fetching")
    try:
        return stores.located(source, _ProgramForAddresses(program), lambda: pathlib.Path(server.scratch()), progress)
    finally:
        progress.close()


def _joined(values: npt.ArrayLike) -> str:
    return ",".join(repr(value) for value in np.asarray(values).ravel().tolist())


class _Server:
    """The programs and the scratch folder of one `serve`. Only the process that made it ends it."""

    def __init__(self) -> None:
        self._pid = os.getpid()
        self._program: KeptProgram | None = None
        self._scratch: ScratchFolder | None = None
        self.gateway: LocalGateway | None = None
        atexit.register(self.close)

    def scratch(self) -> str:
        """Returns a folder that goes when this is closed, and when its process is killed."""
        if self._scratch is None:
            self._scratch = ScratchFolder()
        return self._scratch.path

    def make_token(self) -> tuple[str, str]:
        """Makes a token; returns the file with it, and the one with its digest, for the server."""
        token = secrets.token_urlsafe(32)
        digest = hashlib.sha256(token.encode("ascii")).hexdigest()
        entry = {"name": "python", "sha256": digest, "datasets": ["*"]}
        return self.write_private(token), self.write_private(json.dumps({"tokens": [entry]}))

    def write_private(self, text: str) -> str:
        """Writes a file that other users can never read, not even for a moment; returns its path."""
        handle, path = tempfile.mkstemp(prefix="token-", dir=self.scratch())
        with open(handle, "w", encoding="ascii") as file:
            file.write(text)
        return path

    def start(self, command: list[str]) -> str:
        """Starts the server and returns the address that it prints once frames can be rendered."""
        self._program = KeptProgram(command, pathlib.Path(self.scratch(), "server.log"))
        address = self._program.first_line()
        if not address:
            raise ProgramError(f"isoscope serve failed: {_in_python(last_line(self._program.log_text()))}")
        return address

    def close(self) -> None:
        """Ends the programs and removes the scratch folder. Any number of times."""
        if os.getpid() != self._pid:
            return
        atexit.unregister(self.close)
        if self.gateway is not None:
            self.gateway.close()
        program, self._program = self._program, None
        if program is not None:
            program.close()
        scratch, self._scratch = self._scratch, None
        if scratch is not None:
            scratch.close()
