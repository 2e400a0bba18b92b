"""What `isoscope.serve` takes: arrays of numpy and dask, xarray by its coordinates; the rest is refused by its type."""

import collections
import importlib
import importlib.util
import struct
import warnings

import numpy as np
import pytest

import isoscope
import skips
from isoscope._serving import netcdf_file, samples
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
    for taken in ("path", "numpy or dask array", "dict", "xarray DataArray or Dataset"):
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
        samples.write_samples(file, dask_array.from_array(masked[1:], chunks=2, asarray=False), np.dtype("<f8"))
    assert np.array_equal(np.fromfile(tmp_path / "samples", "<f8"), np.arange(9.0, 27.0))


# ---- parts of arrays


@pytest.mark.parametrize("shape", [(1,), (7,), (5, 4), (1, 6, 3), (3, 1, 2, 5)])
@pytest.mark.parametrize("limit", [1, 16, 40, 10_000])
@pytest.mark.parametrize("is_chunked", [False, True])
def test_parts_follow_each_other_in_the_order_of_the_file(monkeypatch, tmp_path, shape, limit, is_chunked):
    monkeypatch.setattr(samples, "_PART_BYTES", limit)
    array = np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    chunks = tuple((2,) * (side // 2) + (1,) * (side % 2) for side in shape)
    source = array
    if is_chunked:

        class Chunked(np.ndarray):
            pass

        source = array.view(Chunked)
        source.chunks = chunks
        parts = list(samples._parts(shape, 4, chunks))
        # No chunk is in two parts, unless it has one element along the first axis.
        assert all(index[0].stop - index[0].start == 1 for index in parts if len(index) > 1)
    with open(tmp_path / "samples", "wb") as file:
        file.write(b"head")
        samples.write_samples(file, source, np.dtype(">i4"))
    data = (tmp_path / "samples").read_bytes()
    assert data[:4] == b"head" and (np.frombuffer(data, ">i4", offset=4) == array.ravel()).all()


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


def test_dimensions_that_nothing_explains_are_named_and_can_be_told(programs, xarray):
    array = xarray.DataArray(np.zeros((2, 3, 4, 5), np.float32), dims=("run", "z", "y", "x"), name="u")
    with pytest.raises(ProgramError, match="run"):
        isoscope.serve(array)
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
