"""Levels: the choice in requests, and what answers tell of it."""

import dataclasses

import pytest

import isoscope
from isoscope import _answer, _request
from isoscope._proto import dataset_pb2
from isoscope._proto import isosurface_service_pb2 as pb

SIZE = {"size": (96, 72)}


def test_without_a_choice_a_request_is_as_it_always_was():
    request = pb.RenderIsosurfaceRequest(isovalue=3)
    before = request.SerializeToString()
    _request.set_level(request, None, None, None)
    assert request.SerializeToString() == before
    mesh = pb.ExportIsosurfaceRequest(isovalue=3)
    before = mesh.SerializeToString()
    _request.set_mesh_level(mesh, 0, None)
    assert mesh.SerializeToString() == before


def test_each_argument_is_a_choice(client):
    request = pb.RenderIsosurfaceRequest()
    _request.set_level(request, 0, None, client._capabilities)
    assert request.level.WhichOneof("choice") == "level" and request.level.level == 0
    _request.set_level(request, None, 1.1, client._capabilities)
    assert request.level.WhichOneof("choice") == "max_spacing_px" and request.level.max_spacing_px == 1.1


def test_wrong_choices_are_named(client, dataset):
    for how, words in (
        ({"level": 1, "max_spacing": 2}, "exclude each other"),
        ({"level": -1}, "level -1"),
        ({"level": 1.5}, "level 1.5"),
        ({"level": 24}, "level.level is 24"),
        ({"max_spacing": 0}, "max_spacing_px is 0"),
        ({"max_spacing": float("nan")}, "max_spacing_px is nan"),
        ({"max_spacing": "far"}, "max_spacing 'far'"),
    ):
        with pytest.raises(isoscope.InvalidArgumentError, match=words):
            dataset.render(127.5, **how, **SIZE)
    older = dataclasses.replace(client._capabilities, features=frozenset())
    with pytest.raises(isoscope.FailedPreconditionError, match="older than the client"):
        _request.set_level(pb.RenderIsosurfaceRequest(), 1, None, older)
    with pytest.raises(isoscope.FailedPreconditionError, match="older than the client"):
        _request.set_mesh_level(pb.ExportIsosurfaceRequest(), 1, older)


def test_a_dataset_without_levels_draws_its_samples(dataset):
    assert dataset.levels == ()
    exact = dataset.render(127.5, **SIZE)
    assert exact.level is None and exact.stats.level == 0
    chosen = dataset.render(127.5, max_spacing=100, camera=exact.camera, samples=1, **SIZE)
    assert chosen.level.level == 0 and chosen.level.spacing == dataset.spacing
    assert 0 < chosen.level.max_spacing < 100
    assert chosen.png == dataset.render(127.5, camera=exact.camera, samples=1, **SIZE).png
    with pytest.raises(isoscope.FailedPreconditionError, match="level is 1.*level 0 alone"):
        dataset.render(127.5, level=1, **SIZE)
    with pytest.raises(isoscope.FailedPreconditionError, match="level is 1"):
        dataset.mesh(127.5, level=1)


def test_answers_tell_the_level():
    proto = dataset_pb2.Dataset(name="large")
    level = proto.levels.add(level=2, block_count=64, filter=dataset_pb2.DatasetLevel.FILTER_MAJORITY)
    level.geometry.sample_dims.x, level.geometry.sample_dims.y, level.geometry.sample_dims.z = 10, 20, 30
    level.geometry.spacing.x = level.geometry.spacing.y = level.geometry.spacing.z = 4
    levels = _answer.dataset_fields(proto)["levels"]
    assert levels == (isoscope.DatasetLevel(2, (10, 20, 30), (4, 4, 4), 64, "majority"),)


def test_the_frame_names_its_level_for_what_is_asked_later():
    """A plane that is fetched later must be of the level of the picture, whatever is served by then."""
    request = pb.RenderIsosurfaceRequest(isovalue=3)
    request.level.max_spacing_px = 1.1
    parts = _answer.FrameParts(request, lambda do: None)
    message = pb.RenderIsosurfaceStreamResponse()
    message.part.drawn_level.level = 2
    message.part.drawn_level.max_spacing_px = 0.9
    message.part.drawn_level.spacing.x = 4
    message.part.statistics.level = 2
    parts.add(message)
    frame = parts.result(None)
    assert frame.level == isoscope.DrawnLevel(2, 0.9, (4, 0, 0)) and frame.stats.level == 2
    assert frame._request.level.WhichOneof("choice") == "level" and frame._request.level.level == 2
