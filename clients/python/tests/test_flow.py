"""A series of a real server: `isoscope generate flow`, and arrays through `serve`, beside what `isoscope` says."""

import asyncio

import numpy as np
import pytest

import isoscope
from isoscope import ColorBy
from test_render import by_command, server_flags

SIZE = {"size": (160, 120)}
STEPS = 4


@pytest.fixture(scope="module")
def flow(run, tmp_path_factory):
    folder = tmp_path_factory.mktemp("flow")
    run("generate", "flow", "--dims", "24,20,28", "--steps", STEPS, "--output", folder / "flow.pvd")
    run("partition", folder / "flow.pvd", "--output", folder / "served", "--shards", "2")
    with isoscope.serve(folder / "served", renderer="cpu", threads=2) as client:
        yield client.dataset()


def middle(field, component=""):
    """An isovalue that has a surface at every step."""
    lower, upper = next(one for one in field.components if one.name == component).range
    return (lower + upper) / 2


def test_the_series_says_its_fields_times_and_units(flow):
    units = {field.name: field.unit for field in flow.fields}
    assert units == {"pressure": "Pa", "temperature": "K", "velocity": "m/s"}
    assert [one.name for one in flow.field("velocity").components] == ["x", "y", "z", "magnitude"]
    assert flow.times == pytest.approx([0, 0.1, 0.2, 0.3]) and flow.time_unit == "s"
    assert all(field.steps == (0, 1, 2, 3) for field in flow.fields)
    assert flow.range == flow.fields[0].range and flow.refresh() == flow


@pytest.mark.parametrize(
    "what, flags",
    [
        ({}, ()),
        ({"field": "temperature", "step": 1}, ("--field", "temperature", "--step", 1)),
        ({"field": "velocity"}, ("--field", "velocity")),
        ({"field": "velocity:x", "time": 0.12}, ("--field", "velocity:x", "--time", 0.12)),
        ({"field": "velocity", "component": "z", "step": "first"}, ("--field", "velocity:z", "--step", "first")),
        ({"step": "last"}, ("--step", "last")),
        ({"field": "pressure", "step": 2, "color_by": "temperature"},
         ("--field", "pressure", "--step", 2, "--color-by", "temperature")),
        ({"step": 0, "color_by": ColorBy(field="velocity", component="y", map="magma", range=(-0.1, 0.1))},
         ("--step", 0, "--color-by", "velocity:y:magma:-0.1,0.1")),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else None,
)  # fmt: skip
def test_a_frame_has_the_bytes_of_the_command_line(run, flow, tmp_path, what, flags):
    name, _, component = what.get("field", "pressure").partition(":")
    component = what.get("component", component or ("magnitude" if name == "velocity" else ""))
    isovalue = middle(flow.field(name), component)
    frame = flow.render(isovalue, **SIZE, **what)
    assert frame.png == by_command(run, flow._client, tmp_path, "--isovalue", isovalue, *flags)
    assert frame.stats.triangle_count > 0
    assert (frame.field, frame.component or "") == (name, component)
    assert frame.time == flow.times[frame.step]


def test_the_step_nearest_to_a_time_is_drawn_of_two_the_earlier(flow):
    for time, step in ((-1, 0), (0.04, 0), (0.06, 1), (99, 3)):
        assert flow.render(flow.range[0] / 2, time=time, size=16).step == step
    assert flow.render(flow.range[0] / 2, size=16).step == STEPS - 1


def test_planes_picks_meshes_and_histograms_are_of_the_step_of_the_frame(flow):
    temperature = flow.field("temperature")
    isovalue = middle(temperature)
    frames = [flow.render(isovalue, field="temperature", step=step, **SIZE) for step in (0, 3)]
    assert not np.array_equal(frames[0].depth, frames[1].depth)
    rows, columns = np.nonzero(np.isfinite(frames[0].depth))
    pixel = (int(columns[len(columns) // 2]), int(rows[len(rows) // 2]))
    assert flow.pick(pixel, isovalue, field="temperature", time=0, **SIZE) == frames[0].pick(*pixel)
    assert np.float32(frames[0].pick(*pixel).depth) == frames[0].depth[pixel[1], pixel[0]]
    point = frames[0].pick(*pixel, all_fields=True)
    assert point == flow.pick(pixel, isovalue, field="temperature", step=0, all_fields=True, **SIZE)
    values = {(value.field, value.component): value.value for value in point.field_values}
    assert list(values) == [(field.name, part.name) for field in flow.fields for part in field.components]
    assert abs(values["temperature", ""] - isovalue) < 1e-3
    speed = np.linalg.norm([values["velocity", name] for name in "xyz"])
    assert abs(values["velocity", "magnitude"] - speed) < 0.05 * speed
    meshes = [flow.mesh(isovalue, field="temperature", step=step) for step in (0, 3)]
    assert not np.array_equal(meshes[0].points, meshes[1].points)
    histogram = flow.histogram(bins=16, field="velocity:x", step=1)
    assert (histogram.field, histogram.component, histogram.step) == ("velocity", "x", 1)
    assert histogram.sample_count.sum() == 24 * 20 * 28
    assert flow.suggestions(field="temperature") != flow.suggestions(field="velocity")


def test_the_range_of_colours_is_that_of_all_steps(flow):
    used = {
        flow.render(flow.range[0] / 2, step=step, color_by="temperature", size=32).colorings[0].color_by
        for step in range(STEPS)
    }
    assert used == {ColorBy("field", "viridis", flow.field("temperature").range, field="temperature")}


def test_wrong_names_and_steps_are_the_servers_sentences(flow):
    for what, words in (
        ({"field": "hue"}, "hue.*pressure"), ({"field": "velocity", "component": "w"}, "w.*magnitude"),
        ({"step": 99}, "99"), ({"step": -7}, "-7"), ({"time": float("nan")}, "nan"),
        ({"color_by": "hue"}, "hue.*pressure"), ({"field": "pressure", "component": "x"}, "x"),
    ):  # fmt: skip
        with pytest.raises(isoscope.IsoscopeError, match=words) as caught:
            flow.render(1, size=16, **what)
        assert caught.value.code in ("INVALID_ARGUMENT", "NOT_FOUND"), caught.value


def test_a_dataset_of_one_volume_has_step_0_alone(dataset):
    for what in ({"field": "pressure"}, {"time": 1}, {"color_by": "pressure"}):
        with pytest.raises(isoscope.InvalidArgumentError):
            dataset.render(127.5, size=16, **what)
    with pytest.raises(isoscope.NotFoundError, match="step 0 alone"):
        dataset.render(127.5, size=16, step=1)
    frame = dataset.render(127.5, size=16)
    assert dataset.render(127.5, size=16, step=0).png == frame.png
    assert (frame.field, frame.step, frame.time) == (None, None, None)


def test_the_async_client_has_the_same_words(flow):
    async def render():
        async with isoscope.aio.connect(flow._client.address, token_file=flow._client.token_file) as client:
            dataset = await client.dataset()
            return await dataset.render(flow.range[0] / 2, field="pressure", step=1, **SIZE)

    assert asyncio.run(render()).png == flow.render(flow.range[0] / 2, field="pressure", step=1, **SIZE).png


def test_a_view_shows_the_field_and_the_step(flow):
    view = flow.view(field="temperature", step=1, size=(48, 40), gateway="")
    assert view.state["selection"] == {"field": "temperature", "timeStep": 1}
    frame = view.snapshot()
    assert (frame.field, frame.step) == ("temperature", 1)
    assert frame.png == flow.render(
        flow.suggestions(field="temperature", step=1)[0].isovalue, field="temperature", step=1, size=(48, 40)
    ).png


# ------------------------------------------------------------------------------------ arrays


def balls():
    """A ball that grows, on a grid of 24 x 20 x 16, and where each sample is."""
    z, y, x = np.mgrid[0:16, 0:20, 0:24].astype(np.float32)
    level = np.stack([radius - np.sqrt((x - 12) ** 2 + (y - 10) ** 2 + (z - 8) ** 2) for radius in (4, 5, 6)])
    place = np.broadcast_to(np.stack([x, y, z], axis=-1), (3, 16, 20, 24, 3))
    return level, place


def test_arrays_with_fields_and_times_are_served_as_they_are(programs):
    level, place = balls()
    with isoscope.serve(
        {"level": level, "place": place}, times=[0.5, 1, 4], vectors=["place"], units={"place": "mm"}, time_unit="h",
        spacing=(2, 1, 1), origin=(10, 0, 0), name="balls", shards=2,
    ) as client:  # fmt: skip
        dataset = client["balls"]
        assert dataset.times.tolist() == [0.5, 1, 4] and dataset.dims == (24, 20, 16)
        assert [field.name for field in dataset.fields] == ["level", "place"]
        assert dataset.field("place").unit == "mm" and dataset.field("place").components[0].range == (0, 23)
        assert dataset.field("level").range == (level.min(), level.max())
        for step, radius in enumerate((4, 5, 6)):
            points = dataset.mesh(0, step=step).points
            middle_of = np.array([10 + 2 * 12, 10, 8])
            distance = np.linalg.norm((points - middle_of) / [2, 1, 1], axis=1)
            assert distance == pytest.approx(radius, abs=0.1)
        plane = dataset.mesh(7.25, field="place:x", time=0).points
        assert plane[:, 0] == pytest.approx(10 + 2 * 7.25)


def test_an_array_with_a_time_axis_has_steps_0_1_2(programs):
    level, _ = balls()
    with isoscope.serve(level) as client:
        dataset = client.dataset()
        assert dataset.times.tolist() == [0, 1, 2] and len(dataset.fields) == 1
        assert dataset.render(0, step=1, size=16).time == 1
    with isoscope.serve({"level": level[0], "other": level[1]}) as client:
        dataset = client.dataset()
        assert dataset.times.size == 0 and [field.name for field in dataset.fields] == ["level", "other"]
        assert dataset.render(0, field="other", size=16).stats.triangle_count > 0


@pytest.mark.parametrize("how", [{"times": [1]}, {"vectors": True}, {"units": "m"}, {"time_unit": "s"}])
def test_files_have_their_own_times_and_units(programs, volume, how):
    with pytest.raises(isoscope.InvalidArgumentError, match="are for arrays"):
        isoscope.serve(volume, **how)
