"""Surfaces that do not show, and fields without a value: what a picture and a mesh say of them."""

import asyncio
import dataclasses
import pickle
import warnings

import numpy as np
import pytest

import isoscope
from isoscope import Caps, ColorBy, Surface, SurfaceWarning, _request, _warn
from isoscope._proto import isosurface_service_pb2 as pb

SIZE = {"size": (96, 72)}


def fields():
    """A ball, and a ramp that has no value in half of the volume."""
    z, y, x = np.mgrid[0:16, 0:18, 0:20].astype(np.float32)
    ball = 6 - np.sqrt((x - 9.5) ** 2 + (y - 8.5) ** 2 + (z - 7.5) ** 2)
    return {"p": ball, "holes": np.where(x < 10, x, np.float32(np.nan)), "labels": np.where(ball > 0, 3, 0) + 0.0 * x}


@pytest.fixture(scope="module")
def client(programs):
    with isoscope.serve(fields(), renderer="cpu", threads=2) as client:
        yield client


@pytest.fixture
def dataset(client):
    return client.dataset()


def cut(caps):
    return {"clip": isoscope.Clip(planes=[(0, 0, -1, -8.25)], caps=caps), **SIZE}


def test_missing_values_have_a_colour_of_their_own(dataset):
    look = {"field": "p", "color_by": ColorBy("field", "viridis", field="holes")}
    default = dataset.render(0.25, **look, **SIZE)
    (coloring,) = default.colorings
    assert (coloring.nan_color, coloring.shows_nan) == ("#808080", True)
    assert coloring.color_by.range == (0, 9)
    assert dataset.render(0.25, nan_color=(128 / 255,) * 3, **look, **SIZE).png == default.png
    blue = dataset.render(0.25, nan_color="#0000ff", **look, **SIZE)
    assert blue.png != default.png and blue.colorings[0].nan_color == "#0000ff"
    assert dataset.render(0.25, field="p", color_by="z:viridis", **SIZE).colorings[0].nan_color is None


def test_the_answer_tells_whether_the_colour_shows(dataset):
    look = {"field": "p", "color_by": ColorBy("field", "viridis", field="holes"), **SIZE}
    half = isoscope.Clip(planes=[(-1, 0, 0, -8)])
    assert not dataset.render(0.25, clip=half, **look).colorings[0].shows_nan
    other = isoscope.Clip(planes=[(1, 0, 0, 10)])
    assert dataset.render(0.25, clip=other, **look).colorings[0].shows_nan


def test_caps_tell_their_map_and_missing_samples(dataset):
    frame = dataset.render(2, field="holes", nan_color="#ff0000", **cut(Caps("turbo", "all")))
    assert frame.caps_coloring.caps == Caps("turbo", (0, 9))
    assert frame.caps_coloring.nan_color == "#ff0000"
    # Where samples are missing, nothing is inside.
    assert not frame.caps_coloring.shows_nan
    assert dataset.render(2, field="holes", **cut(True)).caps_coloring is None
    copy = pickle.loads(pickle.dumps(frame))
    assert (copy.caps_coloring, copy.notes) == (frame.caps_coloring, ())


def test_caps_have_the_window_of_the_samples_inside_by_default(dataset):
    default, plain, middle = (
        dataset.render(2, field="holes", **cut(caps))
        for caps in (Caps("grey"), Caps("grey", window=None), Caps("grey", window=(25, 75)))
    )
    # The samples from 2 to 9 are equally many.
    assert default.caps_coloring.caps.range == pytest.approx((2, 9), abs=0.02)
    assert plain.caps_coloring.caps.range == (0, 9)
    assert middle.caps_coloring.caps.range == pytest.approx((3.5, 7.5), abs=0.52)
    assert len({frame.png for frame in (default, plain, middle)}) == 3
    again = dataset.render(2, field="holes", **cut(Caps("grey", default.caps_coloring.caps.range)))
    assert again.png == default.png


def test_the_range_of_what_is_visible_holds_what_the_picture_shows(dataset):
    look = {"clip": isoscope.Clip(box=(4.5, 7.5, 0, 17, 0, 15)), **SIZE}
    whole = dataset.render(0.25, field="p", color_by=ColorBy("field", field="holes"), **look)
    assert whole.colorings[0].color_by.range == (0, 9)
    seen = dataset.render(0.25, field="p", color_by=ColorBy("field", range="visible", field="holes"), **look)
    least, greatest = seen.colorings[0].color_by.range
    assert 4.4 < least < greatest < 7.6 and greatest - least > 2
    fixed = dataset.render(0.25, field="p", color_by=ColorBy("field", range=(least, greatest), field="holes"), **look)
    assert fixed.png == seen.png != whole.png
    by_x = dataset.render(0.25, field="p", color_by=ColorBy("x", range="visible"), planes=["position"], **look)
    x = by_x.position[..., 0]
    assert by_x.colorings[0].color_by.range == pytest.approx((np.nanmin(x), np.nanmax(x)), abs=1e-5)
    with pytest.raises(isoscope.InvalidArgumentError, match="region"):
        dataset.render(0.25, field="p", color_by=ColorBy("x", range="visible"), region=(0, 0, 8, 8), **SIZE)


@pytest.mark.parametrize("wrong", ["#0000ff80", (0, 0, 2), "no colour"])
def test_a_colour_of_missing_values_is_opaque(dataset, wrong):
    with pytest.raises(ValueError, match="nan_color"):
        dataset.render(0.25, field="p", color_by="holes", nan_color=wrong, **SIZE)


WAYS = [
    ({"isovalue": 50, "field": "p"}, "outside_range", "isovalue 50 has no surface: .*are in"),
    ({"surfaces": Surface(labels=5), "field": "labels"}, "no_label", "label 5 has no surface: no sample has it"),
    ({"surfaces": Surface(labels=[3, 5]), "field": "labels"}, "some_labels_missing", "no sample has label 5 of 3, 5"),
    (
        {"isovalue": 0.25, "field": "p", "clip": isoscope.Clip(box=(0, 2, 0, 2, 0, 2))},
        "clipped",
        "the clip region cuts all of it away",
    ),
    ({"isovalue": 0.25, "field": "p", "region": (0, 0, 2, 2)}, "outside_picture", "outside of the picture"),
    ({"isovalue": 0.25, "field": "p", "color_by": ColorBy("z", opacity=(0, 0))}, "transparent", "opacity"),
]


@pytest.mark.parametrize("look, reason, words", WAYS, ids=[reason for _, reason, _ in WAYS])
def test_a_picture_of_nothing_is_right_and_warns(dataset, look, reason, words):
    with pytest.warns(SurfaceWarning, match=words) as caught:
        frame = dataset.render(**look, **SIZE)
    assert len(caught) == 1 and caught[0].filename == __file__
    (note,) = frame.notes
    assert (note.surface_index, note.reason, note.message) == (0, reason, str(caught[0].message))
    # More planes of the same frame are not another picture.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert frame.depth.shape == (frame.height, frame.width)
    assert pickle.loads(pickle.dumps(frame)).notes == frame.notes


def test_a_picture_that_shows_all_is_silent(dataset):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert dataset.render(0.25, field="p", **SIZE).notes == ()
        # The outer surface hides the inner one, as it is meant.
        assert dataset.render(surfaces=[0.25, 3], field="p", **SIZE).notes == ()
        dataset.mesh(0.25, field="p")


def test_a_mesh_of_nothing_warns(dataset):
    with pytest.warns(SurfaceWarning, match="isovalue 50 has no surface") as caught:
        mesh = dataset.mesh(surfaces=[0.25, 50], field="p")
    assert len(caught) == 1 and caught[0].filename == __file__
    assert set(mesh.triangle_surface.tolist()) == {0}
    with pytest.warns(SurfaceWarning, match="no sample has it"):
        assert not len(dataset.mesh(surfaces=Surface(labels=5), field="labels").triangles)


def test_coroutines_warn_as_well(client):
    async def both():
        async with await isoscope.aio.connect(client.address, token_file=client.token_file) as other:
            dataset = await other.dataset()
            with pytest.warns(SurfaceWarning, match="isovalue 50") as caught:
                frame = await dataset.render(50, field="p", nan_color="#0000ff", **SIZE)
            with pytest.warns(SurfaceWarning, match="isovalue 50"):
                await dataset.mesh(50, field="p")
            return frame, caught[0].filename

    frame, filename = asyncio.run(both())
    assert frame.notes[0].reason == "outside_range" and filename == __file__


def test_servers_of_before_are_not_asked(dataset):
    known = dataset._client._capabilities
    for capabilities, expected in ((known, True), (None, False), (dataclasses.replace(known, features=frozenset()), False)):
        request = pb.RenderIsosurfaceRequest()
        _request.ask_for_notes(request, capabilities)
        assert request.with_notes == expected


def test_what_a_notebook_shows_warns_at_its_cell():
    shown = {"__name__": "IPython.core.formatters", "_warn": _warn}
    exec("def show():\n    _warn.warn_of_surface('no surface')", shown)
    cell = compile("1\nshow()", "<cell>", "exec")
    with pytest.warns(SurfaceWarning, match="no surface") as caught:
        exec(cell, {"__name__": "__main__", "show": shown["show"]})
    assert caught[0].filename == "<cell>" and caught[0].lineno == 2
