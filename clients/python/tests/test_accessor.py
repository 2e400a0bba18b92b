"""`array.isoscope` of xarray, and what comes back as xarray."""

import gc
import importlib
import importlib.util
import subprocess
import sys

import numpy as np
import pytest

import isoscope
import skips

VALUES = np.indices((12, 14, 16)).sum(axis=0).astype(np.float32)


@pytest.fixture
def xarray():
    if importlib.util.find_spec("xarray") is None:
        skips.skip("python", "no xarray (python3-xarray)")
    return importlib.import_module("xarray")


@pytest.fixture
def array(xarray, programs):
    coordinates = {"x": 10 + 0.5 * np.arange(16), "y": np.arange(14.0), "z": 2.0 * np.arange(12)}
    made = xarray.DataArray(VALUES.copy(), dims=("z", "y", "x"), coords=coordinates, name="u")
    yield made
    made.isoscope.close()


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)


def test_the_accessor_is_there_whichever_is_imported_first(xarray):
    checks = (
        "assert xarray.DataArray.isoscope is xarray.Dataset.isoscope\n"
        "for loader in (xarray.__loader__, xarray.__spec__.loader):\n"
        "    assert 'isoscope' not in type(loader).__module__, loader\n"
        "assert not any('isoscope' in type(one).__module__ for one in sys.meta_path)\n"
    )
    for order in ("import sys, isoscope, xarray\n", "import sys, xarray, isoscope\n"):
        done = python(order + checks)
        assert done.returncode == 0, done.stderr


def test_xarray_is_not_imported_and_may_be_missing():
    code = (
        "import importlib.util, sys, isoscope\n"
        "assert not {'xarray', 'dask', 'zarr', 'fsspec', 'pandas'} & sys.modules.keys()\n"
        "found = importlib.util.find_spec('xarray')\n"  # somebody who only asks whether it is there
        "assert found is None or found.loader.is_package('xarray')\n"
        "assert 'xarray' not in sys.modules\n"
        "from importlib.machinery import PathFinder\n"
        "PathFinder.find_spec = lambda *_: None\n"
        "try:\n"
        "    import xarray\n"
        "except ModuleNotFoundError as error:\n"
        "    assert error.name == 'xarray', error\n"
        "else:\n"
        "    raise AssertionError('found')\n"
    )
    done = python(code)
    assert done.returncode == 0, done.stderr


def test_to_xarray_without_xarray_says_what_it_needs(dataset, monkeypatch):
    frame = dataset.render(127.5, size=16)
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(isoscope.MissingPackageError, match="to_xarray needs xarray: python3 -m pip install xarray"):
        frame.to_xarray()


def test_pictures_are_those_of_the_served_array(array):
    frame = array.isoscope.render(20, size=48, planes=["depth"])
    with isoscope.serve(VALUES, spacing=(0.5, 1, 2), origin=(10, 0, 0)) as client:
        assert client.dataset().render(20, size=48).png == frame.png
        assert client.dataset().measure(20)[0].area == array.isoscope.measure(20)[0].area
    assert len(array.isoscope.mesh(20).points) and array.isoscope.histogram(8).sample_count.sum() == VALUES.size
    assert "isovalue" in str(importlib.import_module("inspect").signature(array.isoscope.render))


def test_an_array_is_served_once_and_again_after_a_change(array):
    first = array.isoscope.dataset()
    client = array.isoscope._client
    assert array.isoscope.dataset() == first and array.isoscope._client is client
    array.values[3, 4, 5] = 1000  # in place, which nobody is told of
    assert array.isoscope.dataset().range == (0, 1000) and array.isoscope._client is not client
    assert first.render(20, size=16).width == 16  # whoever has the one of before may go on with it
    array["x"] = array["x"] * 2
    assert array.isoscope.dataset().spacing == (1, 1, 2)
    array.attrs["units"] = "K"
    client = array.isoscope._client
    array.isoscope.render(20, size=16)
    assert array.isoscope._client is not client


def test_arguments_of_serve_are_kept(array):
    assert array.isoscope.dataset(shards=2, name="two").shard_count == 2
    client = array.isoscope._client
    assert array.isoscope.render(20, size=16).width == 16 and array.isoscope._client is client
    assert array.isoscope.dataset().name == "two"
    with array.isoscope.serve() as other:
        assert other is not client and other.dataset().name == "array"


def test_the_programs_end_with_the_accessor_or_before(array):
    array.isoscope.render(20, size=16)
    scratch = importlib.import_module("pathlib").Path(array.isoscope._client.token_file).parent
    assert scratch.is_dir()
    array.isoscope.close()
    array.isoscope.close()
    assert not scratch.exists()
    part = array.isel(x=slice(4, 12))
    part.isoscope.render(20, size=16)
    scratch = importlib.import_module("pathlib").Path(part.isoscope._client.token_file).parent
    del part
    gc.collect()
    assert not scratch.exists()


def test_a_dataset_has_fields_and_steps(xarray, programs):
    source = xarray.Dataset({"t": (("time", "z", "y", "x"), np.stack([VALUES, VALUES + 1])), "s": 3.0})
    frame = source.isoscope.render(20, field="t", step=1, size=16)
    assert frame.step == 1
    source["t"][1] = 5
    assert source.isoscope.histogram(step=1).sample_count.sum() == VALUES.size
    assert source.isoscope.dataset().range == (0, VALUES.max())
    source.isoscope.close()


def test_a_change_of_any_kind_of_array_is_seen(xarray):
    from isoscope._accessor import _state_of

    dims = ("z", "y", "x")
    array = xarray.DataArray(VALUES.copy(), dims=dims, coords={"t": 3, "n": ("z", list("abcdefghijkl"))})
    before = _state_of(array)
    assert _state_of(array) == before == _state_of(array.copy())
    assert _state_of(array.transpose("x", "y", "z")) != before
    array.values[-1, -1, -1] += 1
    assert _state_of(array) != before
    swapped = array.copy(deep=True)
    swapped.values[[0, 1]] = swapped.values[[1, 0]]
    assert _state_of(swapped) != _state_of(array)
    if importlib.util.find_spec("dask") is not None:
        lazy = array.chunk({"z": 4})
        assert _state_of(lazy) == _state_of(lazy) and _state_of(lazy + 1) != _state_of(lazy)


def test_planes_of_a_frame_have_coordinates(xarray, dataset):
    frame = dataset.render(127.5, size=(40, 30), planes=["depth", "surface_index"])
    planes = frame.to_xarray()
    assert set(planes.data_vars) == {"depth", "surface_index"} and planes.depth.dims == ("row", "column")
    assert planes.row.values.tolist() == list(range(30)) and planes.column.values.tolist() == list(range(40))
    shown = np.isfinite(frame.depth)
    assert shown.any() and not shown.all()
    assert (planes.depth.values[shown] == frame.depth[shown]).all() and np.isnan(planes.depth.values[~shown]).all()
    assert planes.depth.dtype == np.float32 and (planes.surface_index.values == frame.surface_index).all()
    row, column = np.argwhere(shown)[len(np.argwhere(shown)) // 2]
    pixel = planes.isel(row=row, column=column)
    assert [pixel.x, pixel.y, pixel.z] == frame.points[row, column].tolist()
    point = frame.pick(int(column), int(row)).position
    assert [float(pixel.x), float(pixel.y), float(pixel.z)] == pytest.approx(point, abs=1e-3)
    more = frame.to_xarray("normal", "depth_bounds")
    assert more.normal.dims == ("row", "column", "axis") and more.axis.values.tolist() == ["x", "y", "z"]
    assert (more.normal.sel(axis="y").values[shown] == frame.normal[..., 1][shown]).all()
    assert more.bound.values.tolist() == ["nearest", "farthest"] and "surface_index" not in more
    assert np.isfinite(frame.depth).sum() == shown.sum()  # the frame's own plane is as it was


def test_a_histogram_has_its_values_as_coordinate(xarray, dataset):
    histogram = dataset.histogram(16)
    table = histogram.to_xarray()
    assert (table.value.values == histogram.centers).all()
    assert (table.sample_count.values == histogram.sample_count).all()
    assert set(table.data_vars) == {
        "sample_count", "active_block_count", "active_block_bytes", "estimated_triangle_count",
    }  # fmt: skip
