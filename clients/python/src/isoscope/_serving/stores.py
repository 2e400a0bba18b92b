"""Arrays and groups of zarr, mappers and files of fsspec, and addresses, as a path that `isoscope` can open.

| source | what becomes of it |
|---|---|
| an array or group of zarr in a folder, or in a ZIP that is only read | the path in the store: the program reads it |
| one in any other store, a mapper of fsspec, an address of a store | its objects are copied, as they are |
| another address, a file of fsspec | the program opens or copies it, if it can; else it is copied by fsspec |

A copied store has the metadata and the chunks of one volume: level 0 of an image of OME-Zarr, or the arrays of a group,
or one array with the coordinates of its axes. Keys of chunks follow from the metadata, so that no store is listed that
can't be. Chunks that are not there stay away: they have the fill value. Objects are copied eight at a time, and none is
decoded: neither zarr nor fsspec is imported but for an address that needs it.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import importlib
import itertools
import json
import math
import os
import pathlib
import re
import sys
import urllib.parse
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Protocol

from isoscope._serving.progress import Progress
from isoscope.errors import (
    InvalidArgumentError,
    IsoscopeError,
    MissingPackageError,
    PermissionDeniedError,
    UnavailableError,
    printable,
)

_METADATA = ("zarr.json", ".zgroup", ".zattrs", ".zarray")
_MOST_METADATA_BYTES = 64 << 20
_MOST_CHUNKS = 10_000_000
_MOST_GROUPS_ABOVE = 16
_MOST_LEVELS = 64
_COPIED_TOGETHER = 8
_BLOCK_BYTES = 8 << 20
# "s3://bucket/key", "simplecache::s3://bucket/key"
_ADDRESS = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*::)*[A-Za-z][A-Za-z0-9+.-]*://")
_ARCHIVES = (".zip", ".ozx")


class _Objects(Protocol):
    """The objects of a store, by key. Thread-safe, as zarr's stores are."""

    name: str

    def read(self, key: str) -> bytes | None:
        """Returns a small object; None: there is none of this key."""

    def copy(self, key: str, path: pathlib.Path) -> bool:
        """Copies an object to a file; returns False if there is none of this key."""

    def children(self, key: str) -> Sequence[str]:
        """Returns the names below a group."""


class _Mapping:
    """A store that is a mapping of keys to bytes: those of zarr 2."""

    def __init__(self, name: str, chunks: Mapping[str, Any], metadata: Mapping[str, Any]) -> None:
        self.name = name
        self._chunks = chunks
        self._metadata = metadata

    def read(self, key: str) -> bytes | None:
        for store in (self._metadata, self._chunks):
            with contextlib.suppress(KeyError):
                return _as_bytes(store[key])
        return None

    def copy(self, key: str, path: pathlib.Path) -> bool:
        try:
            data = self._chunks[key]
        except KeyError:
            return False
        _write(path, _as_bytes(data))
        return True

    def children(self, key: str) -> Sequence[str]:
        begin = f"{key}/" if key else ""
        return sorted({one[len(begin) :].split("/")[0] for one in self._chunks if one.startswith(begin)})


class _Asynchronous:
    """A store of zarr 3."""

    def __init__(self, name: str, store: Any) -> None:
        self.name = name
        self._store = store
        self._wait: Callable[[Any], Any] = importlib.import_module("zarr.core.sync").sync
        self._prototype = importlib.import_module("zarr.core.buffer").default_buffer_prototype()

    def read(self, key: str) -> bytes | None:
        found = self._wait(self._store.get(key, self._prototype))
        return None if found is None else bytes(found.to_bytes())

    def copy(self, key: str, path: pathlib.Path) -> bool:
        data = self.read(key)
        if data is not None:
            _write(path, data)
        return data is not None

    def children(self, key: str) -> Sequence[str]:
        async def names() -> list[str]:
            return sorted([one.rstrip("/").rpartition("/")[2] async for one in self._store.list_dir(key)])

        found: list[str] = self._wait(names())
        return found


class _Files:
    """Files below a folder of a file system of fsspec."""

    def __init__(self, system: Any, root: str) -> None:
        self.name = _shown(root)
        self.root = root.rstrip("/")
        self._system = system

    def read(self, key: str) -> bytes | None:
        try:
            with _explained(self.name, key):
                return bytes(self._system.cat_file(self._path(key)))
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
            return None

    def copy(self, key: str, path: pathlib.Path) -> bool:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")
        try:
            with _explained(self.name, key):
                self._system.get_file(self._path(key), str(part))
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
            part.unlink(missing_ok=True)
            return False
        if part.is_dir():  # some file systems copy a folder so
            part.rmdir()
            return False
        part.replace(path)
        return True

    def children(self, key: str) -> Sequence[str]:
        paths = self._system.ls(self._path(key), detail=False)
        return sorted({str(one).rstrip("/").rpartition("/")[2] for one in paths})

    def store(self) -> tuple[_Files, str]:
        """Returns the files of the store that this is a group or an array of, and its key there."""
        files, key = self, ""
        for _ in range(_MOST_GROUPS_ABOVE):
            above, _, name = files.root.rpartition("/")
            parent = _Files(self._system, above)
            try:
                has_metadata = bool(above) and any(parent.read(one) is not None for one in ("zarr.json", ".zgroup"))
            except IsoscopeError:
                break  # what lies above the store may be forbidden
            if not has_metadata:
                break
            files, key = parent, _joined(name, key)
        return files, key

    def _path(self, key: str) -> str:
        return f"{self.root}/{key}" if key else self.root


@contextlib.contextmanager
def _explained(name: str, key: str) -> Iterator[None]:
    """Turns errors of a file system, which has classes of its own, into ours; but for missing files."""
    try:
        yield
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError, IsoscopeError):
        raise
    except Exception as error:
        # An address in an error may be signed.
        said = re.sub(r"\?[^\s'\")]*", "?...", printable(str(error)))
        kind = PermissionDeniedError if isinstance(error, PermissionError) else UnavailableError
        what = f"{name}: {key}" if key else name
        raise kind(f"{what} can't be read: {type(error).__name__}: {said}") from error


def _as_bytes(data: Any) -> bytes:
    if isinstance(data, Mapping):  # consolidated metadata of zarr 2 are parsed
        return json.dumps(data).encode()
    return data if isinstance(data, bytes) else bytes(memoryview(data).cast("B"))


def _write(path: pathlib.Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def _shown(text: str) -> str:
    """Returns an address without what may be a secret: user names, passwords, and the query."""
    return printable(re.sub(r"//[^/@]*@", "//", str(text)).partition("?")[0])


# ---- what a source is


def is_address(source: object) -> bool:
    """Returns whether this is an address, such as "s3://bucket/head.nrrd", and no file of this name."""
    return isinstance(source, str) and _ADDRESS.match(source) is not None and not os.path.exists(source)


def is_zarr(source: object) -> bool:
    """Returns whether this is an array or a group of zarr; does not import zarr."""
    zarr: Any = sys.modules.get("zarr")  # nobody has one before it is imported
    return zarr is not None and isinstance(source, tuple(filter(None, (_class(zarr, "Array"), _class(zarr, "Group")))))


def is_store(source: object) -> bool:
    """Returns whether `located` takes this: of zarr or fsspec, or an address."""
    return is_zarr(source) or _is_fsspec(source, "mapping", "FSMap") or _is_fsspec(source, "core", "OpenFile") or (
        is_address(source)
    )


def _is_fsspec(source: object, module: str, name: str) -> bool:
    of = _class(sys.modules.get(f"fsspec.{module}"), name)
    return of is not None and isinstance(source, of)


def _class(module: Any, name: str) -> type | None:
    found = getattr(module, name, None)
    return found if isinstance(found, type) else None


# ---- the path that the program opens


class Opener(Protocol):
    """What the program can do with an address by itself."""

    def can_open(self, address: str) -> bool:
        """Returns whether it reads the volume at this address where it is."""

    def copy(self, address: str, folder: pathlib.Path) -> pathlib.Path | None:
        """Copies one object into a folder; returns its file; None: it knows no such addresses."""


class Located:
    """A volume that the program can open.

    Attributes:
        path: file or folder, perhaps with a colon and an array behind it; or an address.
        is_copy: whether it is a copy, which goes when the client is closed.
        name: for the dataset.
    """

    def __init__(self, path: str, is_copy: bool, name: str = "") -> None:
        self.path = path
        self.is_copy = is_copy
        self.name = re.sub(r"[^A-Za-z0-9_-]", "-", name).strip("-") or "volume"


def located(source: Any, opener: Opener, scratch: Callable[[], pathlib.Path], progress: Progress) -> Located:
    """Returns where a source of `is_store` can be opened, and copies it if need be.

    Args:
        scratch: makes the folder of copies.

    Raises:
        InvalidArgumentError: there is no volume, or one that can't be copied.
        MissingPackageError: the address needs fsspec, or the package of its protocol.
    """
    if is_zarr(source):
        return _located_zarr(source, scratch, progress)
    if _is_fsspec(source, "mapping", "FSMap"):
        local = _local_folder(source.fs, source.root)
        if local is not None:
            return Located(local, False)
        return _copied_files(_Files(source.fs, source.root), scratch, progress)
    if _is_fsspec(source, "core", "OpenFile"):
        local = _local_folder(source.fs, source.path) if source.compression is None else None
        return Located(local, False) if local is not None else _copied_file(source, scratch, progress)
    return _located_address(str(source), opener, scratch, progress)


def _located_address(
    address: str, opener: Opener, scratch: Callable[[], pathlib.Path], progress: Progress
) -> Located:
    if address.startswith("file://"):
        path = re.sub("^localhost(?=/)", "", address[len("file://") :])
        return Located(path if os.path.exists(path) else urllib.parse.unquote(path), False)
    if opener.can_open(address):
        return Located(address, False)
    name = _shown(address)
    last = name.rstrip("/").rpartition("/")[2]
    is_store_of_zarr = (".zarr" in name or "." not in last) and not last.endswith(_ARCHIVES)
    if not is_store_of_zarr:
        copied = opener.copy(address, scratch() / "copy")
        if copied is not None:
            return Located(str(copied), True, _stem(copied.name))
    try:
        fsspec = importlib.import_module("fsspec")
        system, path = fsspec.core.url_to_fs(address)
    except ImportError as error:
        raise MissingPackageError(
            f"{name}: this address needs fsspec, and the package of its protocol (s3fs for s3, aiohttp for http): "
            f"{error}"
        ) from error
    except ValueError as error:
        raise InvalidArgumentError(f"{name}: {printable(str(error))}") from error
    if "*" in path:  # fsspec would open the first of the files
        raise InvalidArgumentError(
            f"{name}: a pattern of files at an address is not read: give one file, or copy them and give the pattern of "
            "the copies"
        )
    if is_store_of_zarr:
        files = _Files(system, path)
        if any(files.read(key) is not None for key in ("zarr.json", ".zgroup", ".zarray", ".zmetadata")):
            return _copied_files(files, scratch, progress)
    return _copied_file(fsspec.open(address), scratch, progress)


def _stem(path: str) -> str:
    return path.rstrip("/").rpartition("/")[2].partition(".")[0]


def _local_folder(system: Any, path: str) -> str | None:
    """Returns the path on this machine, if the file system of fsspec is that of the machine."""
    return str(path) if type(system).__name__ == "LocalFileSystem" else None


def _located_zarr(source: Any, scratch: Callable[[], pathlib.Path], progress: Progress) -> Located:
    store, path = source.store, str(source.path).strip("/")
    chunks = getattr(source, "chunk_store", None)
    separator = getattr(source, "_dimension_separator", None)
    of_chunks = store if chunks is None else chunks
    root = _local_root(of_chunks)
    if root is not None and (separator != "/" or _says_separator(pathlib.Path(root), path)):
        is_file = os.path.isfile(root)
        return Located(f"{root}:{path}" if is_file and path else os.path.join(root, path) if path else root, False)
    name = f"the zarr {type(source).__name__.lower()} {'/' + path!r}"
    objects: _Objects
    if hasattr(of_chunks, "__getitem__"):
        objects = _Mapping(name, of_chunks, store)
    else:
        objects = _Asynchronous(name, of_chunks)
    return _copied_store(objects, path, scratch, progress, _stem(path) or "array", separator)


def _local_root(store: Any) -> str | None:
    """Returns the folder or the ZIP of a store, if the program sees what zarr sees."""
    kind = type(store).__name__
    if kind in ("DirectoryStore", "NestedDirectoryStore", "TempStore"):
        return os.path.abspath(str(store.path))
    if kind == "LocalStore":
        return os.path.abspath(str(store.root))
    if kind in ("FSStore", "FsspecStore"):
        local = _local_folder(store.fs, store.path)
        return None if local is None else os.path.abspath(local)
    # One that is written has its directory only when it is closed.
    is_read = getattr(store, "mode", None) == "r" or getattr(store, "read_only", False)
    return os.path.abspath(str(store.path)) if kind == "ZipStore" and is_read else None


def _says_separator(root: pathlib.Path, path: str) -> bool:
    """Returns whether the metadata say the separator of keys, which a nested store may know by itself."""
    if not (root / path / ".zarray").is_file():
        return True  # zarr.json says it
    return "dimension_separator" in json.loads((root / path / ".zarray").read_bytes())


# ---- copies


def _copied_file(source: Any, scratch: Callable[[], pathlib.Path], progress: Progress) -> Located:
    """Copies a file of fsspec in blocks."""
    base = str(source.path).rstrip("/").rpartition("/")[2]
    if source.compression is not None:
        base = base.rpartition(".")[0] or base
    base = re.sub(r"[^A-Za-z0-9._-]", "-", base).lstrip(".") or "volume"
    path = scratch() / "copy" / base
    path.parent.mkdir(parents=True, exist_ok=True)
    name = _shown(source.path)
    try:
        count = 0
        with _explained(name, ""):
            expected = source.fs.info(source.path).get("size") if source.compression is None else None
            progress.total = int(expected or 0)
            with source as file, open(path, "wb") as out:
                while block := file.read(_BLOCK_BYTES):
                    count += out.write(block)
                    progress.add(len(block))
    except (FileNotFoundError, IsADirectoryError) as error:
        raise InvalidArgumentError(f"{name}: there is no such file") from error
    if expected is not None and count != expected:
        raise InvalidArgumentError(f"{name}: {count} bytes came, and the server says that it has {expected}")
    return Located(str(path), True, _stem(base))


def _copied_files(files: _Files, scratch: Callable[[], pathlib.Path], progress: Progress) -> Located:
    store, key = files.store()
    return _copied_store(store, key, scratch, progress, _stem(files.root))


def _copied_store(
    objects: _Objects,
    key: str,
    scratch: Callable[[], pathlib.Path],
    progress: Progress,
    name: str,
    separator: str | None = None,
) -> Located:
    """Copies the array or the group of this key."""
    folder = scratch() / "copy.zarr"
    arrays = _arrays_of(objects, key)
    groups = _above(key) if key in arrays else [*_above(key), key]
    for at, kind in itertools.product(groups, _METADATA[:3]):
        found = _metadata(objects, _joined(at, kind))
        if found is not None:
            # Those of arrays that are not copied would make volumes of fill values.
            found.pop("consolidated_metadata", None)
            _write(folder / at / kind, json.dumps(found).encode())
    if separator is not None:
        arrays = {one: metadata.with_separator(separator) for one, metadata in arrays.items()}
    # An array of an image gets its position from the shapes of all levels.
    image = key.rpartition("/")[0]
    for level in _levels(objects, _attributes(objects, image)) if key else []:
        at = _joined(image, level)
        other = None if at in arrays else _array_at(objects, at)
        if other is not None:
            _write_metadata(folder / at, other)
    progress.total = sum(array.chunk_count * array.chunk_bytes for array in arrays.values())
    with concurrent.futures.ThreadPoolExecutor(_COPIED_TOGETHER) as pool:
        for at, array in arrays.items():
            _write_metadata(folder / at, array)
            keys = array.chunk_keys()

            def copy(chunk: str, at: str = at) -> bool:
                return objects.copy(_joined(at, chunk), folder / at / chunk)

            # Few at a time, so that an interrupt ends it soon, and no list of all keys is made.
            while batch := list(itertools.islice(keys, 8 * _COPIED_TOGETHER)):
                for _ in pool.map(copy, batch):
                    progress.add(array.chunk_bytes)
    return Located(f"{folder}:{key}" if key else str(folder), True, name)


def _write_metadata(folder: pathlib.Path, array: _Array) -> None:
    for file, value in array.files.items():
        _write(folder / file, json.dumps(value).encode())


def _above(key: str) -> list[str]:
    """Returns the keys of the groups above, the root first."""
    parts = [one for one in key.split("/") if one]
    return ["/".join(parts[:count]) for count in range(len(parts))]


def _joined(*parts: str) -> str:
    return "/".join(filter(None, parts))


class _Array:
    """The metadata of one array."""

    def __init__(self, where: str, files: dict[str, Any]) -> None:
        self.where = where
        self.files = files
        main = files.get("zarr.json") or files[".zarray"]
        self._is_3 = "zarr.json" in files
        shape, chunk = main.get("shape"), main.get("chunks")
        if self._is_3:
            grid = main.get("chunk_grid") or {}
            if grid.get("name") != "regular":
                raise InvalidArgumentError(f"{where}: its chunk grid is {grid.get('name')!r}, must be 'regular'")
            chunk = (grid.get("configuration") or {}).get("chunk_shape")
        if not (_are_sides(shape, 0) and _are_sides(chunk, 1) and len(shape) == len(chunk)):
            raise InvalidArgumentError(
                f"{where}: the shape {shape!r} and that of chunks {chunk!r} are not those of an array"
            )
        self.shape: list[int] = shape
        self._grid = [-(-side // step) for side, step in zip(shape, chunk)]
        self.chunk_count = math.prod(self._grid)
        if self.chunk_count > _MOST_CHUNKS:
            raise InvalidArgumentError(f"{where}: it has {self.chunk_count} chunks; at most {_MOST_CHUNKS} are copied")
        digits = re.search(r"(\d+)$", str(main.get("dtype") or main.get("data_type")))
        # Of Zarr 2 bytes, of Zarr 3 bits: "<u2", "uint16". It is for the progress alone.
        item = int(digits[1]) if digits else 1
        self.chunk_bytes = math.prod(chunk) * max(1, item // 8 if self._is_3 else item)

    def with_separator(self, separator: str) -> _Array:
        """Returns it with a separator that Zarr 2 may leave to the store."""
        if self._is_3 or "dimension_separator" in self.files[".zarray"]:
            return self
        metadata = {**self.files[".zarray"], "dimension_separator": separator}
        return _Array(self.where, {**self.files, ".zarray": metadata})

    def dimensions(self) -> list[str]:
        """Returns the names of arrays with coordinates."""
        main = self.files.get("zarr.json") or {}
        attributes = main.get("attributes") if self._is_3 else self.files.get(".zattrs")
        attributes = attributes if isinstance(attributes, dict) else {}
        named = [*(main.get("dimension_names") or []), *(attributes.get("_ARRAY_DIMENSIONS") or [])]
        others = attributes.get("coordinates")
        named += others.split() if isinstance(others, str) else []
        return [one for one in dict.fromkeys(named) if isinstance(one, str) and _is_key(one)]

    def chunk_keys(self) -> Iterator[str]:
        """Yields the keys of all chunks below the array."""
        begin, separator = "", self.files.get(".zarray", {}).get("dimension_separator") or "."
        if self._is_3:
            encoding = self.files["zarr.json"].get("chunk_key_encoding") or {}
            kind = encoding.get("name")
            if kind not in ("default", "v2"):
                raise InvalidArgumentError(f"{self.where}: its keys are {kind!r}, must be 'default' or 'v2'")
            separator = (encoding.get("configuration") or {}).get("separator") or ("/" if kind == "default" else ".")
            begin = "c" if kind == "default" else ""
        if separator not in ("/", "."):
            raise InvalidArgumentError(f"{self.where}: the separator of its keys is {separator!r}, must be '/' or '.'")
        for place in itertools.product(*map(range, self._grid)):
            parts = ([begin] if begin else []) + list(map(str, place))
            yield separator.join(parts) or "0"


def _are_sides(sides: Any, least: int) -> bool:
    return isinstance(sides, list) and all(type(one) is int and one >= least for one in sides)


def _is_key(key: str) -> bool:
    return all(part not in ("", ".", "..") and part.isprintable() and "\\" not in part for part in key.split("/"))


def _metadata(objects: _Objects, key: str) -> dict[str, Any] | None:
    data = objects.read(key)
    if data is None:
        return None
    if len(data) > _MOST_METADATA_BYTES:
        raise InvalidArgumentError(
            f"{objects.name}: {key} has {len(data)} bytes; metadata have at most {_MOST_METADATA_BYTES}"
        )
    try:
        found = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise InvalidArgumentError(f"{objects.name}: {key} is no JSON: {printable(str(error))}") from error
    if not isinstance(found, dict):
        raise InvalidArgumentError(f"{objects.name}: {key} is no JSON object")
    return found


def _array_at(objects: _Objects, key: str) -> _Array | None:
    where = f"{objects.name}: the array {'/' + key!r}" if key else objects.name
    main = _metadata(objects, _joined(key, "zarr.json"))
    if main is not None:
        return _Array(where, {"zarr.json": main}) if main.get("node_type") == "array" else None
    main = _metadata(objects, _joined(key, ".zarray"))
    if main is None:
        return None
    attributes = _metadata(objects, _joined(key, ".zattrs"))
    return _Array(where, {".zarray": main} | ({} if attributes is None else {".zattrs": attributes}))


def _arrays_of(objects: _Objects, key: str) -> dict[str, _Array]:
    """Returns the arrays that make up the volume of a key: of an array, an image, or a group."""
    array = _array_at(objects, key)
    if array is not None:
        group = key.rpartition("/")[0]
        beside = [_joined(group, one) for one in array.dimensions()] if key else []
        found = {one: _array_at(objects, one) for one in beside if one != key}
        return {key: array} | {one: other for one, other in found.items() if other is not None}
    names = _levels(objects, _attributes(objects, key))[:1] or _names_in(objects, key)
    found = {_joined(key, one): _array_at(objects, _joined(key, one)) for one in names}
    arrays = {one: other for one, other in found.items() if other is not None}
    if not arrays:
        raise InvalidArgumentError(
            f"{objects.name}: there is no array of zarr" + (f" at {', '.join(map(repr, found))}" if found else "")
        )
    return arrays


def _attributes(objects: _Objects, key: str) -> dict[str, Any]:
    """Returns those of a group."""
    metadata = _metadata(objects, _joined(key, "zarr.json"))
    found = _metadata(objects, _joined(key, ".zattrs")) if metadata is None else metadata.get("attributes")
    return found if isinstance(found, dict) else {}


def _levels(objects: _Objects, attributes: Mapping[str, Any]) -> list[str]:
    """Returns the paths of the levels of an image of OME-Zarr, the finest first; empty: there is none."""
    ome = attributes.get("ome")
    images = (ome if isinstance(ome, dict) else attributes).get("multiscales")
    if images is None:
        return []
    try:
        paths = [level["path"] for level in images[0]["datasets"]]
    except (LookupError, TypeError) as error:
        raise InvalidArgumentError(f"{objects.name}: multiscales name no level: {str(images)[:200]!r}") from error
    for path in paths:
        if not isinstance(path, str) or not _is_key(path.strip("/")):
            raise InvalidArgumentError(
                f"{objects.name}: multiscales name the level {path!r}, which is no path below it"
            )
    return [path.strip("/") for path in paths[:_MOST_LEVELS]]


def _names_in(objects: _Objects, key: str) -> list[str]:
    """Returns the names in a group: by its consolidated metadata, else by a list of the store."""
    metadata = _metadata(objects, _joined(key, "zarr.json"))
    if metadata is not None:
        consolidated = (metadata.get("consolidated_metadata") or {}).get("metadata")
        names = list(consolidated) if isinstance(consolidated, dict) else None
    else:
        entries = (_metadata(objects, _joined(key, ".zmetadata")) or {}).get("metadata")
        ends = "/.zarray"
        names = (
            [one[: -len(ends)] for one in entries if one.endswith(ends)] if isinstance(entries, dict) else None
        )
    if names is None:
        try:
            names = list(objects.children(key))
        except FileNotFoundError as error:
            raise InvalidArgumentError(f"{objects.name}: there is no such store of zarr") from error
        except (OSError, NotImplementedError, ValueError) as error:
            raise InvalidArgumentError(
                f"{objects.name}: it can't be listed ({printable(str(error))}), and has no consolidated metadata: name "
                "an array in it"
            ) from error
    return [one for one in names if "/" not in one and _is_key(one) and one not in _METADATA]
