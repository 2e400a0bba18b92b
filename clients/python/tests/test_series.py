"""Fields and time steps: requests, answers and files of arrays, without a server."""

import inspect
import pickle
import re
import struct

import numpy as np
import pytest

import isoscope
from isoscope import ColorBy, Surface, _answer, _core, _messages, _request, _series_files
from isoscope._proto import dataset_pb2, isosurface_service_pb2 as pb
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope.errors import InvalidArgumentError
from isoscope.look import as_color_by
from test_values import info


def series_proto():
    """Pressure and velocity at three steps, of which velocity lacks the last one."""
    proto = dataset_pb2.Dataset(name="flow", dataset_id="1" * 32, time_unit="s", length_unit="m")
    proto.geometry.sample_dims.x = proto.geometry.sample_dims.y = proto.geometry.sample_dims.z = 8
    for number, value in ((0, 0.0), (2, 0.5), (3, 0.75)):
        proto.time_steps.add(number=number, value=value)
    pressure = proto.fields.add(name="pressure", long_name="Static pressure", unit="Pa", time_steps=[0, 1, 2])
    pressure.components.add(name="", sample_type=7).value_range.max = 9
    velocity = proto.fields.add(name="velocity", time_steps=[0, 1])
    for name in ("x", "y", "z", "magnitude"):
        velocity.components.add(name=name, sample_type=8, max_gradient_magnitude=3).value_range.max = len(name)
    return proto


def series(**changes):
    return isoscope.DatasetInfo(**{**_answer.dataset_fields(series_proto()), **changes})


def test_a_dataset_says_its_fields_times_and_units():
    flow = series()
    pressure, velocity = flow.fields
    assert (pressure.name, pressure.long_name, pressure.unit) == ("pressure", "Static pressure", "Pa")
    assert pressure.range == (0, 9) and pressure.dtype == np.float32 and pressure.steps == (0, 2, 3)
    assert velocity.unit is None and velocity.long_name is None and velocity.steps == (0, 2)
    assert [one.name for one in velocity.components] == ["x", "y", "z", "magnitude"]
    assert velocity.default_component.name == "magnitude" and velocity.range == (0, 9)
    assert velocity.components[0].max_gradient == 3 and velocity.components[0].dtype == np.float64
    assert flow.times.tolist() == [0, 0.5, 0.75] and [step.number for step in flow.time_steps] == [0, 2, 3]
    assert (flow.time_unit, flow.length_unit) == ("s", "m")
    assert flow.field("velocity") is velocity
    with pytest.raises(KeyError, match="no field 'v'.*'pressure', 'velocity'"):
        flow.field("v")
    assert flow == series() and hash(flow) == hash(series()) and pickle.loads(pickle.dumps(flow)) == flow
    assert "pressure (Pa), velocity" in flow._repr_html_() and "3, 0 to 0.75 s" in flow._repr_html_()


def test_a_dataset_of_one_field_is_as_ever():
    plain = info()
    assert plain.fields == () and plain.times.shape == (0,) and plain.time_unit is None
    assert "fields" not in plain._repr_html_()
    assert not _request.frame(plain, 1).HasField("selection")


@pytest.mark.parametrize(
    "what, expected",
    [
        ({"field": "pressure"}, 'field: "pressure"'),
        ({"field": "velocity:x"}, 'field: "velocity" component: "x"'),
        ({"field": "velocity", "component": "y"}, 'field: "velocity" component: "y"'),
        ({"field": "velocity", "component": 2, "step": 0}, 'field: "velocity" component: "2" time_step: 0'),
        ({"component": "magnitude"}, 'component: "magnitude"'),
        ({"time": 0.3}, "time: 0.3"), ({"time": np.float32(0.5)}, "time: 0.5"),
        ({"step": 3}, "time_step: 3"), ({"step": -1}, "time_step: -1"), ({"step": np.int64(2)}, "time_step: 2"),
        ({"step": "first"}, "time_step: 0"), ({"step": "last"}, "time_step: -1"),
    ],
)  # fmt: skip
def test_every_request_names_field_and_step_with_the_same_words(what, expected):
    for request in (
        _request.frame(series(), 1, **what),
        _request.export(series(), 1, None, None, **what),
        _request.histogram(series(), 8, None, **what),
    ):
        assert " ".join(str(request.selection).split()) == expected


def test_a_field_whose_name_has_a_colon_is_meant_by_its_name():
    proto = series_proto()
    proto.fields.add(name="a:b")
    flow = isoscope.DatasetInfo(**_answer.dataset_fields(proto))
    assert _request.frame(flow, 1, field="a:b").selection.field == "a:b"
    selection = _request.frame(flow, 1, field="a:b:x").selection
    assert (selection.field, selection.component) == ("a:b", "x")


@pytest.mark.parametrize(
    "what, words",
    [
        ({"time": 1, "step": 2}, "time 1 and step 2 can't be given together"),
        ({"field": "velocity:x", "component": "y"}, "'velocity:x' names a component, and component 'y'"),
        ({"field": ""}, "must be the name of a field"), ({"field": 3}, "must be the name of a field"),
        ({"time": "now"}, "time 'now': must be a number"), ({"step": 1.5}, "step 1.5: must be a whole number"),
        ({"step": "second"}, "step 'second'"), ({"component": 0.5}, "component 0.5"),
    ],
)  # fmt: skip
def test_wrong_selections_are_named_before_anything_is_sent(what, words):
    with pytest.raises(InvalidArgumentError, match=words):
        _request.frame(series(), 1, **what)


def test_a_pick_asks_for_all_fields_and_its_points_have_them():
    request = _request.frame(series(), 1, size=8)
    assert not _request.pick(request, [(1, 2)]).with_field_values
    assert _request.pick(request, [(1, 2)], all_fields=True).with_field_values
    proto = pb.PickSurfaceResponse()
    point = proto.points.add(is_hit=True)
    point.field_values.add(field="pressure", unit="Pa", value=2)
    point.field_values.add(field="velocity", component="x", value=float("nan"))
    (picked,) = _answer.picked(proto, [(1, 2)])
    pressure, velocity = picked.field_values
    assert pressure == isoscope.FieldValue("pressure", "", "Pa", 2.0)
    assert (velocity.component, velocity.unit) == ("x", None) and np.isnan(velocity.value)
    assert pickle.loads(pickle.dumps(pressure)) == pressure
    point.ClearField("field_values")
    assert _answer.picked(proto, [(1, 2)])[0].field_values == ()


def test_both_clients_take_the_words_in_all_calls():
    for dataset in (isoscope.Dataset, isoscope.aio.Dataset):
        for call in (dataset.render, dataset.mesh, dataset.histogram):
            assert {"field", "component", "time", "step"} <= inspect.signature(call).parameters.keys()
    assert {"field", "component", "time", "step"} <= inspect.signature(isoscope.Dataset.view).parameters.keys()
    assert {"field", "component", "time", "step"} <= set(_core._PICK_ARGUMENTS)
    for dataset in (isoscope.Dataset, isoscope.aio.Dataset):
        assert "all_fields" in inspect.signature(dataset.pick).parameters


@pytest.mark.parametrize(
    "like, expected",
    [
        ("temperature", ColorBy(field="temperature")),
        ("velocity:x", ColorBy(field="velocity", component="x")),
        ("temperature:magma", ColorBy(map="magma", field="temperature")),
        ("velocity:magnitude:cool-warm:-1,2.5",
         ColorBy(map="cool-warm", range=(-1, 2.5), field="velocity", component="magnitude")),
        ("temperature:grey::0.2,1", ColorBy(map="grey", opacity=(0.2, 1), field="temperature")),
        ("z:turbo:0,20", ColorBy("z", "turbo", (0, 20))), ("normal", ColorBy("normal")), ("gradient", ColorBy("gradient")),
        ("field", ColorBy(field="field")), ("none", None), (ColorBy("x"), ColorBy("x")),
    ],
)  # fmt: skip
def test_color_by_takes_the_words_of_the_command_line(like, expected):
    assert as_color_by(like) == expected


@pytest.mark.parametrize(
    "like", ["", "x:jet", "z:", "w:", "w:x:jet", ":magma", "none:turbo", "w:magma:1", "w:magma:a,b", "w:magma:1,2:0,1:3"]
)
def test_wrong_words_of_color_by_are_shown(like):
    with pytest.raises(InvalidArgumentError, match="color_by " + re.escape(repr(like))):
        as_color_by(like)


def test_color_by_a_field_is_in_the_request_and_comes_back():
    surface = _messages.surface_message(Surface(1, color_by="velocity:x:magma:0,2"))
    assert (surface.color_by.quantity, surface.color_by.field, surface.color_by.component) == (6, "velocity", "x")
    answer = pb.SurfaceColoring(surface_index=0, color_by=surface.color_by)
    assert _answer._coloring(answer).color_by == ColorBy("field", "magma", (0, 2), field="velocity", component="x")
    assert not _messages.surface_message(Surface(1, color_by="none")).HasField("color_by")
    assert _messages.surface_message(Surface(1, color_by=ColorBy(field="velocity:2"))).color_by.component == "2"
    request = _request.frame(series(), surfaces=[1, Surface(2, color_by="none"), Surface(3, color_by="z")], isovalue=None)
    _request._set_color_by(request, _messages.color_by_message("pressure"))
    assert [one.color_by.field for one in request.surfaces] == ["pressure", "pressure", ""]
    for wrong, words in (
        (ColorBy(), "ColorBy\\(field='temperature'\\)"), (ColorBy("x", field="pressure"), "either a quantity"),
        (ColorBy("x", component="y"), "only a field has one"),
        (ColorBy(field="velocity:x", component="y"), "names a component"),
    ):  # fmt: skip
        with pytest.raises(InvalidArgumentError, match=words):
            _messages.surface_message(Surface(1, color_by=wrong))


def frame_of(response):
    call = _core.frame(_request.frame(series(), 1, time=0.4))
    call.add(pb.RenderIsosurfaceStreamResponse(part=response))
    return call.result(None)


def test_a_frame_says_what_was_drawn_and_its_planes_and_picks_mean_that():
    response = pb.RenderIsosurfaceResponse(time=0.5)
    response.selection.field, response.selection.component, response.selection.time_step = "velocity", "magnitude", 2
    frame = frame_of(response)
    assert (frame.field, frame.component, frame.step, frame.time) == ("velocity", "magnitude", 2, 0.5)
    assert "velocity:magnitude, step 2 at 0.5, " in repr(frame)
    for request in (_core.plane(frame._request, "depth").request.request, _core.points(frame._request, (1, 1)).request.frame):
        assert request.selection == response.selection
    again = pickle.loads(pickle.dumps(frame))
    assert (again.field, again.step, again.time) == ("velocity", 2, 0.5)
    plain = frame_of(pb.RenderIsosurfaceResponse())
    assert (plain.field, plain.component, plain.step, plain.time) == (None, None, None, None)
    assert "step" not in repr(plain)


def test_a_histogram_says_what_was_counted():
    response = datasets_pb.GetHistogramResponse()
    response.selection.field, response.selection.time_step = "pressure", 0
    histogram = _answer.histogram(response)
    assert (histogram.field, histogram.component, histogram.step) == ("pressure", None, 0)
    assert _answer.histogram(datasets_pb.GetHistogramResponse()).field is None


# ------------------------------------------------------------------------------------ files of arrays


def read_vti(path):
    """The arrays of a file as the writer makes them, by the rules of VTK's XML formats."""
    data = path.read_bytes()
    header, _, appended = data.partition(b"<AppendedData encoding=\"raw\">\n   _")
    arrays = {}
    pattern = rb'<DataArray type="(\w+)" Name="([^"]*)" NumberOfComponents="(\d+)" format="appended" offset="(\d+)">'
    for kind, name, components, offset in re.findall(pattern, header):
        (size,) = struct.unpack_from("<Q", appended, int(offset))
        dtype = np.dtype(kind.decode().lower()).newbyteorder("<")
        flat = np.frombuffer(appended, dtype, size // dtype.itemsize, int(offset) + 8)
        arrays[name.decode()] = flat.reshape(-1, int(components)).squeeze()
    return header.decode(), arrays


def test_arrays_with_times_become_a_file_for_each_step(tmp_path):
    rng = np.random.default_rng(5)
    pressure = rng.random((2, 3, 4, 5)).astype(">f4")
    velocity = rng.integers(-9, 9, (2, 3, 4, 5, 3), dtype=np.int16)[:, :, ::-1]
    made = _series_files.as_series(
        {"p<1>": pressure, "v": velocity}, [0.1, 2], ["v"], units={"v": "<m>/s"}, time_unit="s", length_unit="m"
    )
    assert made.dims == (5, 4, 3) and made.times == (0.1, 2)
    listing = _series_files.write(made, tmp_path, spacing=(0.5, 1, 2), origin=(-1, 0, 3))
    rows = re.findall(r'<DataSet timestep="([^"]*)" file="([^"]*)"/>', listing.read_text())
    assert '<Collection TimeUnit="s">' in listing.read_text()
    assert rows == [("0.1", "step-00000.vti"), ("2.0", "step-00001.vti")]
    for step, (_, name) in enumerate(rows):
        header, arrays = read_vti(tmp_path / name)
        assert 'WholeExtent="0 4 0 3 0 2" Origin="-1.0 0.0 3.0" Spacing="0.5 1.0 2.0" Unit="m">' in header
        assert header.count("UNITS_LABEL") == 1 and ">&lt;m&gt;/s</InformationKey></DataArray>" in header
        assert list(arrays) == ["p&lt;1&gt;", "v"]
        assert (arrays["p&lt;1&gt;"] == pressure[step].ravel()).all()
        assert (arrays["v"] == velocity[step].reshape(-1, 3)).all()


def test_arrays_without_times_become_one_file(tmp_path):
    mask = np.arange(24).reshape(2, 3, 4) % 2 == 0
    half = np.arange(24).reshape(2, 3, 4).astype(">f2") / 7
    made = _series_files.as_series({"mask": mask, "half": half, "level": np.ones((2, 3, 4))}, None, False)
    path = _series_files.write(made, tmp_path)
    assert made.times is None and path.suffix == ".vti"
    arrays = read_vti(path)[1]
    assert (arrays["mask"] == mask.ravel()).all() and arrays["mask"].dtype == np.uint8
    assert (arrays["half"] == half.ravel()).all() and arrays["half"].dtype == np.float32
    assert (arrays["level"] == 1).all()


@pytest.mark.parametrize(
    "shape, times, vectors, fields, steps",
    [
        ((2, 3, 4), None, False, [1], None), ((2, 3, 4), [7], False, [1], (7,)), ((5, 2, 3, 4), None, False, [1], (0, 1, 2, 3, 4)),
        ((2, 3, 4, 3), None, True, [3], None), ((5, 2, 3, 4, 2), range(5), True, [2], (0, 1, 2, 3, 4)),
    ],
)  # fmt: skip
def test_the_axes_are_steps_grid_and_where_it_is_said_components(shape, times, vectors, fields, steps):
    made = _series_files.as_series(np.zeros(shape), times, vectors)
    assert [one.component_count for one in made.fields] == fields
    assert made.times == steps and made.dims == (4, 3, 2)


@pytest.mark.parametrize(
    "source, how, words",
    [
        ({}, {}, "empty"), ({"a": np.zeros((3, 3))}, {}, "shape \\(3, 3\\)"),
        ({"a": np.zeros((2, 3, 4, 5, 3))}, {}, "vectors=True"), ({"a": np.zeros((3, 3, 3))}, {"vectors": ["b"]}, "names 'b'"),
        ({"a": np.zeros((3, 3, 3))}, {"vectors": ["a"]}, "\\(z, y, x, c\\)"),
        ({"a": np.zeros((3, 3, 3, 10))}, {"vectors": True}, "10 components"),
        ({"a": np.zeros((2, 3, 3, 3)), "b": np.zeros((2, 3, 3, 4))}, {}, "same grid and steps"),
        ({"a": np.zeros((3, 3, 3), complex)}, {}, "complex128"), ({"": np.zeros((3, 3, 3))}, {}, "name ''"),
        ({"a:x": np.zeros((3, 3, 3))}, {}, "without a colon"), ({"a": np.zeros((2, 3, 3, 3))}, {"times": [1]}, "2 steps"),
        ({"a": np.zeros((2, 3, 3, 3))}, {"times": [1, 1]}, "ascending"),
        ({"a": np.zeros((2, 3, 3, 3))}, {"times": [1, np.nan]}, "finite"),
        ({"a": np.zeros((2, 3, 3, 3))}, {"times": "ab"}, "must be numbers"),
        ({"a": np.zeros((2, 3, 3, 3))}, {"times": np.array([0, 1], "M8[h]")}, "must be numbers.*timedelta64"),
        ({"a": np.zeros((3, 3, 3))}, {"units": ["m"]}, "units .*dict of texts"), ({"a": np.zeros((3, 3, 3))}, {"units": 3}, "units 3"),
        ({"a": np.zeros((3, 3, 3))}, {"units": {"b": "m"}}, "units names 'b'"),
        ({"a": np.zeros((3, 3, 3))}, {"units": "\n"}, "units '..'"), ({"a": np.zeros((3, 3, 3))}, {"time_unit": 3}, "time_unit 3"),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_named(source, how, words):
    with pytest.raises(InvalidArgumentError, match=words):
        _series_files.as_series(source, **{"times": None, "vectors": False, **how})
