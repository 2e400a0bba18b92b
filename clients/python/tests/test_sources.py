"""What `isoscope.serve` takes: arrays of numpy and dask, xarray by its coordinates; the rest is refused by its type."""

import collections
import errno
import importlib
import importlib.util
import re
import struct
import types
import warnings

import numpy as np
import pytest

import isoscope
import skips
from isoscope import _series_files
from isoscope._serving import netcdf_file, progress, samples
from isoscope._serving.netcdf_file import Variable
from isoscope.errors import InvalidArgumentError, ProgramError


def needs(name):
    if importlib.util.find_spec(name) is None:
        skips.skip("python", f"no {name} (python3-{name})")
    return importlib.import_module(name)


@pytest.fixture
def xarray():
    return needs("xarray")


@pytest.fixture
def dask_array():
    needs("dask")
    return importlib.import_module("dask.array")


# ---- what is no source


class Tensor:
    """An array of another package."""

    def __array__(self):
        return np.zeros((3, 3, 3))


@pytest.mark.parametrize(
    "source, words",
    [
        ([[[1, 2], [3, 4]]], "source is a list: .*numpy.asarray"), ((1, 2), "source is a tuple: .*numpy.asarray"),
        (Tensor(), "source is a test_sources.Tensor: .*numpy.asarray"),
        (None, "source is a NoneType"), (7, "source is a int"),
        (b"head.nii", "source is a bytes"),
    ],
)  # fmt: skip
def test_a_source_of_another_type_is_refused_with_what_is_taken(source, words):
    with pytest.raises(InvalidArgumentError, match=words) as caught:
        isoscope.serve(source)
    for taken in ("path", "address", "numpy or dask array", "dict", "xarray DataArray or Dataset", "zarr", "fsspec"):
        assert taken in str(caught.value)
    assert ("numpy.asarray" in str(caught.value)) == ("numpy.asarray" in words)


def test_masked_samples_are_not_taken_for_values(programs):
    masked = np.ma.masked_less(np.arange(27.0).reshape(3, 3, 3), 2)
    with pytest.raises(InvalidArgumentError, match="2 masked samples.*filled"):
        isoscope.serve(masked)
    with pytest.raises(InvalidArgumentError, match="field 'p' has 2 masked samples"):
        isoscope.serve({"p": masked})
    with isoscope.serve(np.ma.asarray(np.arange(27.0).reshape(3, 3, 3))) as client:
        assert client.dataset().range == (0, 26)


def test_masked_samples_of_dask_are_not_taken_for_values(dask_array, tmp_path):
    masked = np.ma.masked_less(np.arange(27.0).reshape(3, 3, 3), 2)
    with open(tmp_path / "samples", "wb") as file:
        with pytest.raises(InvalidArgumentError, match="2 masked samples.*filled"):
            samples.write_samples(file, dask_array.from_array(masked, chunks=2, asarray=False), np.dtype("<f8"))
    with open(tmp_path / "samples", "wb") as file:
        samples.write_samples(file, dask_array.from_array(masked[1:], chunks=2, asarray=False), np.dtype("<f8"))
    assert np.array_equal(np.fromfile(tmp_path / "samples", "<f8"), np.arange(9.0, 27.0))


# ---- parts of arrays


SHAPES = [(1,), (7,), (5, 4), (1, 6, 3), (3, 1, 2, 5), (4, 6, 5), (2, 3, 4, 5, 2)]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("limit", [1, 16, 40, 10_000])
def test_parts_follow_each_other_in_the_order_of_the_file(monkeypatch, tmp_path, shape, limit):
    monkeypatch.setattr(samples, "_PART_BYTES", limit)
    array = np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    with open(tmp_path / "samples", "w+b") as file:
        file.write(b"head")
        samples.write_samples(file, array, np.dtype(">i4"))
        file.write(b"tail")
    data = (tmp_path / "samples").read_bytes()
    assert data[:4] == b"head" and data[-4:] == b"tail"
    assert (np.frombuffer(data[4:-4], ">i4") == array.ravel()).all()


class Lazy:
    """An array whose chunks are counted."""

    def __init__(self, array, chunks, dtype=None):
        self.shape, self.dtype, self.chunks = array.shape, array.dtype if dtype is None else np.dtype(dtype), chunks
        self.array, self.counts, self.most = array, np.zeros(array.shape, int), 0

    def compute(self, indices):
        self.most = max(self.most, sum(self.array[index].nbytes for index in indices))
        for index in indices:
            self.counts[index] += 1
        return [self.array[index] for index in indices]


def random_chunks(rng, side):
    ends = sorted({side, *rng.integers(1, side + 1, 3).tolist()})
    return np.diff([0, *ends]).tolist()


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("mode", ["wb", "w+b"])  # a file that is not read can't be mapped
@pytest.mark.parametrize("run_bytes", [0, 12, 1 << 20])
def test_chunks_land_at_their_places_each_computed_once_few_at_a_time(monkeypatch, tmp_path, shape, mode, run_bytes):
    monkeypatch.setattr(samples, "_RUN_BYTES", run_bytes)
    rng = np.random.default_rng(len(shape) + run_bytes)
    array = rng.integers(0, 1000, shape).astype(np.int16)
    for batch_bytes in (1, 50, 10_000):
        monkeypatch.setattr(samples, "_BATCH_BYTES", batch_bytes)
        chunks = [random_chunks(rng, side) for side in shape]
        lazy = Lazy(array, chunks)
        with open(tmp_path / "samples", mode) as file:
            file.write(b"head")
            samples.write_samples(file, lazy, np.dtype(">f4"))
            file.write(b"tail")
        data = (tmp_path / "samples").read_bytes()
        assert data[:4] == b"head" and data[-4:] == b"tail" and (lazy.counts == 1).all()
        assert (np.frombuffer(data[4:-4], ">f4") == array.ravel()).all()
        largest = 2 * np.prod([max(sizes) for sizes in chunks])
        assert lazy.most <= max(batch_bytes, largest)


def test_runs_beyond_a_page_land_through_maps(tmp_path):
    array = np.random.default_rng(8).integers(0, 255, (5, 70, 3000), np.uint8)
    lazy = Lazy(array, [[2, 3], [33, 37], [1000, 700, 1300]])
    with open(tmp_path / "samples", "w+b") as file:
        file.write(b"x" * 4097)
        samples.write_samples(file, lazy, np.dtype("u1"))
    assert np.array_equal(np.fromfile(tmp_path / "samples", "u1", offset=4097), array.ravel())


def test_a_chunk_of_another_type_or_shape_than_the_array_says_is_refused(tmp_path):
    array = np.zeros((2, 3, 4))
    with open(tmp_path / "samples", "w+b") as file:
        with pytest.raises(InvalidArgumentError, match=r"samples \[0:2, 0:3, 0:4\] are of float64.*it is of int16.*dtype"):
            samples.write_samples(file, Lazy(array, [[2], [3], [4]], "int16"), np.dtype("<i2"))
        wrong = Lazy(array, [[2], [3], [4]])
        wrong.shape, wrong.chunks = (2, 3, 5), [[2], [3], [5]]
        with pytest.raises(InvalidArgumentError, match=r"have the shape \(2, 3, 4\), .* promises \(2, 3, 5\)"):
            samples.write_samples(file, wrong, np.dtype("<f8"))


def test_samples_beyond_the_disk_take_nothing_of_it(monkeypatch, tmp_path):
    """Some file systems take all that is left before they refuse, and other programs fail meanwhile."""
    # Blocks that the disk keeps for root are no room.
    disk = types.SimpleNamespace(f_bfree=9, f_bavail=2, f_frsize=50, f_blocks=10)
    monkeypatch.setattr(samples.os, "statvfs", lambda folder: disk)
    monkeypatch.setattr(samples.os, "posix_fallocate", lambda *_: pytest.fail("the disk was asked"))
    lazy = Lazy(np.zeros((2, 3, 4)), [[2], [3], [4]])
    with open(tmp_path / "samples", "w+b") as file:
        with pytest.raises(isoscope.ResourceExhaustedError, match=f"192 bytes .* {tmp_path}: 100 bytes are free.*TMPDIR"):
            samples.write_samples(file, lazy, np.dtype("<f8"))
    two = {"u": lazy.array[:, :, :2], "v": lazy.array[:, :, :2]}  # each of them has room
    with pytest.raises(isoscope.ResourceExhaustedError, match="192 bytes"):
        _series_files.write(_series_files.as_series(two, None, False), tmp_path)
    with pytest.raises(isoscope.ResourceExhaustedError, match="192 bytes"):
        netcdf_file.write(tmp_path / "u.nc", {"x": 12}, [Variable(name, ("x",), np.zeros(12)) for name in "uv"])


def test_samples_without_room_are_refused_before_they_are_computed(monkeypatch, tmp_path):
    def full(descriptor, begin, size):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(samples.os, "posix_fallocate", full)
    lazy = Lazy(np.zeros((2, 3, 4)), [[2], [3], [4]])
    with open(tmp_path / "samples", "w+b") as file:
        with pytest.raises(isoscope.ResourceExhaustedError, match=f"192 bytes .* {tmp_path}: No space.*TMPDIR"):
            samples.write_samples(file, lazy, np.dtype("<f8"))
    assert not lazy.counts.any()


def test_a_file_system_that_reserves_nothing_is_written_without_maps(monkeypatch, tmp_path):
    def unknown(descriptor, begin, size):
        raise OSError(errno.EOPNOTSUPP, "Operation not supported")

    monkeypatch.setattr(samples.os, "posix_fallocate", unknown)
    monkeypatch.setattr(samples, "_map_planes", None)
    array = np.arange(60).reshape(3, 4, 5)
    with open(tmp_path / "samples", "w+b") as file:
        samples.write_samples(file, Lazy(array, [[3], [2, 2], [3, 2]]), np.dtype("<i8"))
    assert np.array_equal(np.fromfile(tmp_path / "samples", "<i8"), array.ravel())


@pytest.mark.parametrize(
    "shape, chunk, expected",
    [
        ((10, 10, 10), (1, 1, 1), [[1] * 10, [10], [10]]),  # a part has up to 100 samples
        ((4, 10, 5), (1, 1, 1), [[2, 2], [10], [5]]),
        ((4, 10, 50), (1, 1, 1), [[1] * 4, [2] * 5, [50]]),
        ((8, 8, 8), (4, 4, 4), [[4, 4], [4, 4], [4, 4]]),
        ((8, 8, 8), (2, 4, 4), [[2] * 4, [4, 4], [8]]),
        ((9, 9, 9), (5, 5, 5), [[5, 4], [5, 4], [5, 4]]),
        ((3, 3), (100, 100), [[3], [3]]),
        ((0, 3), (2, 2), [[], [3]]),
    ],
)  # fmt: skip
def test_parts_of_a_store_are_whole_chunks(monkeypatch, shape, chunk, expected):
    monkeypatch.setattr(samples, "_PART_BYTES", 200)
    assert samples.whole_chunks(shape, chunk, 2) == expected


def test_a_chunk_of_dask_is_computed_once(dask_array, monkeypatch, tmp_path):
    monkeypatch.setattr(samples, "_PART_BYTES", 8)
    counts = collections.Counter()

    def block(block_info=None):
        (place,) = [info["chunk-location"] for info in block_info.values() if info]
        counts[place] += 1
        return np.full((1, 2, 3), sum(place), np.int16)

    array = dask_array.map_blocks(
        block, chunks=((1, 1), (2, 2, 2), (3, 3)), dtype=np.int16, meta=np.zeros((0, 0, 0), np.int16)
    )
    with open(tmp_path / "samples", "wb") as file:
        samples.write_samples(file, array, np.dtype("<i2"))
    assert counts and set(counts.values()) == {1}
    read = np.fromfile(tmp_path / "samples", "<i2").reshape(2, 6, 6)
    assert read[1, 5, 5] == 4 and read[0, 0, 0] == 0


def test_an_array_of_dask_is_served_as_that_of_numpy(programs, dask_array):
    array = np.random.default_rng(3).random((9, 10, 11), np.float32)
    lazy = dask_array.from_array(array, chunks=(4, 5, 11))
    with isoscope.serve(lazy, spacing=(1, 2, 3)) as ours, isoscope.serve(array, spacing=(1, 2, 3)) as theirs:
        assert ours.dataset().render(0.5, size=48).png == theirs.dataset().render(0.5, size=48).png
    series = {"p": dask_array.stack([lazy, lazy + 1]), "mask": dask_array.stack([lazy, lazy]) > 0.5}
    with isoscope.serve(series, times=[0, 1]) as client:
        dataset = client.dataset()
        assert [field.name for field in dataset.fields] == ["p", "mask"]
        assert dataset.field("p").range == pytest.approx((array.min(), array.max() + 1))
        assert dataset.field("mask").range == (0, 1)


# ---- the file that xarray becomes


def test_a_netcdf_file_has_the_bytes_of_its_format(tmp_path):
    numbers = np.arange(3, dtype=np.int16)
    variable = Variable("u", ("x",), numbers, {"units": "m/s", "_FillValue": np.float32(-1)})
    netcdf_file.write(tmp_path / "u.nc", {"x": 3}, [variable])

    def text(data):
        return struct.pack(">q", len(data)) + data + b"\0" * (-len(data) % 4)

    head = (
        b"CDF\5" + struct.pack(">q", 0)
        + struct.pack(">iq", 10, 1) + text(b"x") + struct.pack(">q", 3)
        + struct.pack(">iq", 0, 0)
        + struct.pack(">iq", 11, 1) + text(b"u") + struct.pack(">qq", 1, 0)
        + struct.pack(">iq", 12, 2) + text(b"units") + struct.pack(">i", 2) + text(b"m/s")
        + text(b"_FillValue") + struct.pack(">iqf", 5, 1, -1)
        + struct.pack(">iq", 3, 8)
    )  # fmt: skip
    data = (tmp_path / "u.nc").read_bytes()
    assert data == head + struct.pack(">q", len(head) + 8) + struct.pack(">3h", 0, 1, 2) + b"\0\0"


def ramps(xarray, dims, coordinates):
    """A Dataset of float32 with a field for each dimension, whose values are the coordinates along it."""
    shape = [len(coordinates[dim]) for dim in dims]
    fields = {}
    for dim in dims:
        along = np.asarray(coordinates[dim], np.float32).reshape([-1 if one == dim else 1 for one in dims])
        fields[f"along_{dim}"] = (dims, np.array(np.broadcast_to(along, shape)))
    return xarray.Dataset(fields, coords=coordinates)


X, Y, Z = np.arange(10.0, 18, 2), np.array([5.0, 4.5, 4, 3.5, 3]), np.arange(100.0, 106)
ENDS = {"x": (10, 16), "y": (3, 5), "z": (100, 105)}


@pytest.mark.parametrize("dims", [("z", "y", "x"), ("x", "y", "z"), ("y", "z", "x")])
def test_samples_lie_where_their_coordinates_say_in_any_order(programs, xarray, dims):
    source = ramps(xarray, dims, {"x": X, "y": Y, "z": Z})
    with isoscope.serve(source) as client:
        dataset = client.dataset("array")
        assert dataset.dims == source.along_x.shape[::-1] and dataset.dtype == np.float32
        for along, value in {"x": 13, "y": 4.25, "z": 102.5}.items():
            points = dataset.mesh(value, field=f"along_{along}").points
            for axis, name in enumerate("xyz"):
                expected = (value, value) if name == along else ENDS[name]
                assert (points[:, axis].min(), points[:, axis].max()) == pytest.approx(expected, abs=1e-4), (along, name)


def test_names_do_not_matter_where_attributes_tell_the_axes(programs, xarray):
    coordinates = {
        "level": ("level", [0.0, 10, 20], {"standard_name": "depth", "units": "m"}),
        "j": ("j", [40.0, 41, 42, 43], {"units": "degrees_north"}),
        "i": ("i", [-3.0, -2.5, -2, -1.5, -1], {"axis": "X"}),
    }
    array = xarray.DataArray(np.zeros((5, 3, 4), np.float32), dims=("i", "level", "j"), coords=coordinates)
    array += xarray.DataArray(np.arange(3, dtype=np.float32), dims="level")
    with isoscope.serve(array) as client:
        points = client.dataset().mesh(0.5).points
    # Depth counts down, so z is its negative.
    assert points.min(axis=0) == pytest.approx([-3, 40, -5]) and points.max(axis=0) == pytest.approx([-1, 43, -5])


def test_a_dataset_has_fields_units_times_and_vectors(programs, xarray):
    times = np.array(["2000-01-01T00", "2000-01-01T06", "2000-01-01T12"], "datetime64[ns]")
    shape = (3, 4, 5, 6)
    level = np.broadcast_to(np.arange(3, dtype=np.float64).reshape(3, 1, 1, 1), shape)
    velocity = np.zeros((*shape, 3), np.float32)
    velocity[..., 0] = 3
    velocity[..., 1] = 4
    source = xarray.Dataset(
        {
            "t": (("time", "z", "y", "x"), np.array(level), {"units": "K", "long_name": "Temperature"}),
            "v": (("time", "z", "y", "x", "part"), velocity, {"units": "m/s"}),
            "surface": (("y", "x"), np.zeros((5, 6))),
        },
        coords={
            "time": times, "z": ("z", np.arange(4.0), {"units": "m"}), "y": ("y", np.arange(5.0), {"units": "m"}),
            "x": ("x", np.arange(6) * 1.5, {"units": "m"}), "part": ["u", "v", "w"],
        },
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        client = isoscope.serve(source, vectors=["v"])
    with client:
        flow = client.dataset()
        assert [(field.name, field.unit) for field in flow.fields] == [("t", "K"), ("v", "m/s")]
        assert flow.field("t").long_name == "Temperature" and flow.field("t").range == (0, 2)
        assert [one.name for one in flow.field("v").components] == ["x", "y", "z", "magnitude"]
        assert flow.field("v").range == pytest.approx((5, 5))
        assert flow.times.tolist() == [0, 6, 12] and flow.time_unit.startswith("hours since 2000-01-01")
        assert flow.length_unit == "m" and flow.spacing == (1.5, 1, 1)


def test_uneven_coordinates_are_refused_by_name_or_resampled(programs, xarray):
    array = ramps(xarray, ("z", "y", "x"), {"z": [0, 1, 2, 5], "y": Y, "x": X})["along_z"].rename("u")
    with pytest.raises(ProgramError, match='u: axis "z" is not even: its coordinate .*resample=True') as caught:
        isoscope.serve(array)
    assert "/tmp" not in str(caught.value) and "--resample" not in str(caught.value)
    with isoscope.serve(array, resample=True) as client:
        points = client.dataset().mesh(3.5).points
    assert points[:, 2] == pytest.approx(3.5, abs=1e-4)


@pytest.mark.parametrize(
    "dim, coordinates, words",
    [
        ("x", [0, 1, np.nan, 3, 4], 'axis "x": its coordinate 2 of 5 is missing'),
        ("x", [0, 1, 1, 2, 3], 'axis "x" has the coordinate 1 behind 1'),
        ("x", [7] * 5, 'axis "x" begins and ends at 7'),
        ("y", [0.0, 1, 2, 3.01], 'axis "y" is not even'),
        ("x", np.arange(5).astype("datetime64[s]").astype("datetime64[ns]"), r"its axes are .*x \(T, 5\)"),
        ("time", [3.0, 2.0], 'time axis "time" has 2 at index 1, behind 3'),
        ("time", np.array(["2000-01-01", "NaT"], "datetime64[ns]"), 'time axis "time" has .* at index 1'),
    ],
)  # fmt: skip
def test_coordinates_that_are_no_positions_are_refused_by_name(programs, xarray, dim, coordinates, words):
    array = xarray.DataArray(np.zeros((2, 3, 4, 5), np.float32), dims=("time", "z", "y", "x"), name="u")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # xarray casts NaT
        with pytest.raises(ProgramError, match=words):
            isoscope.serve(array.assign_coords({dim: coordinates}))


def test_dimensions_that_nothing_explains_are_named_and_can_be_told(programs, xarray):
    array = xarray.DataArray(np.zeros((2, 3, 4, 5), np.float32), dims=("run", "z", "y", "x"), name="u")
    with pytest.raises(ProgramError, match="run"):
        isoscope.serve(array)
    with pytest.raises(ProgramError, match="as in axes='ZCTYX'$") as caught:
        isoscope.serve(array.rename(z="time", run="number").expand_dims(z=4))
    assert "--" not in str(caught.value) and "`" not in str(caught.value)
    with isoscope.serve(array, axes="TZYX") as client:
        assert client.dataset().times.tolist() == [0, 1] and client.dataset().dims == (5, 4, 3)


def test_variables_of_another_grid_are_told(programs, xarray):
    zeros = np.zeros((4, 4, 4), np.float32)
    on_grid = (("z", "y", "x"), zeros)
    source = xarray.Dataset({"u": on_grid, "v": on_grid, "w": (("zw", "y", "x"), zeros[:3])})
    with pytest.warns(UserWarning, match="not served: 'w', of another grid than 'u', 'v'"):
        client = isoscope.serve(source)
    with client:
        assert [field.name for field in client.dataset().fields] == ["u", "v"]
    with pytest.warns(UserWarning, match="'w'"):
        isoscope.serve(source[["u", "w"]]).close()


def field_and_coordinates():
    """array[z, y, x] with a hole, and its coordinates: spacing (0.5, 0.25, 2), origin (10, 5, -3)."""
    z, y, x = np.mgrid[0:12, 0:14, 0:16]
    values = np.sin(z / 3) + np.cos(y / 4) + np.sin(x / 5) + 3
    return values, {"x": 10 + 0.5 * np.arange(16), "y": 5 + 0.25 * np.arange(14), "z": 2.0 * np.arange(12) - 3}


@pytest.mark.parametrize("dtype", ["uint8", "int16", "uint16", "int32", "int64", "float16", "float32", "float64"])
def test_pictures_of_a_dataarray_are_those_of_its_array(programs, xarray, dtype):
    values, coordinates = field_and_coordinates()
    values = (values * 40).astype(dtype)
    if dtype[0] == "f":
        values[5, 6, 7] = np.nan
    array = xarray.DataArray(values, dims=("z", "y", "x"), coords=coordinates)
    grid = {"spacing": (0.5, 0.25, 2), "origin": (10, 5, -3)}
    pictures = []
    for source, how in ((values, grid), (array, {}), (array.chunk({"z": 5, "x": 7}), {})):
        with isoscope.serve(source, **how) as client:
            dataset = client.dataset()
            assert (dataset.spacing, dataset.origin) == ((0.5, 0.25, 2), (10, 5, -3))
            pictures.append(dataset.render(120, size=64).png)
    assert len(set(pictures)) == 1


def test_a_dataarray_that_is_turned_has_the_same_surface(programs, xarray):
    values, coordinates = field_and_coordinates()
    array = xarray.DataArray(values, dims=("z", "y", "x"), coords=coordinates)
    surfaces = []
    for source in (array, array.transpose("x", "z", "y"), array.isel(y=slice(None, None, -1), x=slice(None, None, -1))):
        with isoscope.serve(source) as client:
            mesh = client.dataset().mesh(3)
            # Where the surface is, and which side is the larger one.
            box = [*mesh.points.min(axis=0), *mesh.points.max(axis=0), *mesh.normals.mean(axis=0)]
            surfaces.append([*box, client.dataset().measure(3)[0].area])
    assert surfaces[1] == pytest.approx(surfaces[0], rel=1e-2, abs=0.02)
    assert surfaces[2] == pytest.approx(surfaces[0], rel=1e-2, abs=0.02)


@pytest.mark.parametrize(
    "dtype, values", [("int16", [-32767, 32767]), ("uint16", [0, 65535]), ("int32", [-2147483647, 2147483647]),
                      ("uint32", [0, 4294967295]), ("int8", [-127, 127]), ("uint8", [0, 255]),
                      ("float32", [0, 9.969209968386869e36]), ("float64", [0, 9.969209968386869e36])],
)  # fmt: skip
def test_no_sample_of_a_dataarray_is_taken_for_one_that_nobody_wrote(programs, xarray, dtype, values):
    """These are the default fill values of netCDF, which are holes in files."""
    array = np.full((4, 4, 4), 1, dtype)
    array[1, 1, 1:3] = values
    with isoscope.serve(xarray.DataArray(array, dims=("z", "y", "x"))) as client:
        assert client.dataset().range == (array.min(), array.max())
        assert client.dataset().histogram().nan_count == 0
    if dtype == "int16":
        packed = xarray.DataArray(array, dims=("z", "y", "x"), attrs={"_FillValue": np.int16(32767)})
        with isoscope.serve(packed) as client:
            assert client.dataset().range == (-32767, 1) and client.dataset().histogram().nan_count == 1


@pytest.mark.parametrize("dtype", ["datetime64[ns]", "timedelta64[ns]", "complex64", "U3", "object"])
def test_samples_of_other_types_are_refused_with_their_type(xarray, tmp_path, dtype):
    array = np.zeros((3, 3, 3), dtype)
    shown = array.dtype
    with pytest.raises(InvalidArgumentError, match="variable 'u' is of .*astype.*drop_vars") as caught:
        write(xarray.DataArray(array, dims=("z", "y", "x"), name="u"), tmp_path)
    assert str(shown) in str(caught.value)


def test_limits_of_packed_values_do_not_hide_those_of_a_mean(programs, xarray):
    """xarray keeps the limits, of integers, and forgets how the values were packed."""
    values = np.linspace(-1, 4, 27, dtype=np.float32).reshape(3, 3, 3)
    array = xarray.DataArray(values, dims=("z", "y", "x"), attrs={"valid_range": np.array([0, 100], np.int16)})
    with isoscope.serve(array) as client:
        assert client.dataset().range == (-1, 4)
    array.encoding["dtype"] = np.dtype("int16")  # as they were stored, but for a fill value
    with isoscope.serve(array) as client:
        assert client.dataset().range[0] >= 0
    array.attrs["valid_range"], array.encoding = [0.5, 3.0], {}
    with isoscope.serve(array) as client:
        assert 0.5 <= client.dataset().range[0] and client.dataset().range[1] <= 3


def test_open_files_of_other_packages_are_not_read_into_memory(tmp_path):
    h5py = needs("h5py")
    with h5py.File(tmp_path / "u.h5", "w") as file:
        file["u"] = np.zeros((3, 3, 3))
        for source in (file, file["u"]):
            with pytest.raises(InvalidArgumentError, match=r"source is a h5py\..*by its path.*'run.h5:p'"):
                isoscope.serve(source)


@pytest.mark.parametrize(
    "dtype, words", [([("a", "f4"), ("b", "f4")], r"\{'a': array\['a'\]\}"), (complex, r"abs\(array\)")]
)
def test_types_of_several_numbers_are_refused_with_how_to_serve_one(programs, dtype, words):
    array = np.zeros((3, 3, 3), dtype)
    for source in (array, {"u": array}):
        with pytest.raises(InvalidArgumentError, match=words):
            isoscope.serve(source)


@pytest.mark.parametrize("dtype", ["datetime64[ns]", "U3", "longdouble"])
def test_arrays_of_other_types_are_refused_with_their_type(programs, dtype):
    array = np.zeros((3, 3, 3), dtype)
    for source in (array, {"u": array}):
        with pytest.raises(InvalidArgumentError, match=f"of {re.escape(array.dtype.name)}: must be one of .*float32.*astype"):
            isoscope.serve(source)


def test_integers_of_64_bits_and_halfs_are_served(programs):
    array = np.arange(60).reshape(3, 4, 5) - 7
    with isoscope.serve(array, spacing=(1, 2, 3)) as client:
        assert client.dataset().range == (-7, 52) and client.dataset().spacing == (1, 2, 3)
    with isoscope.serve(array.astype(np.float16)) as client:
        assert client.dataset().range == (-7, 52) and client.dataset().dtype == np.float32


def test_parts_of_an_array_that_was_opened_lazily_are_whole_chunks(xarray, tmp_path):
    from isoscope._serving.xarray_source import _Samples

    needs("zarr")
    zeros = np.zeros((20, 30, 40), np.int16)
    xarray.Dataset({"u": (("z", "y", "x"), zeros)}).to_zarr(
        tmp_path / "u.zarr", encoding={"u": {"chunks": (8, 16, 32)}}
    )
    opened = xarray.open_zarr(tmp_path / "u.zarr", chunks=None)
    assert [sizes[0] for sizes in _Samples(opened.u.variable).chunks] == [20, 30, 40]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples, "_PART_BYTES", 8 * 16 * 32 * 2)
        for array in (opened.u, opened.u.transpose("x", "y", "z")):
            whole = {dim: sizes[0] for dim, sizes in zip(array.dims, _Samples(array.variable).chunks)}
            assert whole == {"z": 8, "y": 16, "x": 32}
        assert _Samples(opened.u.load().variable).compute([(slice(0, 2),) * 3])[0].shape == (2, 2, 2)


def test_progress_is_told(programs, xarray, dask_array, capsys, monkeypatch):
    told = []
    array = dask_array.zeros((6, 7, 8), chunks=(2, 7, 4), dtype=np.int16)
    isoscope.serve(array, progress=lambda done, total: told.append((done, total))).close()
    assert told == [(112 * count, 672) for count in range(1, 7)]
    for source in ({"p": array, "q": array}, xarray.DataArray(array, dims=("z", "y", "x"))):
        told.clear()
        isoscope.serve(source, progress=lambda done, total: told.append((done, total))).close()
        assert told[-1] == (1344, 1344) and [done for done, _ in told] == sorted(done for done, _ in told)
    assert capsys.readouterr().err == ""


def test_a_line_of_progress_is_shown_and_taken_away(capsys, monkeypatch):
    monkeypatch.setattr(progress, "_QUIET_SECONDS", 0)
    monkeypatch.setattr(progress, "_BETWEEN_SECONDS", 0)
    line = progress.Progress(True, "writing the samples", 4 << 20)
    line.add(1 << 20)
    line.add(2 << 20)
    line.close()
    line.close()
    shown = capsys.readouterr().err.split("\r")
    assert shown[1].startswith("isoscope: writing the samples [#####               ]  25% of 4.0 MiB, about ")
    assert "75%" in shown[2] and shown[3].strip() == "" and len(shown[3]) >= len(shown[2].rstrip()) and shown[4] == ""
    # Nobody sees a line in a file, unless it is asked for.
    unseen = progress.Progress(None, "writing", 100)
    unseen.add(50)
    unseen.close()
    unknown = progress.Progress(True, "fetching")
    unknown.add(3 << 20)
    assert capsys.readouterr().err == "\risoscope: fetching: 3.0 MiB"


TYPES = ("bool", "uint8", "int8", "uint16", "int16", "uint32", "int32", "int64", "float16", "float32", "float64")


def test_types_keep_their_values(programs, xarray):
    fields, ranges = {}, {}
    for dtype in TYPES:
        values = (np.arange(64) % 2 if dtype == "bool" else np.arange(64)).astype(dtype).reshape(4, 4, 4)
        values = values - values.dtype.type(20) if dtype[0] in "if" else values
        fields[dtype] = (("z", "y", "x"), values)
        ranges[dtype] = (values.min(), values.max())
    with isoscope.serve(xarray.Dataset(fields)) as client:
        assert {field.name: field.range for field in client.dataset().fields} == ranges


def test_an_xarray_of_dask_is_served(programs, xarray, dask_array):
    values = np.random.default_rng(5).random((3, 8, 9, 10), np.float32)
    dims = ("time", "z", "y", "x")
    lazy = xarray.DataArray(dask_array.from_array(values, chunks=(1, 3, 9, 10)), dims=dims)
    with isoscope.serve(lazy) as ours, isoscope.serve(xarray.DataArray(values, dims=dims)) as theirs:
        pictures = [one.dataset().render(0.5, step=1, size=48).png for one in (ours, theirs)]
    assert pictures[0] == pictures[1]


def write(source, tmp_path, **how):
    from isoscope._serving import xarray_source

    return xarray_source.write(source, tmp_path / "source.nc", **how)


def test_wrong_xarrays_are_named(xarray, tmp_path):
    zeros = np.zeros((3, 3, 3))
    flat = xarray.Dataset({"h": (("y", "x"), zeros[0])})
    with pytest.raises(InvalidArgumentError, match="no variable has three dimensions.*'h' \\('y', 'x'\\)"):
        write(flat, tmp_path)
    named = xarray.DataArray(zeros, dims=("z", "y", "x"), coords={"z": ["low", "mid", "high"]})
    with pytest.raises(InvalidArgumentError, match="coordinate 'z' is of .*drop_vars\\('z'\\)"):
        write(named, tmp_path)
    with pytest.raises(InvalidArgumentError, match="variable 'u' is of complex128"):
        write(xarray.DataArray(zeros + 1j, dims=("z", "y", "x"), name="u"), tmp_path)
    with pytest.raises(InvalidArgumentError, match="vectors names 'w': the variables are 'u'"):
        write(xarray.Dataset({"u": (("z", "y", "x"), zeros)}), tmp_path, vectors=["w"])
    with pytest.raises(InvalidArgumentError, match="vectors names 'u', of the dimensions"):
        write(xarray.Dataset({"u": (("z", "y", "x"), zeros)}), tmp_path, vectors=True)
    with pytest.raises(InvalidArgumentError, match="a name must be text"):
        write(xarray.Dataset({"a/b": (("z", "y", "x"), zeros)}), tmp_path)


def test_arguments_that_an_xarray_answers_itself_are_refused(programs, xarray):
    array = xarray.DataArray(np.zeros((3, 3, 3)), dims=("z", "y", "x"))
    for how in ({"units": "K"}, {"times": [0]}, {"time_unit": "s"}, {"length_unit": "m"}):
        with pytest.raises(InvalidArgumentError, match=f"{next(iter(how))}: an xarray has its own"):
            isoscope.serve(array, **how)
    with pytest.raises(InvalidArgumentError, match="dims and dtype"):
        isoscope.serve(array, dims=(3, 3, 3))
    with pytest.raises(InvalidArgumentError, match="the dict has 'u', a xarray.DataArray.*xarray.Dataset"):
        isoscope.serve({"u": array})
    with pytest.raises(InvalidArgumentError, match="axes: for xarray"):
        isoscope.serve(np.zeros((3, 3, 3)), axes="ZYX")
