"""`isoscope.serve` of arrays of zarr, of mappers and files of fsspec, and of addresses."""

import contextlib
import functools
import http.server
import importlib
import importlib.util
import io
import json
import os
import re
import sys
import threading
import zipfile

import numpy as np
import pytest

import isoscope
import skips
from isoscope._serving import stores
from isoscope._serving.progress import Progress
from isoscope.errors import InvalidArgumentError, PermissionDeniedError, ProgramError, UnavailableError

VALUES = (np.indices((12, 14, 16)).sum(axis=0) * 100).astype(np.uint16)
ISOVALUE = 2000


def needs(name):
    if importlib.util.find_spec(name) is None:
        skips.skip("python", f"no {name} (python3-{name})")
    return importlib.import_module(name)


@pytest.fixture
def zarr():
    return needs("zarr")


@pytest.fixture
def memory():
    """The file system of fsspec in memory, empty."""
    needs("fsspec.implementations.memory" if importlib.util.find_spec("fsspec") else "fsspec")
    system = importlib.import_module("fsspec").filesystem("memory")
    system.store.clear()
    yield system
    system.store.clear()


@pytest.fixture(scope="module")
def picture(programs):
    """The picture of VALUES, with spacing 1."""
    with isoscope.serve(VALUES) as client:
        return client.dataset().render(ISOVALUE, size=48).png


def served(source, **how):
    """Returns dataset and picture of a source."""
    with isoscope.serve(source, **how) as client:
        dataset = client.dataset()
        return dataset, dataset.render(ISOVALUE, size=48).png


def in_memory(zarr, objects, key=""):
    """Returns an array or a group of a store in memory of zarr 2 or 3."""
    if hasattr(zarr, "DirectoryStore"):
        return zarr.open(dict(objects), mode="r", path=key or None)
    buffer = importlib.import_module("zarr.core.buffer.cpu").Buffer
    store = zarr.storage.MemoryStore({one: buffer.from_bytes(data) for one, data in objects.items()})
    return zarr.open(store, mode="r", path=key or None)


def objects_of(folder):
    """Returns the files below a folder by their keys."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def write_image(folder):
    """An image of OME-Zarr 0.4 with two levels and spacing (0.5, 1, 2), by hand: any version of zarr reads it."""
    for level, values in (("0", VALUES), ("1", VALUES[::2, ::2, ::2])):
        write_array(folder / level, values, (5, 6, 7), "/")
    (folder / ".zgroup").write_text('{"zarr_format": 2}')
    axes = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
    scales = [[2, 1, 0.5], [4, 2, 1]]
    levels = [
        {"path": str(level), "coordinateTransformations": [{"type": "scale", "scale": scale}]}
        for level, scale in enumerate(scales)
    ]
    images = {"multiscales": [{"version": "0.4", "axes": axes, "datasets": levels}]}
    (folder / ".zattrs").write_text(json.dumps(images))


def write_array(folder, values, chunk, separator=".", **attributes):
    """An array of Zarr 2 without compression; chunks of zeros are left out."""
    folder.mkdir(parents=True)
    metadata = {
        "zarr_format": 2, "shape": values.shape, "chunks": chunk, "dtype": values.dtype.str, "compressor": None,
        "filters": None, "fill_value": 0, "order": "C", "dimension_separator": separator,
    }  # fmt: skip
    (folder / ".zarray").write_text(json.dumps(metadata))
    if attributes:
        (folder / ".zattrs").write_text(json.dumps(attributes))
    for place in np.ndindex(*(-(-side // step) for side, step in zip(values.shape, chunk))):
        part = values[tuple(slice(at * step, (at + 1) * step) for at, step in zip(place, chunk))]
        whole = np.zeros(chunk, values.dtype)
        whole[tuple(map(slice, part.shape))] = part
        if whole.any():
            path = folder / separator.join(map(str, place))
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(whole.tobytes())


def write_variables(folder):
    """A group as xarray writes it: u(x, y, z) of spacing (0.5, 1, 2) and origin (10, 0, -3)."""
    write_array(folder / "u", VALUES.transpose(2, 1, 0), (7, 6, 5), _ARRAY_DIMENSIONS=["x", "y", "z"], units="K")
    for name, along in (("x", 10 + 0.5 * np.arange(16)), ("y", np.arange(14.0)), ("z", 2.0 * np.arange(12) - 3)):
        write_array(folder / name, along, (100,), _ARRAY_DIMENSIONS=[name])
    (folder / ".zgroup").write_text('{"zarr_format": 2}')
    (folder / ".zattrs").write_text("{}")
    metadata = {key: json.loads(data) for key, data in objects_of(folder).items() if "/.z" in f"/{key}"}
    (folder / ".zmetadata").write_text(json.dumps({"zarr_consolidated_format": 1, "metadata": metadata}))


# ---- arrays and groups of zarr


def test_an_array_in_a_folder_is_read_where_it_is(zarr, picture, tmp_path):
    write_array(tmp_path / "a.zarr", VALUES, (5, 6, 7), "/")
    (source,) = {stores.located(zarr.open(str(tmp_path / "a.zarr"), mode="r"), None, None, Progress()).path}
    assert source == str(tmp_path / "a.zarr")
    dataset, png = served(zarr.open(str(tmp_path / "a.zarr"), mode="r"))
    assert dataset.name == "a" and dataset.dtype == np.uint16 and png == picture
    # It is that of now, not that of the cache.
    array = zarr.open(str(tmp_path / "a.zarr"), mode="r+")
    array[2:4] = 7777
    assert served(array)[0].range == (0, 7777)


def test_an_array_in_memory_is_copied_as_it_is(zarr, picture):
    array = zarr.array(VALUES, chunks=(5, 6, 7))
    dataset, png = served(array)
    assert dataset.dtype == np.uint16 and png == picture
    dataset, png = served(array, spacing=(1, 2, 3), name="mine")
    assert dataset.name == "mine" and dataset.spacing == (1, 2, 3)


def test_nested_keys_that_only_the_store_knows_are_honoured(zarr, picture, tmp_path):
    if not hasattr(zarr, "NestedDirectoryStore"):
        return  # zarr 3 has no such stores
    zarr.array(VALUES, chunks=(5, 6, 7), store=zarr.NestedDirectoryStore(str(tmp_path / "n.zarr")))
    metadata = json.loads((tmp_path / "n.zarr" / ".zarray").read_text())
    del metadata["dimension_separator"]  # as zarr before 2.8 wrote it
    (tmp_path / "n.zarr" / ".zarray").write_text(json.dumps(metadata))
    array = zarr.open(zarr.NestedDirectoryStore(str(tmp_path / "n.zarr")), mode="r")
    assert (array[:] == VALUES).all() and served(array)[1] == picture


def test_a_zip_is_read_where_it_is_unless_it_is_being_written(zarr, picture, tmp_path):
    store_type = zarr.ZipStore if hasattr(zarr, "ZipStore") else zarr.storage.ZipStore
    path = str(tmp_path / "a.zip")
    store = store_type(path, mode="w")
    group = zarr.group(store=store)
    if hasattr(group, "create_array"):
        group.create_array("a", shape=VALUES.shape, chunks=(5, 6, 7), dtype="uint16")[:] = VALUES
    else:
        group.array("a", VALUES, chunks=(5, 6, 7))
    assert served(group["a"])[1] == picture  # its directory is written when it is closed
    store.close()
    store = store_type(path, mode="r")
    read = zarr.open(store, mode="r")["a"]
    assert stores.located(read, None, None, Progress()).path == f"{path}:a"
    assert served(read)[1] == picture
    store.close()


@pytest.mark.parametrize("where", ["folder", "memory", "mapper", "address"])
def test_an_image_has_the_positions_of_its_levels(zarr, memory, picture, tmp_path, where):
    write_image(tmp_path / "scan.zarr")
    for key, data in objects_of(tmp_path / "scan.zarr").items():
        memory.pipe_file(f"/scan.zarr/{key}", data)
    fsspec = needs("fsspec")
    objects = objects_of(tmp_path / "scan.zarr")
    sources = {
        "folder": lambda key: zarr.open(str(tmp_path / "scan.zarr"), mode="r", path=key or None),
        "memory": lambda key: in_memory(zarr, objects, key),
        "mapper": lambda key: fsspec.get_mapper(f"memory://scan.zarr/{key}".rstrip("/")),
        "address": lambda key: f"memory://scan.zarr/{key}".rstrip("/"),
    }
    for key, spacing, dims in (("", (0.5, 1, 2), (16, 14, 12)), ("0", (0.5, 1, 2), (16, 14, 12)), ("1", (1, 2, 4), (8, 7, 6))):
        dataset, _ = served(sources[where](key))
        assert (dataset.spacing, dataset.dims) == (spacing, dims)
    assert served(sources[where](""), spacing=(1, 1, 1))[1] == picture


@pytest.mark.parametrize("where", ["folder", "memory", "address", "array", "listed"])
def test_variables_have_the_order_and_the_positions_of_their_coordinates(zarr, memory, tmp_path, where):
    write_variables(tmp_path / "run.zarr")
    if where == "listed":
        (tmp_path / "run.zarr" / ".zmetadata").unlink()
    for key, data in objects_of(tmp_path / "run.zarr").items():
        memory.pipe_file(f"/run.zarr/{key}", data)
    mapper = needs("fsspec").get_mapper("memory://run.zarr")
    objects = objects_of(tmp_path / "run.zarr")
    source = {
        "folder": lambda: zarr.open(str(tmp_path / "run.zarr"), mode="r"),
        "memory": lambda: in_memory(zarr, objects),
        "address": lambda: "memory://run.zarr/u",
        "array": lambda: in_memory(zarr, objects)["u"],
        "listed": lambda: mapper,
    }[where]()
    surfaces = []
    for source, how in ((source, {}), (VALUES, {"spacing": (0.5, 1, 2), "origin": (10, 0, -3)})):
        with isoscope.serve(source, **how) as client:
            dataset = client.dataset()
            assert dataset.range == (0, 3900)
            mesh = dataset.mesh(ISOVALUE)
            surfaces.append([*mesh.points.min(axis=0), *mesh.points.max(axis=0), dataset.measure(ISOVALUE)[0].area])
    assert surfaces[0] == pytest.approx(surfaces[1], rel=1e-4)


def test_consolidated_metadata_are_read(zarr, tmp_path):
    write_variables(tmp_path / "run.zarr")
    objects = objects_of(tmp_path / "run.zarr")
    if hasattr(zarr, "DirectoryStore"):
        group = zarr.open_consolidated(objects, mode="r")
    else:
        group = in_memory(zarr, objects)
    for source in (group, group["u"]):
        found = stores.located(source, None, lambda: tmp_path / source.path / "scratch", Progress())
        files = objects_of(tmp_path / source.path / "scratch" / "copy.zarr")
        assert found.is_copy and {"u/.zarray", "u/.zattrs", "x/.zarray", "x/0", "u/2.2.2"} <= files.keys()
        assert json.loads(files["u/.zarray"])["shape"] == [16, 14, 12] and ".zmetadata" not in files


def test_a_dict_of_arrays_of_zarr_is_not_read_into_memory(zarr):
    with pytest.raises(InvalidArgumentError, match="the dict has 'p', a zarr.Array.*dask.array.from_zarr"):
        isoscope.serve({"p": zarr.array(VALUES)})


def test_a_store_itself_is_refused_with_what_opens_it(zarr):
    """It was taken for a dict of arrays, whose keys have types that are none of numbers."""
    store = {}
    zarr.array(VALUES, store=zarr.storage.KVStore(store), overwrite=True)
    with pytest.raises(InvalidArgumentError, match=r"a dict, a store of zarr: give zarr.open\(store\)"):
        isoscope.serve(store)


def test_what_a_store_says_itself_is_not_said_twice(zarr, programs):
    for source in (zarr.array(VALUES), "s3://bucket/not-asked.nrrd"):
        with pytest.raises(InvalidArgumentError, match="a file or a store has its own"):
            isoscope.serve(source, units="K")


# ---- what is copied


class Counted(dict):
    """A store that counts what is read of it."""

    def __init__(self, *values):
        super().__init__(*values)
        self.read = []

    def __getitem__(self, key):
        self.read.append(key)
        return super().__getitem__(key)


def copied(objects, key, tmp_path, **how):
    store = Counted(objects)
    told = []
    progress = Progress(lambda done, total: told.append((done, total)))
    source = stores._Mapping("the store", store, store)
    found = stores._copied_store(source, key, lambda: tmp_path / "scratch", progress, "name", **how)
    return found, objects_of(tmp_path / "scratch" / "copy.zarr"), store.read, told


def test_level_0_of_an_image_is_copied_and_nothing_else(tmp_path):
    write_image(tmp_path / "scan.zarr")
    objects = objects_of(tmp_path / "scan.zarr")
    found, files, read, told = copied(objects, "", tmp_path)
    assert found.path == str(tmp_path / "scratch" / "copy.zarr") and found.is_copy
    chunks = {key: data for key, data in objects.items() if re.match(r"0/\d", key)}
    assert {key: data for key, data in files.items() if "/.z" not in f"/{key}"} == chunks
    assert not any(re.match(r"1/\d", key) for key in read)
    assert told[-1] == (27 * 210 * 2, 27 * 210 * 2) and len(told) == 27
    # Of a level both have the metadata, and this one its chunks.
    found, files, read, _ = copied(objects, "1", tmp_path / "1")
    assert found.path.endswith("copy.zarr:1") and "0/.zarray" in files
    assert not any(re.match(r"0/\d", key) for key in [*files, *read])


def test_consolidated_metadata_of_arrays_that_are_not_copied_stay_behind(tmp_path):
    write_variables(tmp_path / "run.zarr")
    objects = objects_of(tmp_path / "run.zarr")
    _, files, _, _ = copied(objects, "", tmp_path)
    assert ".zmetadata" not in files and {"u/.zarray", "x/.zarray", "x/0", ".zgroup"} <= files.keys()
    group = {"zarr_format": 3, "node_type": "group", "consolidated_metadata": {"metadata": {"a": {}, "b": {}}}}
    array = {
        "zarr_format": 3, "node_type": "array", "shape": [3, 2, 2], "data_type": "uint16",
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [2, 2, 2]}},
        "chunk_key_encoding": {"name": "default"},
    }  # fmt: skip
    objects = {"zarr.json": json.dumps(group).encode(), "a/zarr.json": json.dumps(array).encode(), "a/c/1/0/0": b"x"}
    _, files, read, told = copied(objects, "", tmp_path / "3")
    assert json.loads(files["zarr.json"]) == {"zarr_format": 3, "node_type": "group"}
    assert files["a/c/1/0/0"] == b"x" and "a/c/0/0/0" not in files and "a/c/0/0/0" in read
    assert told == [(16, 32), (32, 32)]


@pytest.mark.parametrize(
    "encoding, expected",
    [
        ({"name": "default"}, ["c/0/0", "c/0/1"]),
        ({"name": "default", "configuration": {"separator": "."}}, ["c.0.0", "c.0.1"]),
        ({"name": "v2"}, ["0.0", "0.1"]), ({"name": "v2", "configuration": {"separator": "/"}}, ["0/0", "0/1"]),
    ],
)  # fmt: skip
def test_keys_of_chunks_are_those_of_the_metadata(encoding, expected):
    metadata = {
        "shape": [2, 3], "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [2, 2]}},
        "chunk_key_encoding": encoding, "data_type": "uint8",
    }  # fmt: skip
    assert list(stores._Array("a", {"zarr.json": metadata}).chunk_keys()) == expected


def changed(changes, **more):
    metadata = {"zarr_format": 2, "shape": [4, 4, 4], "chunks": [2, 2, 2], "dtype": "<u2"}
    return {".zarray": json.dumps({**metadata, **changes}).encode(), **more}


@pytest.mark.parametrize(
    "objects, words",
    [
        ({}, "there is no array of zarr"),
        ({".zarray": b"{"}, ".zarray is no JSON"), ({".zarray": b"[1]"}, ".zarray is no JSON object"),
        ({".zarray": b"[" * 100_000}, ".zarray is no JSON"), ({"zarr.json": b"\xff"}, "zarr.json is no JSON"),
        (changed({"shape": [4, 4]}), r"the shape \[4, 4\] and that of chunks \[2, 2, 2\]"),
        (changed({"shape": None}), "the shape None"), (changed({"chunks": [0, 2, 2]}), r"chunks \[0, 2, 2\]"),
        (changed({"shape": [True, 4, 4]}), "the shape"), (changed({"shape": [-4, 4, 4]}), "the shape"),
        (changed({"shape": [10**9] * 3}), "has 125000000000000000000000000 chunks; at most 10000000"),
        (changed({"dimension_separator": "/../../x/"}), "separator of its keys is '/../../x/'"),
        (changed({}, **{".zattrs": b"7"}), ".zattrs is no JSON object"),
        ({".zattrs": b'{"multiscales": 7}'}, "multiscales name no level"),
        ({".zattrs": b'{"multiscales": [{"datasets": [{"path": "../../x"}]}]}'}, r"the level '../../x', which is no path"),
        ({".zattrs": b'{"multiscales": [{"datasets": [{"path": 3}]}]}'}, "the level 3, which is no path"),
        ({"zarr.json": b'{"node_type": "array", "shape": [2], "chunk_grid": {"name": "rectilinear"}}'}, "'rectilinear'"),
        (
            {"zarr.json": b'{"node_type": "array", "shape": [2], "chunk_key_encoding": {"name": "x"}, "chunk_grid": '
             b'{"name": "regular", "configuration": {"chunk_shape": [2]}}}'},
            "its keys are 'x'",
        ),
    ],
)  # fmt: skip
def test_hostile_metadata_are_refused_by_name(tmp_path, objects, words):
    with pytest.raises(InvalidArgumentError, match=words):
        copied(objects, "", tmp_path)
    assert not (tmp_path / "x").exists() and set(os.listdir(tmp_path)) <= {"scratch"}


def test_names_that_leave_the_store_are_passed_over(tmp_path):
    array = {"zarr_format": 2, "shape": [2], "chunks": [2], "dtype": "<u2"}
    metadata = {"../evil/.zarray": array, "a/.zarray": array, "/abs/.zarray": array, "./.zarray": array}
    objects = {
        ".zmetadata": json.dumps({"metadata": metadata}).encode(), "a/.zarray": json.dumps(array).encode(),
        "../evil/.zarray": json.dumps(array).encode(), "a/0": b"1234", "../evil/0": b"1234",
    }  # fmt: skip
    _, files, _, _ = copied(objects, "", tmp_path)
    assert set(files) == {"a/.zarray", "a/0"} and not list(tmp_path.rglob("*evil*"))


def test_metadata_have_a_limit(monkeypatch, tmp_path):
    monkeypatch.setattr(stores, "_MOST_METADATA_BYTES", 10)
    with pytest.raises(InvalidArgumentError, match="the store: .zarray has .* bytes; metadata have at most 10"):
        copied(changed({}), "", tmp_path)


def test_an_error_of_a_store_is_no_missing_chunk(memory, tmp_path):
    class Failing:
        """A file system whose chunks can't be read."""

        def __init__(self, error):
            self.error = error

        def cat_file(self, path):
            return memory.cat_file(path)

        def get_file(self, path, local):
            raise self.error

    write_array(tmp_path / "a.zarr", VALUES, (5, 6, 7))
    for key, data in objects_of(tmp_path / "a.zarr").items():
        memory.pipe_file(f"/a.zarr/{key}", data)
    signed = OSError("HTTP 503 https://host/a.zarr/0.0.0?X-Amz-Signature=secret")
    for error, expected in ((signed, UnavailableError), (PermissionError("403"), PermissionDeniedError)):
        with pytest.raises(expected, match=r"/a.zarr: 0.0.0 can't be read: (OSError|PermissionError): ") as caught:
            stores._copied_files(stores._Files(Failing(error), "/a.zarr"), lambda: tmp_path / "scratch", Progress())
        assert "secret" not in str(caught.value)


# ---- mappers, files and addresses of fsspec


def test_a_file_of_fsspec_is_copied_in_blocks(memory, picture, tmp_path, monkeypatch):
    monkeypatch.setattr(stores, "_BLOCK_BYTES", 1000)
    fsspec = needs("fsspec")
    np.save(tmp_path / "v.npy", VALUES)
    memory.pipe_file("/dir/v.npy", (tmp_path / "v.npy").read_bytes())
    told = []
    dataset, png = served("memory://dir/v.npy", progress=lambda done, total: told.append((done, total)))
    size = (tmp_path / "v.npy").stat().st_size
    assert dataset.name == "v" and png == picture and told[-1] == (size, size) and len(told) == -(-size // 1000)
    assert served(fsspec.open("memory://dir/v.npy"))[1] == picture
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(tmp_path / "v.npy", "v.npy")
    memory.pipe_file("/dir/v.zip", packed.getvalue())
    assert served("zip://v.npy::memory://dir/v.zip")[1] == picture
    assert served(fsspec.open(str(tmp_path / "v.npy")))[1] == picture
    (tmp_path / "v w.npy").write_bytes((tmp_path / "v.npy").read_bytes())
    assert served((tmp_path / "v w.npy").as_uri())[1] == picture
    assert served(f"file://localhost{tmp_path}/v.npy")[1] == picture


def test_wrong_addresses_are_named(programs, memory):
    with pytest.raises(InvalidArgumentError, match="/dir/w.npy: there is no such file"):
        isoscope.serve("memory://dir/w.npy")
    with pytest.raises(InvalidArgumentError, match="nope://x.npy: Protocol not known"):
        isoscope.serve("nope://x.npy")
    with pytest.raises(InvalidArgumentError, match="w: there is no such file"):
        isoscope.serve("memory://w")
    with pytest.raises(InvalidArgumentError, match="/w.zarr: there is no such store"):
        isoscope.serve(needs("fsspec").get_mapper("memory://w.zarr"))
    # fsspec opens the first of several files.
    for name in "ab":
        memory.pipe_file(f"/steps/{name}.npy", b"")
    with pytest.raises(InvalidArgumentError, match="/steps/\\*.npy: a pattern"):
        isoscope.serve("memory://steps/*.npy")
    memory.pipe_file("/u.nrrd", b"NRRD0004\nno header")
    with pytest.raises(ProgramError, match="isoscope partition failed") as caught:
        isoscope.serve("memory://u.nrrd")
    assert "/tmp" not in str(caught.value)
    assert stores._shown("s3://user:pass@host/key?X-Amz-Signature=1") == "s3://host/key"


def test_a_file_that_ends_early_is_no_volume(memory, tmp_path, monkeypatch):
    fsspec = needs("fsspec")
    memory.pipe_file("/v.raw", b"12345678")
    info = type(memory).info
    monkeypatch.setattr(
        type(memory), "info", lambda self, path, **how: info(self, path, **how) | ({"size": 10} if path == "/v.raw" else {})
    )
    with pytest.raises(InvalidArgumentError, match="/v.raw: 8 bytes came, and the server says that it has 10"):
        stores.located(fsspec.open("memory://v.raw"), None, lambda: tmp_path, Progress())


def test_a_path_with_colons_is_a_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert stores.is_address("s3://bucket/key") and stores.is_address("simplecache::s3://bucket/key")
    assert stores.is_address("zip://v.npy::memory://v.zip")
    for path in ("volume.nii.gz", "C:/volume", "a::b", "run/s3://x", "scan.zarr:labels/cells", "a:b", ""):
        assert not stores.is_address(path), path
    (tmp_path / "s3:" / "bucket").mkdir(parents=True)
    assert not stores.is_address("s3://bucket")


class Handler(http.server.SimpleHTTPRequestHandler):
    """Files with ranges, and no lists of folders."""

    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def list_directory(self, path):
        self.send_error(404)

    def send_head(self):
        path = self.translate_path(self.path)
        wanted = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        if wanted is None or not os.path.isfile(path):
            return super().send_head()
        with open(path, "rb") as file:
            data = file.read()
        begin, end = int(wanted[1]), min(int(wanted[2] or len(data)), len(data) - 1)
        self.send_response(206)
        self.send_header("Content-Range", f"bytes {begin}-{end}/{len(data)}")
        self.send_header("Content-Length", str(end + 1 - begin))
        self.send_header("ETag", f'"{hash(data)}"')
        self.end_headers()
        return io.BytesIO(data[begin : end + 1])


@contextlib.contextmanager
def web_server(folder):
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def test_a_file_of_a_web_server_needs_no_fsspec(picture, tmp_path, monkeypatch):
    np.save(tmp_path / "v.npy", VALUES)
    with web_server(tmp_path) as address:
        monkeypatch.setitem(sys.modules, "fsspec", None)  # its import fails
        assert served(f"{address}/v.npy")[1] == picture
        with pytest.raises(ProgramError, match="w.npy"):
            isoscope.serve(f"{address}/w.npy")


def test_a_store_of_a_web_server_is_read_without_lists(picture, tmp_path):
    needs("fsspec")
    needs("aiohttp")
    write_image(tmp_path / "scan.zarr")
    with web_server(tmp_path) as address:
        for source in (f"{address}/scan.zarr", needs("fsspec").get_mapper(f"{address}/scan.zarr")):
            dataset, _ = served(source)
            assert dataset.spacing == (0.5, 1, 2) and dataset.dims == (16, 14, 12)
        assert served(f"{address}/scan.zarr", spacing=(1, 1, 1))[1] == picture
