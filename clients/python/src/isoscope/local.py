"""`isoscope.serve`: starts the programs of this machine for one volume, and connects to them.

1. `find_program` finds `isoscope`.
2. `_volume` gives its arguments: a dataset folder as it is, a file, or an array in a scratch file.
3. _Server makes a token, starts the program under a keeper, and waits for the address that it prints.
4. The client that connects there ends program and scratch folder when it is closed, lost, or its process ends.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import os
import pathlib
import secrets
import shutil
import signal
import subprocess
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from typing import IO, Any, Union

import numpy as np
import numpy.typing as npt

from isoscope import _series_files
from isoscope._channel import DEFAULT_TIMEOUT
from isoscope.client import Client, connect
from isoscope.errors import InvalidArgumentError, ProgramError, printable

__all__ = ["find_program", "serve"]

_NUMPY_TYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")

# Ends the program on SIGTERM, or when this process closes its end of the pipe, in whatever way it ends. It has its own
# session, so that Ctrl-C in a notebook reaches only the notebook.
_KEEPER = """
exec 3<&0
"$@" </dev/null 3<&- &
child=$!
trap 'kill $child 2>/dev/null' TERM INT
(cat <&3; kill $child) >/dev/null 2>&1 &
watcher=$!
exec 3<&-
wait $child
status=$?
while kill -0 $child 2>/dev/null; do wait $child; status=$?; done
# Its number may soon be another program's.
kill $watcher 2>/dev/null
exit $status
"""


def find_program() -> str:
    """Returns the path of the program `isoscope`: $ISOSCOPE_BIN (the program, or its folder), else the PATH.

    Raises:
        ProgramError: it is not installed.
    """
    named = os.environ.get("ISOSCOPE_BIN")
    if named:
        path = os.path.join(named, "isoscope") if os.path.isdir(named) else named
        if os.path.isfile(path) and os.access(path, os.X_OK):
            return path
        raise ProgramError(f"$ISOSCOPE_BIN is {named!r}: there is no program 'isoscope' that can be run")
    found = shutil.which("isoscope")
    if found is None:
        raise ProgramError(
            "the program 'isoscope' is not installed here: put its folder on the PATH or into $ISOSCOPE_BIN "
            "(in a checkout, scripts/build.sh makes build/release/bin), or use isoscope.connect('HOST:PORT')"
        )
    return found


def serve(
    source: Union[str, os.PathLike[str], npt.NDArray[Any], Mapping[str, npt.ArrayLike]],
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
    shards: int = 1,
    renderer: str = "auto",
    threads: int | None = None,
    memory_limit: str | None = None,
    timeout: float = DEFAULT_TIMEOUT,
) -> Client:
    """Serves a volume from this machine and returns a connected client; closing it ends the programs.

    The server asks for a token that only this process and its user know: others of the machine see nothing.
    `isoscope.connect(client.address, token_file=client.token_file)` connects once more.

        client = isoscope.serve("head.nii.gz")
        client.dataset().render(isovalue=60)

        client = isoscope.serve(array, spacing=(0.5, 0.5, 1.0))    # array[z, y, x]
        client = isoscope.serve("slices/", spacing=(1, 1, 4))      # in place of what the files say
        client = isoscope.serve({"p": pressure, "v": velocity}, times=times, vectors=["v"])

    Args:
        source: a dataset folder; or a volume that `isoscope partition` takes, a file, a folder or a pattern:
            `isoscope info --list-formats` lists its formats; or a numpy array of shape (nz, ny, nx), or
            (nt, nz, ny, nx) with steps; or a dict of such arrays: fields by name.
        name: name of the dataset: a dataset folder of that name is made for this client alone.
        folder: folder to keep the dataset in, which must not exist yet. Without name and folder, a volume file is
            partitioned into the cache that the programs share (`isoscope cache list`), unless it is there already; then
            its dataset is named as there, and `client.dataset()` needs no name. An array is "array", not cached.
        spacing: world units between samples along x, y, z, in place of what a file says; of an array: 1, 1, 1.
        origin: world position of the first sample, likewise; of an array: 0, 0, 0.
        direction: matrix of 3 x 3, whose columns are the world directions of x, y and z, likewise, as ITK has it.
        times: times of the steps of arrays, strictly ascending; default: 0, 1, 2, ...
        vectors: names of the arrays of a dict that have a last axis of components, (nz, ny, nx, nc) or (nt, nz, ny, nx,
            nc); True: all arrays have it.
        units: units of the arrays of a dict by name, such as {"p": "Pa"}, or of all of them.
        time_unit, length_unit: units of times and of spacing and origin, of arrays.
        dims: samples along x, y, z: of raw samples.
        dtype: type of raw samples, little-endian.
        shards: shards to cut a volume into, one agent each.
        renderer: "auto", "egl" or "cpu".
        threads: threads of all agents together; default: one for each core.
        memory_limit: of all agents together, as in "2G"; default: a quarter of the machine's.
        timeout: deadline of the client's calls, seconds.

    Raises:
        ProgramError: the program is not installed, or ended with an error, which the message quotes.
    """
    program = find_program()
    server = _Server()
    try:
        volume = _volume(
            program, source, server, name=name, folder=folder, spacing=spacing, origin=origin, direction=direction,
            times=times, vectors=vectors, units=units, time_unit=time_unit, length_unit=length_unit, dims=dims,
            dtype=dtype, shards=shards,
        )  # fmt: skip
        flags = ["--listen", "127.0.0.1:0", "--renderer", renderer]
        flags += [] if threads is None else ["--threads", str(threads)]
        flags += [] if memory_limit is None else ["--memory-limit", memory_limit]
        token_file, digest_file = server.make_token()
        address = server.start([program, "serve", *volume, "--tokens", digest_file, *flags])
        client = connect(address, tls=False, token_file=token_file, timeout=timeout)
    except BaseException:
        server.close()
        raise
    client._on_close = server.close
    # A client without references ends its programs.
    weakref.finalize(client, server.close)
    return client


def _volume(
    program: str,
    source: str | os.PathLike[str] | npt.NDArray[Any] | Mapping[str, npt.ArrayLike],
    server: _Server,
    *,
    name: str | None,
    folder: str | os.PathLike[str] | None,
    spacing: Sequence[float] | None,
    origin: Sequence[float] | None,
    direction: npt.ArrayLike | None,
    times: Sequence[float] | None,
    vectors: bool | Sequence[str],
    units: Mapping[str, str] | str | None,
    time_unit: str | None,
    length_unit: str | None,
    dims: Sequence[int] | None,
    dtype: npt.DTypeLike | None,
    shards: int,
) -> list[str]:
    """Returns the arguments of `isoscope serve` for `source`: a dataset folder, or a volume that goes into the cache.

    An array, and a volume with a name or folder of its own, become a dataset folder by `isoscope partition`.
    """
    is_file = not isinstance(source, (np.ndarray, Mapping))
    is_series = times is not None or vectors is not False or any((units, time_unit, length_unit))
    if isinstance(source, (np.ndarray, Mapping)):
        if dims is not None or dtype is not None:
            raise InvalidArgumentError("dims and dtype are for raw files: an array has its own")
        name = name or ("array" if folder is None else None)
        if isinstance(source, Mapping) or source.ndim > 3 or is_series:
            series = _series_files.as_series(
                source, times, vectors, units=units, time_unit=time_unit, length_unit=length_unit
            )
            path = str(_series_files.write(series, pathlib.Path(server.scratch()), spacing=spacing, origin=origin))
            spacing = origin = None
        else:
            path, dims, dtype = server.write_array(source), source.shape[::-1], _sample_type(source)
    elif is_series:
        raise InvalidArgumentError("times, vectors and units are for arrays: a file has its own")
    else:
        path = os.fspath(source)
        if os.path.isfile(os.path.join(path, "manifest.json")):
            if spacing is not None or origin is not None or direction is not None:
                raise InvalidArgumentError("spacing, origin and direction are for volumes: a dataset folder has its own")
            return [path]
    flags = ["--shards", str(shards)]
    if dims is not None:
        flags += ["--dims", _joined(dims), "--type", np.dtype(dtype if dtype is not None else "uint8").name]
    elif dtype is not None:
        raise InvalidArgumentError("dtype is for arrays and for raw files, which need dims too")
    flags += ["--spacing", _joined(spacing)] if spacing is not None else []
    flags += ["--origin", _joined(origin)] if origin is not None else []
    flags += ["--direction", _joined(direction)] if direction is not None else []
    if folder is None:
        if is_file and name is None:
            return [path, *flags]
        folder = os.path.join(server.scratch(), name or "volume")
    elif name is not None:
        raise InvalidArgumentError("name and folder exclude each other: a dataset has the name of its folder")
    command = [program, "partition", path, "--output", os.fspath(folder), *flags]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace")
    if done.returncode != 0:
        raise ProgramError(f"isoscope partition failed: {_last_line(done.stderr)}")
    return [os.fspath(folder)]


def _sample_type(array: npt.NDArray[Any]) -> np.dtype[Any]:
    if array.dtype == np.bool_:
        return np.dtype(np.uint8)
    if array.dtype.name not in _NUMPY_TYPES:
        raise InvalidArgumentError(
            f"array of {array.dtype.name}: must be one of {', '.join(_NUMPY_TYPES)}; convert it with array.astype(...)"
        )
    return array.dtype


def _joined(values: npt.ArrayLike) -> str:
    return ",".join(repr(value) for value in np.asarray(values).ravel().tolist())


def _last_line(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return printable(lines[-1].strip()) if lines else "it said nothing"


class _Server:
    """The programs and the scratch folder of one `serve`. Only the process that made it ends it."""

    def __init__(self) -> None:
        self._pid = os.getpid()
        self._process: subprocess.Popen[str] | None = None
        self._scratch: str | None = None
        self._log: IO[str] | None = None
        atexit.register(self.close)

    def scratch(self) -> str:
        """Returns a folder that goes when this is closed."""
        if self._scratch is None:
            self._scratch = tempfile.mkdtemp(prefix="isoscope-")
        return self._scratch

    def make_token(self) -> tuple[str, str]:
        """Makes a token; returns the file with it, and the one with its digest, for the server."""
        token = secrets.token_urlsafe(32)
        digest = hashlib.sha256(token.encode("ascii")).hexdigest()
        entry = {"name": "python", "sha256": digest, "datasets": ["*"]}
        return self._write_private(token), self._write_private(json.dumps({"tokens": [entry]}))

    def _write_private(self, text: str) -> str:
        """Writes a file that other users can never read, not even for a moment; returns its path."""
        handle, path = tempfile.mkstemp(prefix="token-", dir=self.scratch())
        with open(handle, "w", encoding="ascii") as file:
            file.write(text)
        return path

    def write_array(self, array: npt.NDArray[Any]) -> str:
        """Writes the samples of array[z, y, x], x fastest, little-endian; returns the path."""
        if array.ndim != 3 or min(array.shape) < 2:
            raise InvalidArgumentError(
                f"array of shape {array.shape}: must be (nz, ny, nx), or (nt, nz, ny, nx) with steps, with at least 2 "
                "samples on each axis of the grid"
            )
        samples = array.astype(_sample_type(array).newbyteorder("<"), order="C", copy=False)
        path = os.path.join(self.scratch(), "samples.raw")
        samples.tofile(path)
        return path

    def start(self, command: list[str]) -> str:
        """Starts the server and returns the address that it prints once frames can be rendered."""
        self._log = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")
        self._process = subprocess.Popen(
            ["/bin/sh", "-c", _KEEPER, "isoscope-serve", *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            start_new_session=True,
        )
        assert self._process.stdout is not None
        address = self._process.stdout.readline().strip()
        if not address:
            self._process.wait()
            self._log.seek(0)
            raise ProgramError(f"isoscope serve failed: {_last_line(self._log.read())}")
        # The rest is not read: the program prints no more.
        return address

    def close(self) -> None:
        """Ends the programs and removes the scratch folder. Any number of times."""
        if os.getpid() != self._pid:
            return
        atexit.unregister(self.close)
        process, self._process = self._process, None
        if process is not None:
            _end(process)
        if self._log is not None:
            self._log.close()
        scratch, self._scratch = self._scratch, None
        if scratch is not None:
            shutil.rmtree(scratch, ignore_errors=True)


def _end(process: subprocess.Popen[str]) -> None:
    """Lets frames in work finish, for a while; then kills."""
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        process.wait(timeout=15)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
