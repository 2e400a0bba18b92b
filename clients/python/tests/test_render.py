"""Pictures, planes, picks, meshes and histograms of a real server, beside what `isoscope` itself says."""

import contextlib
import dataclasses
import json
import pickle
import subprocess

import numpy as np
import pytest

import isoscope
from grpc_services import Stub
from isoscope import ColorBy, Light, Silhouette, Surface
from isoscope._channel import make_channel
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope.errors import InvalidArgumentError

SIZE = {"size": (160, 120)}


def server_flags(client):
    return "--server", client.address, "--token-file", client.token_file


def by_command(run, client, tmp_path, *flags):
    """The PNG of `isoscope render` from the same server, as the server sent it."""
    path = tmp_path / "by_command.png"
    size = ("--width", 160, "--height", 120)
    run("render", *server_flags(client), "--no-metadata", *size, "--output", path, *flags)
    return path.read_bytes()


@pytest.mark.parametrize(
    "look, flags",
    [
        ({}, ()),
        ({"color": "#336699"}, ("--color", "0.2,0.4,0.6")),
        ({"azimuth": 33.3, "elevation": -20, "zoom": 1.7}, ("--azimuth", 33.3, "--elevation", -20, "--zoom", 1.7)),
        ({"view": "left", "azimuth": 10}, ("--view", "left", "--azimuth", 10)),
        ({"view": "top", "fit": "surface"}, ("--view", "top", "--fit", "surface")),
        ({"camera": ((90, 30, 80), (20, 40, 10), (0, 0, 1))},
         ("--eye", "90,30,80", "--target", "20,40,10", "--up", "0,0,1")),
        ({"background": (0.2, 0.4, 0.6, 0.5)}, ("--background", "0.2,0.4,0.6,0.5")),
        ({"clip": isoscope.Clip(planes=[(1, 0, 0, 20)], box=(0, 40, 10, 60, 2, 20))},
         ("--clip-plane", "1,0,0,20", "--clip-box", "0,40,10,60,2,20")),
        ({"lights": [Light((1, 1, 2), 0.8), Light((-1, 0, 0), 0.4)]},
         ("--light", "1,1,2:0.8", "--light", "-1,0,0:0.4")),
        ({"color_by": ColorBy("z", "turbo", (0, 20))}, ("--color-by", "z:turbo:0,20")),
        ({"color_by": ColorBy("normal")}, ("--color-by", "normal")),
        ({"samples": 4}, ("--samples", 4)),
        ({"ambient_occlusion": True, "silhouette": Silhouette(3, "red")},
         ("--ambient-occlusion", "--silhouette", "3:1,0,0")),
        ({"culling": "none"}, ("--culling", "none")),
        ({"region": (40, 30, 50, 60)}, ("--region", "40,30,50,60")),
    ],
    ids=lambda value: " ".join(map(str, value)) if isinstance(value, tuple) else None,
)  # fmt: skip
def test_a_frame_has_the_bytes_of_the_command_line(run, client, dataset, tmp_path, look, flags):
    frame = dataset.render(127.5, **SIZE, **look)
    assert frame.png == by_command(run, client, tmp_path, "--isovalue", 127.5, *flags)


def test_several_translucent_surfaces_have_the_bytes_of_the_command_line(run, client, dataset, tmp_path):
    frame = dataset.render(surfaces=[Surface(200), Surface(60, (0.5, 0.25, 0.75), opacity=0.5)], max_layers=3, **SIZE)
    flags = ("--surface", "200", "--surface", "60:0.5,0.25,0.75:0.5", "--max-layers", 3)
    assert frame.png == by_command(run, client, tmp_path, *flags)
    assert len(frame.stats.surfaces) == 2


def test_opacity_alone_keeps_the_default_colour(dataset):
    explicit = dataset.render(surfaces=Surface(127.5, opacity=1.0), **SIZE)
    assert explicit.png == dataset.render(127.5, **SIZE).png
    assert dataset.render(surfaces=Surface(127.5, opacity=0.5), **SIZE).png != explicit.png


def test_a_frame_has_the_bytes_of_the_unary_call(client, dataset):
    frame = dataset.render(127.5, azimuth=20, **SIZE)
    stub = Stub(make_channel(client._target), pb)
    response = stub.RenderIsosurface(frame._request, timeout=60, metadata=client._target.call_metadata())
    assert frame.png == response.png


def test_the_same_request_with_the_frames_camera_gives_the_same_bytes(dataset):
    frame = dataset.render(127.5, view="back", fit="surface", **SIZE)
    assert dataset.render(127.5, camera=frame.camera, **SIZE).png == frame.png


def test_pixels_are_those_of_every_format(dataset):
    frame = dataset.render(127.5, **SIZE)
    raw = dataset.render(127.5, format="rgba", **SIZE)
    assert frame.rgba.shape == (120, 160, 4) and frame.rgba.dtype == np.uint8
    assert (frame.rgba == raw.rgba).all() and (frame.rgb == raw.rgba[:, :, :3]).all()
    assert (np.asarray(frame) == frame.rgba).all()
    see_through = dataset.render(127.5, background=(0, 0, 0, 0), **SIZE)
    assert (see_through.rgba == dataset.render(127.5, background=(0, 0, 0, 0), format="rgba", **SIZE).rgba).all()
    assert see_through.rgba[0, 0, 3] == 0
    jpeg = dataset.render(127.5, format="jpeg", quality=80, **SIZE)
    assert jpeg.jpeg[:2] == b"\xff\xd8"
    with pytest.raises(isoscope.IsoscopeError, match='format="png"'):
        jpeg.rgb


def test_planes_come_with_the_frame_or_when_they_are_used(dataset):
    eager = dataset.render(127.5, planes=["depth", "surface_index", "position", "normal"], **SIZE)
    lazy = dataset.render(127.5, ambient_occlusion=True, samples=4, **SIZE)
    for name in ("depth", "surface_index", "position", "normal"):
        assert np.array_equal(getattr(eager, name), getattr(lazy, name), equal_nan=name in ("position", "normal")), name
    assert eager.depth.shape == (120, 160) and eager.normal.shape == (120, 160, 3)
    background = np.isinf(eager.depth)
    assert background.any() and (~background).any()
    assert (background == (eager.surface_index == 255)).all()
    assert (background == np.isnan(eager.position[:, :, 0])).all()
    forward = np.subtract(eager.camera.target, eager.camera.eye) / eager.camera.distance
    seen = eager.position[~background].astype(float)
    assert np.allclose((seen - eager.camera.eye) @ forward, eager.depth[~background], rtol=1e-5)
    lower, upper = np.reshape(dataset.bounds, (3, 2)).T
    assert ((seen > lower - 1e-3) & (seen < upper + 1e-3)).all()


def test_bounds_hold_the_depth_and_are_those_of_the_command_line(run, client, dataset, tmp_path):
    frame = dataset.render(127.5, planes=["depth", "depth_bounds"], **SIZE)
    assert frame.depth_bounds.shape == (120, 160, 2) and frame.depth_bounds.dtype == np.float32
    nearest, farthest = frame.depth_bounds[:, :, 0], frame.depth_bounds[:, :, 1]
    seen = np.isfinite(frame.depth)
    assert seen.any() and (nearest[seen] <= frame.depth[seen]).all() and (frame.depth[seen] <= farthest[seen]).all()
    proved = np.isinf(nearest)
    assert proved.any() and not (proved & seen).any() and (proved == np.isinf(farthest)).all()
    assert np.array_equal(dataset.render(127.5, **SIZE).depth_bounds, frame.depth_bounds)
    by_command(run, client, tmp_path, "--isovalue", 127.5, "--depth-bounds", tmp_path / "bounds.npy")
    assert np.array_equal(frame.depth_bounds, np.load(tmp_path / "bounds.npy"))


def test_depth_is_that_of_the_command_line(run, client, dataset, tmp_path):
    by_command(run, client, tmp_path, "--isovalue", 127.5, "--depth", tmp_path / "depth.npy")
    assert np.array_equal(dataset.render(127.5, **SIZE).depth, np.load(tmp_path / "depth.npy"))


def test_large_pictures_and_planes_pass_every_limit_of_messages(dataset):
    frame = dataset.render(127.5, size=(2600, 2200), format="rgba", planes=["position"])
    assert frame.rgba.nbytes > 4 << 20 and frame.position.shape == (2200, 2600, 3)


@pytest.mark.parametrize(
    "how",
    [{"azimuth": 30}, {"elevation": -20, "region": (40, 30, 50, 60)},
     {"camera": isoscope.Camera((60, 90, 80), (20, 35, 12), (0.1, 1, 0), height=70)}],
)  # fmt: skip
def test_points_are_positions_with_more_digits(dataset, how):
    frame = dataset.render(127.5, planes=["position", "depth"], **how, **SIZE)
    assert frame.points.dtype == np.float64 and frame.points.shape == frame.position.shape
    assert np.array_equal(np.isnan(frame.points), np.isnan(frame.position)) and np.isfinite(frame.points).any()
    assert np.allclose(frame.points, frame.position, rtol=1e-6, atol=1e-5, equal_nan=True)
    if "region" not in how:
        y, x = (int(indices[0]) for indices in np.nonzero(np.isfinite(frame.depth)))
        assert frame.points[y, x] == pytest.approx(frame.pick(x, y).position, rel=1e-13)


def test_picks_are_the_planes(dataset):
    frame = dataset.render(127.5, azimuth=30, **SIZE)
    rows, columns = np.nonzero(np.isfinite(frame.depth))
    x, y = int(columns[len(columns) // 2]), int(rows[len(rows) // 2])
    point = frame.pick(x, y)
    assert point.pixel == (x, y) and point.surface_index == 0 and point.is_hit
    assert np.float32(point.depth) == frame.depth[y, x]
    assert (np.float32(point.position) == frame.position[y, x]).all()
    assert dataset.pick((x, y), 127.5, azimuth=30, **SIZE) == point
    assert dataset.pick([(0, 0), (x, y)], frame=frame) == [None, point]
    assert np.dot(point.gradient, point.normal) < 0
    with pytest.raises(InvalidArgumentError, match="unknown argument 'samples'"):
        dataset.pick((x, y), 127.5, samples=4)
    with pytest.raises(InvalidArgumentError, match="isovalue can't be given with frame"):
        dataset.pick((x, y), 1, frame=frame)
    with pytest.raises(InvalidArgumentError, match="pixel"):
        dataset.pick((1, 2, 3), frame=frame)


def test_mesh_is_welded_and_closed_like_the_exported_one(run, client, dataset, tmp_path):
    mesh = dataset.mesh(127.5)
    assert mesh.points.dtype == np.float32 and mesh.triangles.dtype == np.int64
    assert mesh.triangles.min() == 0 and mesh.triangles.max() == len(mesh.points) - 1
    assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
    ply = tmp_path / "mesh.ply"
    run("export", *server_flags(client), "--isovalue", 127.5, "--output", ply)
    header = ply.read_bytes().split(b"end_header")[0].decode("ascii", "replace")
    assert f"element vertex {len(mesh.points)}\n" in header
    assert f"element face {len(mesh.triangles)}\n" in header
    points, triangles = mesh
    assert points is mesh.points and triangles is mesh.triangles


def test_a_sphere_has_its_area(programs):
    z, y, x = np.mgrid[0:40, 0:48, 0:56].astype(np.float32)
    field = 15 - np.sqrt((x * 0.5 - 14) ** 2 + (y * 0.6 - 14) ** 2 + (z * 0.7 - 14) ** 2)
    with isoscope.serve(field, spacing=(0.5, 0.6, 0.7), name="ball") as client:
        ball = client["ball"]
        assert ball.dims == (56, 48, 40) and ball.dtype == np.float32
        assert ball.mesh(5).area == pytest.approx(4 * np.pi * 10**2, rel=0.01)
        point = ball.pick((50, 50), 5, size=100, view="front")
        assert np.linalg.norm(np.subtract(point.position, 14)) == pytest.approx(10, abs=0.05)
        assert point.normal[2] > 0.9


def test_mesh_of_several_surfaces_comes_apart(dataset):
    both = dataset.mesh(surfaces=[60, Surface(200)], clip=isoscope.Plane.through(dataset.center, (1, 0, 0)))
    assert both.isovalues == (60, 200) and set(both.triangle_surface) == {0, 1}
    assert both.points[:, 0].min() >= dataset.center[0] - 1e-4
    alone = dataset.mesh(200, clip=isoscope.Plane.through(dataset.center, (1, 0, 0)))
    part = both.surface(1)
    assert len(part.triangles) == len(alone.triangles) and part.area == pytest.approx(alone.area)
    with pytest.raises(IndexError, match="surface 2"):
        both.surface(2)
    assert len(dataset.mesh(1e9).triangles) == 0


def test_datasets_tell_their_grid_range_and_state(client, dataset):
    assert list(client) == ["shells"] and "shells" in client and "head" not in client
    assert client.dataset() == dataset and dataset.refresh() == dataset
    assert dataset.dims == (48, 40, 32) and dataset.dtype == np.uint8 and dataset.range == (0, 255)
    assert dataset.spacing == (1, 1.5, 0.75) and dataset.origin == (-3, 7, 0.1)
    assert dataset.bounds == pytest.approx((-3, 44, 7, 65.5, 0.1, 0.1 + 31 * 0.75))
    assert dataset.shard_count == 3 and dataset.is_ready and dataset.missing_shards == ()
    assert "48 × 40 × 32" in dataset._repr_html_() and "shells" in repr(dataset)
    assert client.capabilities().max_viewport == 16384
    assert all(agent.is_reachable for agent in client.agents())


def test_histogram_counts_every_sample_and_is_that_of_the_command_line(run, client, dataset):
    histogram = dataset.histogram(bins=4096)
    assert histogram.has_sample_counts and histogram.sample_count.sum() == 48 * 40 * 32
    assert len(histogram.edges) == len(histogram) + 1 and (np.diff(histogram.edges) == 1).all()
    assert (histogram.centers == histogram.edges[:-1] + 0.5).all()
    text = run("info", *server_flags(client), "--histogram", "--json", "--bins", 4096)
    stated = json.dumps(json.loads(text))
    assert all(f"{suggestion.isovalue:g}" in stated for suggestion in dataset.suggestions())
    assert len(dataset.histogram(bins=10)) <= 10
    narrow = dataset.histogram(range=(100, 110))
    assert narrow.edges[0] <= 100 and narrow.edges[-1] >= 110 and len(narrow) < 20


def test_statistics_add_up(dataset):
    stats = dataset.render(127.5, **SIZE).stats
    assert stats.active_block_count == stats.visible_block_count + stats.culled_block_count
    assert stats.triangle_count > 0 and stats.seconds > 0 and stats.png_bytes > 0
    assert sum(agent.active_block_count for agent in stats.agents) == stats.active_block_count
    coloring = dataset.render(127.5, color_by=ColorBy("x"), **SIZE).colorings[0]
    assert coloring.color_by == ColorBy("x", "viridis", tuple(dataset.bounds[:2]))


def without_absent(values):
    return {name: value for name, value in values.items() if value is not None}


def test_statistics_picks_and_histograms_have_the_names_of_the_command_line(run, client, dataset, tmp_path):
    view = ["--isovalue", 127.5, "--width", 160, "--height", 120]
    run("render", *server_flags(client), *view, "--output", tmp_path / "f.png", "--stats", tmp_path / "s.json")
    (stated,) = json.loads((tmp_path / "s.json").read_text())["frames"]
    frame = dataset.render(127.5, **SIZE)
    same = ("active_block_count", "visible_block_count", "triangle_count", "unique_vertex_count", "png_bytes")
    for name in stated.keys() - {"wall_ms", "measures"}:  # of the program; Dataset.measure
        assert hasattr(frame.stats, name), name
    assert [getattr(frame.stats, name) for name in same] == [stated[name] for name in same]
    assert frame.stats.durations_ms.keys() == stated["durations_ms"].keys()
    for name in stated["agents"][0].keys() - {"shard"}:
        assert hasattr(frame.stats.agents[0], name), name

    pixels = [(80, 60), (0, 0)]
    text = run("pick", *server_flags(client), *view, "--json", *[f"--pixel={x},{y}" for x, y in pixels])
    hit, miss = json.loads(text)["points"]
    point, none = dataset.pick(pixels, 127.5, **SIZE)
    assert none is None and not miss["is_hit"]
    for name, value in without_absent(hit).items():
        mine = getattr(point, name)
        assert (list(mine) if isinstance(mine, tuple) else mine) == value, name

    stated = json.loads(run("info", *server_flags(client), "--histogram", "--json", "--bins", 16))["histogram"]
    histogram = dataset.histogram(bins=16)
    for name in stated["bins"][0].keys() - {"min", "max"}:
        assert getattr(histogram, name).tolist() == [one[name] for one in stated["bins"]], name
    assert histogram.has_sample_counts == stated["has_sample_counts"]
    methods = [one["method"].replace("-", "_") for one in stated["suggestions"]]
    assert [one.method for one in histogram.suggestions] == methods == ["between_classes", "one_percent"]


def test_pixels_lights_and_clips_come_as_any_sequence(dataset):
    pixels = [(80, 60), (0, 0)]
    expected = dataset.pick(pixels, 127.5, **SIZE)
    assert dataset.pick(((80, 60), (0, 0)), 127.5, **SIZE) == expected
    assert dataset.pick(np.array(pixels), 127.5, **SIZE) == expected
    assert dataset.pick(np.array([80, 60]), 127.5, **SIZE) == dataset.pick([80, 60], 127.5, **SIZE) == expected[0]
    lit = dataset.render(127.5, lights=[(0, 1, 1)], **SIZE).png
    assert dataset.render(127.5, lights=(0, 1, 1), **SIZE).png == lit
    assert dataset.render(127.5, lights=np.array([[0, 1, 1]]), **SIZE).png == lit
    plane = isoscope.Plane.through(dataset.center, (1, 0, 0))
    clipped = dataset.render(127.5, clip=plane, **SIZE).png
    assert dataset.render(127.5, clip=(plane,), **SIZE).png == clipped != dataset.render(127.5, **SIZE).png


def test_a_color_is_named_or_hexadecimal_wherever_there_is_one(dataset):
    def pictures(color):
        return [
            dataset.render(127.5, color=color, **SIZE).png,
            dataset.render(127.5, background=color, **SIZE).png,
            dataset.render(surfaces=[isoscope.Surface(127.5, color=color)], **SIZE).png,
            dataset.render(127.5, lights=[isoscope.Light((0, 0, 1), color=color)], **SIZE).png,
            dataset.render(127.5, silhouette=isoscope.Silhouette(color=color), **SIZE).png,
        ]

    assert pictures("RebeccaPurple") == pictures("#639") == pictures("#663399ff") == pictures((0.4, 0.2, 0.6))


def test_a_frame_is_saved_shown_and_pickled_with_its_exact_bytes(dataset, tmp_path):
    import base64

    frame = dataset.render(127.5, **SIZE)
    assert frame.save(tmp_path / "f.png").read_bytes() == frame.png == frame._repr_png_()
    assert (np.load(frame.save(tmp_path / "f.npy")) == frame.rgba).all()
    bundle = frame._repr_mimebundle_()
    assert base64.b64decode(bundle["image/png"]) == frame.png and "160 x 120" in bundle["text/plain"]
    for name in ("f.jpg", "f.tif"):
        with pytest.raises(isoscope.IsoscopeError):
            frame.save(tmp_path / name)
    again = pickle.loads(pickle.dumps(frame))
    assert again.png == frame.png and again.camera == frame.camera and (again.rgb == frame.rgb).all()
    with pytest.raises(isoscope.IsoscopeError, match="planes="):
        again.depth
    assert dataset.pick((80, 60), frame=again) == frame.pick(80, 60)


def test_the_servers_refusals_are_sentences_of_the_right_class(client, dataset):
    with pytest.raises(isoscope.NotFoundError, match='there are: "shells"') as caught:
        client["head"]
    assert isinstance(caught.value, LookupError) and caught.value.code == "NOT_FOUND"
    for look, words in (
        ({"isovalue": float("nan")}, "isovalue is nan"),
        ({"isovalue": 1, "size": (0, 5)}, "viewport.width_px is 0"),
        ({"isovalue": 1, "samples": 3}, "samples is 3"),
        ({"isovalue": 1, "format": "jpeg", "quality": 101}, "quality"),
        ({"isovalue": 1, "camera": ((1, 1, 1), (1, 1, 1))}, "must differ"),
        ({"surfaces": [1] * 129}, "surfaces"),
        ({"isovalue": 1, "lights": [(1, 0, 0)] * 5}, "lights"),
        ({"isovalue": 1, "lights": [(0, 0, 0)]}, "direction"),
    ):
        with pytest.raises(ValueError, match=words):
            dataset.render(**look)
    for look, words in (
        ({"format": "gif"}, "format 'gif'"),
        ({"planes": ["colour"]}, "plane 'colour'"),
        ({"culling": "all"}, "culling 'all'"),
        ({"color_by": ColorBy("w")}, "quantity 'w'"),
        ({"color_by": ColorBy("x", "jet")}, "map 'jet'"),
        ({"timeout": 0}, "timeout 0"),
    ):
        with pytest.raises(InvalidArgumentError, match=words):
            dataset.render(1, **look)


def test_messages_with_every_field_reach_the_server():
    """The request has fields for all that the API offers; those of later servers are refused by name."""
    fields = {field.name for field in pb.RenderIsosurfaceRequest.DESCRIPTOR.fields}
    # A trace is for operators: `isoscope render --trace`.
    assert fields - {"with_trace"} == {
        "dataset", "isovalue", "camera", "viewport", "culling", "base_color", "background_color", "ray_seed",
        "surfaces", "clip", "lights", "camera_fit", "region", "output", "ambient_occlusion", "silhouette", "samples",
        "max_layers", "caps", "allow_partial", "dataset_id", "selection", "nan_color", "with_notes", "level",
        "with_unresolved_count",
    }  # fmt: skip


def test_a_picture_of_some_shards_says_what_is_missing(programs, folder, dataset):
    """One agent of three: an error as ever, unless a part of the picture is allowed."""
    shard = sorted(path for path in folder.iterdir() if path.is_dir())[1]
    with contextlib.ExitStack() as stack:
        agent = start(stack, programs / "isoscope-agent", "agent_started", "--shard", shard)
        coordinator = start(stack, programs / "isoscope-coordinator", "coordinator_started", "--agent", agent)
        client = stack.enter_context(isoscope.connect(coordinator))
        while not any(agent.is_reachable for agent in client.agents()):
            pass
        with pytest.raises(isoscope.IsoscopeError, match="shards 0, 2 of 3"):
            client["shells"].render(127.5, **SIZE)
        frame = client["shells"].render(127.5, allow_partial=True, **SIZE)
        assert frame.stats.missing_shards == (0, 2)
        assert 0.1 < frame.stats.active_block_coverage < 0.6
    whole = dataset.render(127.5, allow_partial=True, **SIZE)
    assert whole.png == dataset.render(127.5, **SIZE).png != frame.png
    assert whole.stats.missing_shards == () and whole.stats.active_block_coverage is None


def start(stack, program, event, *flags):
    """Starts a server on a free port until the stack unwinds; returns its address."""
    command = [program, "--listen", "127.0.0.1:0", *flags]
    process = stack.enter_context(subprocess.Popen(command, stderr=subprocess.PIPE, text=True))
    stack.callback(process.kill)
    for line in process.stderr:
        if event in line:
            return line.split("address=")[1].split()[0]
    raise AssertionError(f"{program} ended")


def test_a_dataset_whose_contents_have_changed_is_an_error_that_names_both(client):
    dataset = client["shells"]
    other = dataclasses.replace(dataset, id="f" * 32)
    for call in (
        lambda: other.render(127.5, size=32),
        lambda: other.pick((1, 1), 127.5, size=32),
        lambda: other.mesh(127.5),
        lambda: other.histogram(),
    ):
        with pytest.raises(isoscope.errors.FailedPreconditionError, match=dataset.id + ".*" + "f" * 32):
            call()
