"""Cameras, colours, regions, addresses, errors and PNGs: what needs no server."""

import inspect
import math
import pickle
import re
import struct
import typing
import zlib

import grpc
import numpy as np
import pytest
from google.protobuf import any_pb2, duration_pb2

import isoscope
from isoscope import _answer, _call, _core, _messages, _png, _request
from isoscope._proto import geometry_pb2 as geometry_pb
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope._retry import told_delay
from isoscope.camera import _NAMED_VIEWS
from isoscope.errors import DataLossError, InvalidArgumentError, explain
from isoscope.look import as_clip, parse_color
from conftest import ROOT


def info(**changes):
    values = dict(
        name="v", id="0" * 32, source="v.nrrd", dims=(11, 21, 31), spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0),
        direction=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), dtype=np.dtype("u1"), range=(0.0, 255.0),
        block_cells=(8, 8, 8), block_count=1, shard_count=1,
    )  # fmt: skip
    return isoscope.DatasetInfo(**{**values, **changes})


def test_default_camera_frames_the_sphere_around_the_volume():
    camera = info().default_camera
    radius = math.sqrt(10**2 + 20**2 + 30**2) / 2
    assert camera.target == (5, 10, 15)
    assert camera.fov_y == 30
    assert camera.eye[:2] == (5, 10)
    assert camera.distance == pytest.approx(radius / math.sin(math.radians(15)))


def test_azimuth_of_90_degrees_looks_from_plus_x_and_elevation_from_plus_y():
    front = info().default_camera
    right = front.azimuth(90)
    assert np.subtract(right.eye, right.target) == pytest.approx([front.distance, 0, 0], abs=1e-9)
    above = front.elevation(45)
    assert np.subtract(above.eye, above.target) == pytest.approx(
        np.array([0, 1, 1]) * front.distance / math.sqrt(2), abs=1e-9
    )
    assert np.dot(above.up, np.subtract(above.eye, above.target)) == pytest.approx(0, abs=1e-9)


def test_elevation_to_the_pole_is_an_error_that_says_so():
    with pytest.raises(InvalidArgumentError, match="elevation 90 degrees"):
        isoscope.Camera((0, 0, 1), (0, 0, 0)).elevation(90)


def test_zoom_divides_angle_or_height_and_keeps_the_short_decimal():
    camera = isoscope.Camera((0, 0, 10), (0, 0, 0))
    assert camera.zoom(2).fov_y == 15
    assert camera.orthographic(4).zoom(2).height == 2
    assert camera.orthographic().height == pytest.approx(20 * math.tan(math.radians(15)))
    for factor in (0, -1, math.nan, math.inf):
        with pytest.raises(InvalidArgumentError, match="zoom"):
            camera.zoom(factor)


def test_patient_views_follow_the_patient_frame():
    lps = info(patient_frame="LPS").camera("anterior")
    assert np.subtract(lps.eye, lps.target)[1] < 0 and lps.up == (0, 0, 1)
    ras = info(patient_frame="RAS").camera("anterior")
    assert np.subtract(ras.eye, ras.target)[1] > 0
    assert np.subtract(*[getattr(info(patient_frame="LPS").camera("left"), end) for end in ("eye", "target")])[0] > 0
    assert np.subtract(*[getattr(info().camera("left"), end) for end in ("eye", "target")])[0] < 0
    with pytest.raises(InvalidArgumentError, match="no patient frame"):
        info().camera("superior")
    with pytest.raises(InvalidArgumentError, match="front, back, left"):
        info().camera("sideways")


def test_the_table_of_named_views_is_the_one_of_cpp():
    table = (ROOT / "core" / "view" / "named_views.inc").read_text()
    rows = re.findall(r'\{"(\w+)", NamedView::k\w+, \{\{(.*?)\}, \{(.*?)\}\}, "(\w*)"\}', table)
    vectors = [[tuple(map(int, row[at].split(", "))) for at in (1, 2)] for row in rows]
    expected = [(row[0], (*pair, row[3])) for row, pair in zip(rows, vectors)]
    assert len(rows) == 10 and list(_NAMED_VIEWS.items()) == expected


def test_camera_comes_back_from_json_and_from_messages_with_the_same_bits(tmp_path):
    for camera in (
        isoscope.Camera((0.1, 1 / 3, 1e300), (-0.0, 2.0, 3.0), (0, 1, 0.1), fov_y=1 / 7),
        isoscope.Camera((1, 2, 3), (4, 5, 6), height=math.pi),
    ):
        camera.save(tmp_path / "c.json")
        assert isoscope.Camera.load(tmp_path / "c.json") == camera
        assert _answer.camera(_messages.camera_message(camera)) == camera
    for wrong in ({}, {"eye": [1, 2], "target": [0, 0, 0], "perspective": {"fov_y_degrees": 3}}, {"eyes": 1}):
        with pytest.raises(InvalidArgumentError, match="camera"):
            isoscope.Camera.from_dict(wrong)


def test_bounds_and_world_from_index_follow_direction_spacing_and_origin():
    turned = info(
        dims=(3, 5, 9), spacing=(2.0, 1.0, 0.5), origin=(10.0, 0.0, 1.0),
        direction=((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    )  # fmt: skip
    assert turned.bounds == (6, 10, 0, 4, 1, 5)
    assert (turned.world_from_index @ [2, 4, 8, 1])[:3] == pytest.approx([6, 4, 5])
    assert turned.center == (8, 2, 3)


@pytest.mark.parametrize(
    "color, expected",
    [
        ("#ff0000", (1, 0, 0, 1)), ("#0f0", (0, 1, 0, 1)), ("#0000ff80", (0, 0, 1, 128 / 255)),
        ("White", (1, 1, 1, 1)), ("#00f8", (0, 0, 1, 136 / 255)), ("transparent", (0, 0, 0, 0)),
        ("lightgoldenrodyellow", (250 / 255, 250 / 255, 210 / 255, 1)),
        ((0.25, 0.5, 1), (0.25, 0.5, 1, 1)), (np.array([0, 0, 0, 0.5]), (0, 0, 0, 0.5)),
    ],
)  # fmt: skip
def test_colors_are_hex_names_or_numbers(color, expected):
    assert parse_color(color, "color") == expected


@pytest.mark.parametrize("color", ["#12", "nocolor", "", (1, 2, 3), (0, 0), 7, (0, 0, math.nan), "#gggggg"])
def test_wrong_colors_are_errors_that_show_the_value(color):
    with pytest.raises(InvalidArgumentError, match="color .*must be '#rrggbb'"):
        parse_color(color, "color")


def test_every_color_of_css_has_a_name():
    from isoscope.look import _NAMED_COLORS

    # 148 names and "transparent"; both spellings of grey.
    assert len(_NAMED_COLORS) == 149
    for name in [name for name in _NAMED_COLORS if "gray" in name]:
        assert parse_color(name, "color") == parse_color(name.replace("gray", "grey"), "color")


def statistics(**changes):
    counts = dict.fromkeys(
        ("active_block_count", "ray_hit_block_count", "visible_block_count", "culled_block_count",
         "occluding_block_count", "triangle_count", "unique_vertex_count", "read_bytes", "network_bytes", "png_bytes",
         "truncated_pixel_count"), 0)  # fmt: skip
    return isoscope.Statistics(**{**counts, **changes})


def test_colour_maps_and_effects_are_those_of_the_protos():
    from isoscope import look
    from isoscope._proto import options_pb2

    assert list(_messages.MAPS) == list(typing.get_args(look.ColorMap))
    assert list(_messages.QUANTITIES) == list(typing.get_args(look.Quantity))
    for name in _messages.EFFECTS:
        field = pb.RenderIsosurfaceRequest.DESCRIPTOR.fields_by_name[name]
        effect = getattr(isoscope, field.message_type.name)
        assert name in inspect.signature(isoscope.Dataset.render).parameters
        for value in field.message_type.fields:
            assert value.name.removesuffix("_px") in effect.__dataclass_fields__
            options = value.GetOptions().Extensions[options_pb2.value_options]
            if options.max > options.min:
                limits = (f"{options.min:g} to {options.max:g}", f"[{options.min:g}, {options.max:g}]")
                assert any(text in effect.__doc__ for text in limits), f"{name}: the docs have other limits"


def test_effects_send_what_they_have():
    request = _request.frame(info(), 1)
    _request.set_appearance(
        request, color=None, background=None, lights=(), color_by=None, nan_color=None, samples=None, culling="depth",
        effects={"ambient_occlusion": isoscope.AmbientOcclusion(8, 0.0), "silhouette": True},
    )  # fmt: skip
    assert request.ambient_occlusion.radius_px == 8 and request.ambient_occlusion.HasField("strength")
    assert request.HasField("silhouette") and request.silhouette.ByteSize() == 0
    with pytest.raises(InvalidArgumentError, match="silhouette width 'x'"):
        _messages.set_effect(request.silhouette, isoscope.Silhouette("x"), "silhouette")


def test_plane_through_a_point_keeps_the_side_of_its_normal():
    plane = isoscope.Plane.through((1, 2, 3), (0, 2, 0))
    assert (plane.normal, plane.offset) == ((0, 2, 0), 4)


def test_clip_is_a_plane_a_box_or_both():
    assert as_clip((0, 1, 2, 3, 4, 5)).box == (0, 1, 2, 3, 4, 5)
    region, caps = _messages.clip_messages(isoscope.Clip(planes=[(1, 0, 0, 5)], box=(0, 1, 2, 3, 4, 6), caps=True))
    assert region.half_spaces[0].offset == 5 and region.box.max.z == 6 and caps is not None
    with pytest.raises(InvalidArgumentError, match="x_min, x_max"):
        _messages.clip_messages((1, 2, 3))


def test_ranges_are_numbers_or_where_they_come_from():
    def caps(*of):
        return _messages.clip_messages(isoscope.Clip(box=(0, 1, 0, 1, 0, 1), caps=isoscope.Caps(*of)))[1]

    assert (caps("grey").range.percentiles.low, caps("grey").range.percentiles.high) == (2, 98)
    assert not caps("grey", None, None).HasField("range") and not caps("grey", "all").HasField("range")
    assert not caps().HasField("range"), "caps with the colour of their surface have no window"
    assert caps("grey", (1, 3)).range == pb.ColorRange(min=1, max=3)
    assert caps("grey", "step").range == pb.ColorRange(source="SOURCE_STEP")
    by_z = _messages.color_by_message(isoscope.ColorBy("z", range="visible"))
    assert by_z.range == pb.ColorRange(source="SOURCE_VISIBLE")
    assert not _messages.color_by_message(isoscope.ColorBy("z", range="all")).HasField("range")
    for wrong, words in ((("grey", "seen"), "caps range 'seen': must be one of 'all', 'step', 'visible'"),
                         (("grey", None, (98, 2)), "caps window"), (("grey", None, (0, 101)), "caps window")):  # fmt: skip
        with pytest.raises(InvalidArgumentError, match=words):
            caps(*wrong)


def test_older_servers_get_no_window_that_nobody_asked_for():
    limits = dict(version="1", max_viewport=1, max_concurrent_frames=1, max_queued_frames=1, max_message_bytes=1,
                  max_frame_seconds=1.0)  # fmt: skip
    old = isoscope.Capabilities(**limits)
    new = isoscope.Capabilities(**limits, features=frozenset({"color_ranges"}))

    def expected(caps, capabilities):
        request = _request.frame(info(), 1, clip=isoscope.Clip(box=(0, 1, 0, 1, 0, 1), caps=caps))
        _request.expect_dataset(request, info(), capabilities)
        return request.caps.HasField("range")

    assert expected(isoscope.Caps("grey"), new)
    assert not expected(isoscope.Caps("grey"), old) and not expected(isoscope.Caps("grey"), None)
    for caps in (isoscope.Caps("grey", "step"), isoscope.Caps("grey", window=(5, 95))):
        assert expected(caps, new)
        with pytest.raises(isoscope.FailedPreconditionError, match="version 1, does not know ranges"):
            expected(caps, old)


@pytest.mark.parametrize(
    "look, words",
    [
        ({}, "isovalue=..."), ({"isovalue": 1, "surfaces": [1]}, "not both"), ({"surfaces": []}, "1 to 128"),
        ({"isovalue": "x"}, "isovalue 'x'"), ({"isovalue": 1, "size": (1.5, 2)}, "size"),
        ({"isovalue": 1, "size": 2**40}, "size"), ({"isovalue": 1, "region": (1, 2)}, "region"),
        ({"isovalue": 1, "max_layers": "a"}, "max_layers 'a'"), ({"isovalue": 1, "fit": "all"}, "fit 'all'"),
        ({"isovalue": 1, "camera": ((0, 0, 1), (0, 0, 0)), "view": "front"}, "camera can't"),
        ({"isovalue": 1, "camera": "front"}, "isoscope.Camera"),
        ({"isovalue": 1, "camera": ((0, 0), (1, 2, 3))}, "eye"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_named_before_anything_is_sent(look, words):
    isovalue = look.pop("isovalue", None)
    with pytest.raises(InvalidArgumentError, match=words):
        _request.frame(info(), isovalue, **look)


def features(*names):
    return isoscope.Capabilities("1", 1, 1, 1, 1, 1.0, features=frozenset(names))


def test_without_anything_of_the_camera_the_server_places_it_if_it_can():
    request = _request.frame(info(), 1, capabilities=features("fit_cells"))
    assert not request.HasField("camera") and request.camera_fit == _messages.FITS["cells"]
    # An older server refuses the fit: the client has the same direction, for the volume.
    look = _messages.FIRST_LOOK
    for capabilities in (None, features()):
        request = _request.frame(info(), 1, capabilities=capabilities)
        assert request.camera_fit == _messages.FITS["volume"]
        turned = info().camera("front", look.azimuth_degrees, look.elevation_degrees)
        assert request.camera == _messages.camera_message(turned)
    patient = info(patient_frame="LPS")
    assert _request.frame(patient, 1).camera == _messages.camera_message(patient.camera("anterior"))


@pytest.mark.parametrize("given", [{"azimuth": 0}, {"elevation": 0}, {"zoom": 1}, {"view": "front"}, {"fit": "volume"}])
def test_with_anything_of_the_camera_it_begins_at_the_front(given):
    request = _request.frame(info(), 1, capabilities=features("fit_cells"), **given)
    assert request.camera == _messages.camera_message(info().camera())
    assert request.camera_fit == _messages.FITS["volume"]
    assert not _request.asks_first_look(**given)


def test_the_first_look_fills_in_what_is_not_given():
    look = _messages.FIRST_LOOK
    own = isoscope.Material(specular=0.5)
    request = _request.frame(info(), None, surfaces=[1, isoscope.Surface(2, material=own)])
    _request.set_first_look(request)
    assert request.samples == look.samples
    first, second = (surface.material for surface in request.surfaces)
    assert (first.diffuse, first.specular, first.shininess) == (look.diffuse, look.specular, look.shininess)
    # With the default ambient share they add up to 1: no colour is burnt out.
    assert abs(0.12 + look.diffuse + look.specular - 1) < 1e-6
    assert second.HasField("specular") and not second.HasField("diffuse")
    large = _request.frame(info(), 1, size=(12000, 4096))
    _request.set_first_look(large)
    assert large.samples == look.samples and large.surfaces[0].isovalue == 1 and large.isovalue == 0
    plain = _request.frame(info(), 1)
    plain.viewport.width_px = 32769
    _request.set_first_look(plain)
    assert plain.samples == 0
    sampled = _request.frame(info(), 1)
    sampled.samples = 1
    _request.set_first_look(sampled)
    assert sampled.samples == 1


def test_requests_name_the_contents_that_they_mean_if_the_server_knows_the_field():
    limits = dict(version="1", max_viewport=1, max_concurrent_frames=1, max_queued_frames=1, max_message_bytes=1,
                  max_frame_seconds=1.0)  # fmt: skip
    for capabilities, expected in (
        (None, ""),
        (isoscope.Capabilities(**limits), ""),  # an older server refuses fields that it doesn't know
        (isoscope.Capabilities(**limits, features=frozenset({"dataset_id"})), "0" * 32),
    ):
        for request in (
            _request.frame(info(), 1),
            _request.export(info(), 1, None, None),
            _request.histogram(info(), 8, None),
        ):
            _request.expect_dataset(request, info(), capabilities)
            assert request.dataset_id == expected


# ------------------------------------------------------------------------------------ PNG


def filtered_png(pixels, filters):
    """A PNG whose rows have the given filters, written pixel by pixel as the standard says."""
    height, width, channels = pixels.shape
    raw = bytearray()
    for y in range(height):
        kind = filters[y % len(filters)]
        raw.append(kind)
        for x in range(width):
            for channel in range(channels):
                left = int(pixels[y, x - 1, channel]) if x else 0
                up = int(pixels[y - 1, x, channel]) if y else 0
                corner = int(pixels[y - 1, x - 1, channel]) if x and y else 0
                estimate = left + up - corner
                paeth = min((left, up, corner), key=lambda side: abs(estimate - side))
                guess = (0, left, up, (left + up) // 2, paeth)[kind]
                raw.append((int(pixels[y, x, channel]) - guess) % 256)

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    packed = zlib.compress(bytes(raw))
    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    half = len(packed) // 2
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"tEXt", b"k\0v")
        + chunk(b"IDAT", packed[:half]) + chunk(b"IDAT", packed[half:]) + chunk(b"IEND", b"")
    )  # fmt: skip


@pytest.mark.parametrize("filters", [(0,), (1,), (2,), (3,), (4,), (0, 2, 2, 1, 4, 3, 2)])
@pytest.mark.parametrize("channels", [3, 4])
def test_png_of_every_filter_is_decoded(filters, channels):
    pixels = np.random.default_rng(3).integers(0, 256, (11, 7, channels), dtype=np.uint8)
    assert (_png.decode(filtered_png(pixels, filters)) == pixels).all()
    assert (_png.decode(_png.encode(pixels)) == pixels).all()


def test_damaged_pngs_are_data_loss_and_never_something_else():
    png = filtered_png(np.zeros((3, 4, 3), np.uint8), (2,))
    rng = np.random.default_rng(5)
    for cut in range(len(png)):
        with pytest.raises(DataLossError):
            _png.decode(png[:cut])
    for _ in range(300):
        damaged = bytearray(png)
        damaged[rng.integers(len(png))] ^= int(rng.integers(1, 256))
        try:
            _png.decode(bytes(damaged))
        except DataLossError:
            pass


# ------------------------------------------------------------------------------------ addresses, errors


def target(address, **changes):
    return _core.connection(address, **changes)[0]


def test_an_address_without_a_port_has_the_coordinators_wherever_it_is_resolved():
    for address, expected in {
        "host": "host:50051", " host ": "host:50051", "host:1": "host:1",
        "::1": "[::1]:50051", "[::1]": "[::1]:50051", "[::1]:7": "[::1]:7",
        "dns:host": "dns:host:50051", "dns:///host": "dns:///host:50051", "dns:///h:1": "dns:///h:1",
        "dns://192.0.2.1/host": "dns://192.0.2.1/host:50051", "dns:///host:7": "dns:///host:7",
        "ipv4:192.0.2.1,192.0.2.2:7": "ipv4:192.0.2.1:50051,192.0.2.2:7", "ipv6:[::1]": "ipv6:[::1]:50051",
        "unix:/run/isoscope": "unix:/run/isoscope", "unix:/tmp/s": "unix:/tmp/s",
    }.items():  # fmt: skip
        assert target(address).address == expected


@pytest.mark.parametrize("address", ["", "host:port", "host:0", "host:99999", ":1", "http://host:1/"])
def test_wrong_addresses_are_errors_that_say_what_is_expected(address):
    with pytest.raises(InvalidArgumentError, match="HOST:PORT"):
        target(address)


def test_a_token_leaves_this_machine_only_encrypted():
    assert target("localhost:1", token="t").call_metadata() == (("authorization", "Bearer t"),)
    assert target("127.0.0.1:1", token="t").token == "t"
    assert target("[::1]:1", token="t").token == target("unix:/tmp/s", token="t").token == "t"
    for address in (
        "host:1", "10.0.0.1:1", "192.0.2.7", "0.0.0.0:1", "[2001:db8::1]:1", "2001:db8::1", "localhost.example.org:1",
        "dns:///host:1", "ipv4:192.0.2.7:1",
    ):  # fmt: skip
        with pytest.raises(InvalidArgumentError, match="unencrypted"):
            target(address, token="t")
    assert target("host:1", token="t", tls=True).tls
    assert not target("host:1", token="t", allow_insecure_token=True).tls
    assert "secret" not in repr(target("localhost", token="secret"))


class Refusal:
    """An error of gRPC with google.rpc.Status as its details, whose RetryInfo has these bytes."""

    def __init__(self, info, code=grpc.StatusCode.RESOURCE_EXHAUSTED):
        detail = any_pb2.Any(type_url="type.googleapis.com/google.rpc.RetryInfo", value=info).SerializeToString()
        self.details = b"\x08\x08\x1a" + bytes([len(detail)]) + detail
        self._code = code

    def code(self):
        return self._code

    def trailing_metadata(self):
        return (("grpc-status-details-bin", self.details),)


def retry_info(**duration):
    delay = duration_pb2.Duration(**duration).SerializeToString()
    return b"\x0a" + bytes([len(delay)]) + delay


def test_a_refusal_tells_its_delay_unless_it_is_damaged_negative_or_of_another_code():
    assert told_delay(Refusal(retry_info(seconds=1, nanos=500_000_000))) == 1.5
    assert told_delay(Refusal(retry_info(), grpc.StatusCode.UNAVAILABLE)) == 0
    assert told_delay(Refusal(retry_info(seconds=1), grpc.StatusCode.INTERNAL)) is None
    assert told_delay(Refusal(retry_info(seconds=-1))) is None  # nobody can sleep that long
    # Other details before it, and fields that a later version may have.
    other = any_pb2.Any(type_url="type.googleapis.com/google.rpc.ErrorInfo", value=b"\x0a\x01x").SerializeToString()
    several = Refusal(retry_info(seconds=2) + b"\x10\x07\x1d\0\0\0\0")
    several.details = b"\x1a" + bytes([len(other)]) + other + several.details
    assert told_delay(several) == 2
    # It says five bytes, and has the two of another number.
    assert told_delay(Refusal(b"\x0a\x05\x08\x01")) is None


def test_tls_arguments_fit_each_other():
    assert target("h", ca_file="ca.pem").tls
    with pytest.raises(InvalidArgumentError, match="belong together"):
        target("h", cert_file="c.pem")
    with pytest.raises(InvalidArgumentError, match="tls=False"):
        target("h", tls=False, ca_file="ca.pem")
    with pytest.raises(InvalidArgumentError, match="can't read 'missing.pem'"):
        target("h", ca_file="missing.pem").credentials()


class Failed(grpc.RpcError):
    def __init__(self, code, details, metadata=()):
        self._code, self._details, self._metadata = code, details, metadata

    def code(self):
        return self._code

    def details(self):
        return self._details

    def trailing_metadata(self):
        return self._metadata


@pytest.mark.parametrize("code", [code for code in grpc.StatusCode if code is not grpc.StatusCode.OK])
def test_every_code_is_an_isoscope_error_with_the_servers_sentence(code):
    error = explain(Failed(code, "dataset \"x\" is odd"), "h:1", 1.0, False)
    assert isinstance(error, isoscope.IsoscopeError)
    assert error.code == code.name
    assert 'dataset "x" is odd' in str(error)
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.code) == (type(error), str(error), error.code)


# Symptom: a connection that broke on a flipped bit, or a coordinator that shut down, was UNKNOWN or CANCELLED.
@pytest.mark.parametrize("code, words", [("UNKNOWN", "Stream removed"), ("CANCELLED", "CANCELLED")])
def test_connection_that_broke_is_unavailable(code, words):
    error = explain(Failed(grpc.StatusCode[code], words), "h:1", 1.0, False)
    assert isinstance(error, isoscope.UnavailableError)
    assert "h:1" in str(error) and words in str(error)
    assert explain(Failed(grpc.StatusCode[code], "Channel closed!"), "h:1", 1.0, False).code == code


@pytest.mark.parametrize(
    "error, own",
    [
        ("NotFound", LookupError), ("InvalidArgument", ValueError), ("Unavailable", ConnectionError),
        ("DeadlineExceeded", TimeoutError),
    ],
)  # fmt: skip
def test_errors_are_also_pythons_own_classes(error, own):
    assert issubclass(getattr(isoscope, f"{error}Error"), own)


# ------------------------------------------------------------------------------------ the core: tries and answers


BUSY = retry_info(seconds=1)


@pytest.mark.parametrize(
    "code, info, has_taken, timeout, expected",
    [
        ("RESOURCE_EXHAUSTED", BUSY, False, 10, 1), ("UNAVAILABLE", BUSY, False, 10, 1),
        ("RESOURCE_EXHAUSTED", BUSY, True, 10, isoscope.ResourceExhaustedError),  # a part of the answer has come
        ("RESOURCE_EXHAUSTED", BUSY, False, 0.5, isoscope.ResourceExhaustedError),  # its time is up before that
        ("RESOURCE_EXHAUSTED", None, False, 10, isoscope.ResourceExhaustedError),  # it can never fit
        ("INTERNAL", BUSY, False, 10, isoscope.InternalError), ("NOT_FOUND", None, False, 10, isoscope.NotFoundError),
    ],
)  # fmt: skip
def test_a_call_is_tried_again_where_the_server_tells_when_and_nothing_has_come(code, info, has_taken, timeout, expected):
    connection = _call.Connection(target("localhost:1"), None)
    call = _call.Call(None, _call.One(lambda message: message), timeout)
    if has_taken:
        call.add("a part")
    error = Failed(grpc.StatusCode[code], "a sentence", Refusal(info).trailing_metadata() if info else ())
    if isinstance(expected, int):
        assert connection._delay_after(error, call, connection._retries(call)) == expected
    else:
        with pytest.raises(expected, match="a sentence"):
            connection._delay_after(error, call, connection._retries(call))


def test_signs_of_life_of_an_export_are_no_part_of_the_answer():
    request = pb.ExportIsosurfaceRequest(isovalue=1, surfaces=[pb.Surface(isovalue=1)], with_measures=True)
    sign = pb.ExportIsosurfaceResponse(origin=geometry_pb.Vec3(x=1))
    call = _call.Call(request, _answer.MeasuresOfSurfaces(request))
    call.add(sign)
    assert not call.has_taken, "so that it may be tried again"
    call.add(pb.ExportIsosurfaceResponse(measures=pb.SurfaceMeasures(area=3)))
    assert call.has_taken and call.result(None)[0].area == 3
    mesh = _call.Call(request, _answer.MeshParts(request))
    mesh.add(sign)
    mesh.add(pb.ExportIsosurfaceResponse(positions=b"\0" * 12, normals=b"\0" * 12))
    assert mesh.has_taken and mesh.result(None).points.tolist() == [[0, 0, 0]]


def test_an_answer_without_a_message_is_an_error_and_a_timeout_is_above_0():
    with pytest.raises(isoscope.InternalError, match="without a message"):
        _core.capabilities(None).result(None)
    with pytest.raises(InvalidArgumentError, match="timeout 0"):
        _call.Connection(target("localhost:1"), None)._retries(_core.capabilities(0))


def test_an_answer_tells_its_bands_and_an_older_server_drew_at_once():
    from isoscope._proto import frame_pb2

    assert _answer.statistics(frame_pb2.RenderStatistics(band_count=12)).band_count == 12
    assert _answer.statistics(frame_pb2.RenderStatistics()).band_count == 1


def test_what_a_level_hides_is_told_if_it_is_known():
    from isoscope import _answer
    from isoscope._proto import frame_pb2

    assert _answer.statistics(frame_pb2.RenderStatistics()).unresolved_block_count is None
    for count in (0, 7):
        proto = frame_pb2.RenderStatistics(unresolved_block_count=count)
        assert _answer.statistics(proto).unresolved_block_count == count
