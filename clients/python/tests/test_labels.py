"""Surfaces of labels: their values, names and colours; by programs on a segmentation that the test writes."""

import asyncio

import numpy as np
import pytest

import isoscope
from isoscope import _core, _messages, _request
from isoscope.data import Capabilities, Histogram
from isoscope.errors import FailedPreconditionError, InvalidArgumentError
from isoscope.labels import Label, as_label_sets, color_of, label_color, values_of
from test_values import info

KNOWN = (
    Label(0.0, "background"), Label(3.0, "left lung", "#ff8000"), Label(4.0, "Right lung"), Label(7.0, "twin"),
    Label(8.0, "twin"),
)  # fmt: skip


def test_the_palette_is_that_of_the_programs():
    assert [label_color(value) for value in (0, 1, 15, 16, -1, 1.75)] == [
        "#fe8677", "#2a89e2", "#94bf41", "#fe8677", "#94bf41", "#2a89e2",
    ]  # fmt: skip


def test_each_element_is_a_surface_and_a_sequence_within_is_one_set():
    assert as_label_sets([3, (7, 8), "a"]) == [[3], [7, 8], ["a"]]
    assert as_label_sets("left lung") == [["left lung"]]
    assert as_label_sets(3) == [[3]]
    assert as_label_sets(KNOWN[1]) == [[KNOWN[1]]]
    assert as_label_sets(np.array([3, 4])) == [[3], [4]]


def test_names_and_values_make_ascending_sets():
    assert values_of(["right LUNG", 3, 3.0, -0.0], KNOWN) == (0.0, 3.0, 4.0)
    assert values_of("left lung", KNOWN) == (3.0,)
    assert values_of(KNOWN[2], KNOWN) == (4.0,)
    with pytest.raises(InvalidArgumentError, match="did you mean 'left lung'"):
        values_of("left lnug", KNOWN)
    with pytest.raises(InvalidArgumentError, match="7, 8 have this name"):
        values_of("twin", KNOWN)
    with pytest.raises(InvalidArgumentError, match="no names"):
        values_of("lung", ())
    for wrong in ([], list(range(257)), [float("nan")], [None]):
        with pytest.raises(InvalidArgumentError):
            values_of(wrong, KNOWN)


def test_the_colour_is_that_of_the_dataset_or_of_the_value():
    assert color_of((3.0, 4.0), KNOWN) == "#ff8000"
    assert color_of((4.0,), KNOWN) == label_color(4)
    proto = _messages.surface_message(isoscope.Surface(labels=[4, "left lung"], opacity=0.5), labels=KNOWN)
    assert list(proto.labels) == [3, 4]
    assert proto.color.green == pytest.approx(128 / 255) and proto.color.alpha == 0.5
    proto = _messages.surface_message(isoscope.Surface(labels=3, color="#0000ff"), labels=KNOWN)
    assert proto.color.blue == 1
    for wrong in (isoscope.Surface(), isoscope.Surface(60, labels=3)):
        with pytest.raises(InvalidArgumentError, match="either"):
            _messages.surface_message(wrong)


def test_labels_follow_the_other_surfaces_of_a_request():
    body = info(labels=KNOWN)
    request = _request.frame(body, 60, labels=[3, (7, 8)])
    assert [one.isovalue for one in request.surfaces] == [60, 0, 0]
    assert [list(one.labels) for one in request.surfaces] == [[], [3], [7, 8]]
    assert not request.isovalue
    request = _request.export(body, None, None, None, labels="Right lung")
    assert [list(one.labels) for one in request.surfaces] == [[4]]
    with pytest.raises(InvalidArgumentError, match="129 surfaces"):
        _request.frame(body, None, labels=list(range(129)))
    with pytest.raises(InvalidArgumentError, match="labels="):
        _request.frame(body, None)


def test_a_server_that_does_not_know_labels_is_not_asked():
    old = Capabilities("0.1", 1024, 1, 1, 1, 1.0, features=frozenset({"dataset_id"}))
    request = _request.frame(info(), None, labels=3)
    with pytest.raises(FailedPreconditionError, match="labels"):
        _request.expect_dataset(request, info(), old)
    _request.expect_dataset(_request.frame(info(), 3), info(), old)


def test_smooth_labels_are_a_property_of_their_surfaces_alone():
    request = _request.frame(info(labels=KNOWN), 60, labels=[3, (7, 8)], smooth_labels=True)
    assert [one.smooth_labels for one in request.surfaces] == [False, True, True]
    request = _request.export(info(), None, [isoscope.Surface(labels=3, smooth=True), isoscope.Surface(labels=4)], None)
    assert [one.smooth_labels for one in request.surfaces] == [True, False]
    with pytest.raises(InvalidArgumentError, match="give labels"):
        _request.frame(info(), 60, smooth_labels=True)
    with pytest.raises(InvalidArgumentError, match="must have labels"):
        _request.frame(info(), None, surfaces=isoscope.Surface(60, smooth=True))


def test_a_server_that_does_not_smooth_labels_is_not_asked():
    old = Capabilities("0.1", 1024, 1, 1, 1, 1.0, features=frozenset({"labels"}))
    with pytest.raises(FailedPreconditionError, match="does not smooth"):
        _request.expect_dataset(_request.frame(info(), None, labels=3, smooth_labels=True), info(), old)
    _request.expect_dataset(_request.frame(info(), None, labels=3), info(), old)


def counted(edges, counts, has_counts=True):
    edges = np.array(edges, np.float64)
    counts = np.array(counts, np.int64)
    return Histogram(edges, counts, counts, counts, counts, has_counts, 0, 0, 0, ())


def test_present_labels_are_those_of_an_exact_histogram_or_the_names():
    exact = counted([0, 1, 2, 3, 4], [9, 0, 1, 5])
    assert _core.present(info(labels=KNOWN), exact) == (Label(2.0), KNOWN[1])
    coarse = counted([0, 2, 4], [9, 5])
    assert _core.present(info(labels=KNOWN), coarse) == KNOWN[1:]
    assert _core.present(info(labels=KNOWN, dtype=np.dtype("f4")), exact) == KNOWN[1:]
    assert _core.present(info(labels=KNOWN), counted([0, 1], [9], has_counts=False)) == KNOWN[1:]


@pytest.fixture(scope="module")
def segmentation(tmp_path_factory):
    """Two boxes that touch, as 3D Slicer writes them."""
    samples = np.zeros((24, 24, 24), np.uint8)
    samples[6:18, 6:18, 4:12] = 1
    samples[6:18, 6:18, 12:20] = 2
    header = (
        "NRRD0004\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: 24 24 24\n"
        "space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\nkinds: domain domain domain\n"
        "encoding: raw\nSegment0_LabelValue:=1\nSegment0_Name:=left box\nSegment0_Color:=1 0 0\n"
        "Segment0_Layer:=0\nSegment1_LabelValue:=2\nSegment1_Name:=right box\nSegment1_Layer:=0\n\n"
    )
    path = tmp_path_factory.mktemp("labels") / "boxes.seg.nrrd"
    path.write_bytes(header.encode() + samples.tobytes())
    return path


@pytest.fixture(scope="module")
def boxes(programs, segmentation):
    with isoscope.serve(segmentation) as client:
        yield client.dataset()


def test_a_segmentation_has_names_and_colours(boxes):
    assert boxes.labels == (Label(1.0, "left box", "#ff0000"), Label(2.0, "right box"))
    assert boxes.present_labels() == boxes.labels


def test_labels_are_drawn_in_their_colours_and_picked_with_their_names(boxes):
    frame = boxes.render(labels="all", size=96, planes=["surface_index"])
    assert set(np.unique(frame.surface_index)) == {0, 1, 255}
    left = boxes.pick((30, 48), frame=frame)
    right = boxes.pick((66, 48), frame=frame)
    assert (left.label, left.label_name, left.surface_index) == (1.0, "left box", 0)
    assert (right.label, right.label_name, right.surface_index) == (2.0, "right box", 1)
    pixels = frame.rgb.astype(int)
    assert pixels[48, 30, 0] > 2 * pixels[48, 30, 2]  # red
    both = boxes.render(labels=[("left box", 2)], size=96, planes=["surface_index"])
    assert set(np.unique(both.surface_index)) == {0, 255}


def test_the_mesh_of_a_label_is_closed(boxes):
    mesh = boxes.mesh(labels=["left box", 2])
    assert np.isnan(mesh.isovalues).all() and len(mesh.isovalues) == 2
    for index in range(2):
        triangles = mesh.triangles[mesh.triangle_surface == index]
        edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        forward = {tuple(edge) for edge in edges.tolist()}
        assert len(forward) == len(edges)
        assert {(b, a) for a, b in forward} == forward


def test_a_segmentation_suggests_its_labels_and_other_samples_none(programs, boxes):
    assert boxes.histogram().suggested_labels == (1.0, 2.0)
    slope = np.linspace(0, 1, 24**3, dtype=np.float32).reshape(24, 24, 24)
    with isoscope.serve(slope) as client:
        assert client.dataset().histogram().suggested_labels == ()


def test_smooth_labels_move_vertices_and_keep_the_triangles_closed(boxes):
    rough, smooth = (boxes.mesh(labels="all", smooth_labels=smooth) for smooth in (False, True))
    assert np.array_equal(rough.triangles, smooth.triangles) and smooth.is_closed
    moved = np.abs(rough.points - smooth.points)
    assert 0 < moved.max() <= 0.25
    assert (np.count_nonzero(moved, axis=1) <= 1).all()  # along the edge alone
    assert boxes.render(labels="all", smooth_labels=True, size=96).png != boxes.render(labels="all", size=96).png
    with pytest.raises(InvalidArgumentError, match="clip"):
        boxes.mesh(labels="all", smooth_labels=True, clip=isoscope.Clip(planes=[(1, 0, 0, 12)]))


def test_the_async_client_has_the_same(boxes):
    async def picture():
        async with isoscope.aio.connect(boxes._client.address, token_file=boxes._client.token_file) as client:
            dataset = await client.dataset()
            assert await dataset.present_labels() == boxes.labels
            return (await dataset.render(labels="all", size=64)).png

    assert asyncio.run(picture()) == boxes.render(labels="all", size=64).png


def test_listed_values_are_labels_or_the_error_says_why():
    from isoscope.data import LabelValues

    assert _core.listed(info(labels=KNOWN), LabelValues((0.0, 2.0, 3.0), False, None)) == (Label(2.0), KNOWN[1])
    assert _core.listed(info(labels=KNOWN), LabelValues((0.0,), True, None)) == KNOWN[1:]
    assert _core.listed(info(labels=KNOWN), LabelValues((), False, 0.5)) == KNOWN[1:]
    with pytest.raises(InvalidArgumentError, match="a sample is 0.5"):
        _core.listed(info(), LabelValues((), False, 0.5))
    with pytest.raises(InvalidArgumentError, match="more than 1 different"):
        _core.listed(info(), LabelValues((3.0,), True, None))


@pytest.mark.parametrize("kind", ["float", "double", "int32"])
def test_whole_numbers_of_every_type_are_labels(programs, tmp_path, kind):
    dtype = {"float": np.float32, "double": np.float64, "int32": np.int32}[kind]
    samples = np.zeros((12, 12, 12), dtype)
    samples[3:6, 3:6, 3:6] = 7
    samples[7:10, 3:6, 3:6] = 100000
    path = tmp_path / "labels.nrrd"
    path.write_bytes(
        f"NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 12 12 12\nendian: little\nencoding: raw\n\n".encode() + samples.tobytes()
    )
    with isoscope.serve(path) as client:
        dataset = client.dataset()
        assert dataset.present_labels() == (Label(7.0), Label(100000.0))
        mesh = dataset.mesh(labels="all")
    assert mesh.is_closed and len(mesh.isovalues) == 2
