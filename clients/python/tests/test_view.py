"""`Dataset.view`: the exact picture always, the inlined viewer with a gateway, the widget with anywidget."""

import base64
import functools
import json
import pathlib
import queue
import re
import shutil
import struct
import subprocess
import sys
import threading
import types

import pytest

import isoscope
from isoscope import _png, _viewer_module, viewer
from isoscope._kernel_frames import KernelFrames
from isoscope._proto import interact_service_pb2 as interact_pb
from isoscope.errors import InvalidArgumentError
from proxy import Proxy

ROOT = pathlib.Path(__file__).resolve().parents[3]
GATEWAY = "http://localhost:8080/"


@pytest.fixture(scope="module")
def client(folder):
    """A client of a server that is somebody else's: no view of it starts a gateway."""
    with isoscope.serve(folder, renderer="cpu", threads=2) as served:
        with isoscope.connect(served.address, token_file=served.token_file) as client:
            yield client


@pytest.fixture(scope="module")
def dataset(client):
    return client["shells"]


@pytest.fixture(autouse=True)
def fresh_widget_class():
    viewer._widget_class.cache_clear()
    yield
    viewer._widget_class.cache_clear()


@pytest.fixture
def module(monkeypatch):
    """A stand-in for isoscope-view.js with what must be escaped in a page."""
    text = "// </script> <!-- \u2028\nexport function mount(element, options) {}\nexport default {};\n"
    monkeypatch.setattr(_viewer_module, "text", lambda: text)
    return text


def test_the_module_of_a_cell_is_one_and_has_the_exports_of_the_parts(tmp_path):
    parts = ROOT / "clients" / "web" / _viewer_module.NAME
    text = _viewer_module.text()
    assert text == _viewer_module.assemble(parts) and not re.search(r"^import |^export .* from ", text, re.MULTILINE)
    if shutil.which("node"):
        whole = tmp_path / "whole.mjs"
        whole.write_text(text)
        # A name that two parts have at their top is a SyntaxError here.
        script = f"for (const path of {json.dumps([str(parts), str(whole)])})" + (
            "{ const all = await import(path); console.log(Object.keys(all).join(), typeof all.default.render); }"
        )
        done = subprocess.run(
            ["node", "--input-type=module", "-"], input=script, text=True, capture_output=True, check=True
        )
        first, second = done.stdout.splitlines()
        assert first == second and "mount" in first and first.endswith(" function")


def test_without_a_gateway_the_cell_is_the_exact_picture_and_says_what_to_start(dataset, module, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    view = dataset.view(127.5, size=(120, 90))
    assert view.widget is None
    bundle = view._repr_mimebundle_()
    png = dataset.render(127.5, size=(120, 90), background=(0, 0, 0, 0)).png
    assert base64.b64decode(bundle["image/png"]) == png
    assert base64.b64encode(png).decode() in bundle["text/html"]
    assert "start the web gateway" in bundle["text/html"] and "<script" not in bundle["text/html"]
    # The way to the token, and never the token: the cell is saved.
    token_file = dataset._client.token_file
    assert f"--token-file {token_file} " in bundle["text/html"]
    assert pathlib.Path(token_file).read_text() not in str(bundle)
    assert "the exact picture" in repr(view) and view.picked is None


def test_the_suggested_isovalue_is_the_default(dataset):
    assert dataset.view(size=(32, 32)).state["surfaces"][0]["isovalue"] == dataset.suggestions()[0].isovalue


def test_the_gateway_is_the_one_that_the_server_names(client, dataset, monkeypatch, module):
    named = isoscope.Capabilities("1", 1, 1, 1, 1, 1.0, gateway_address="https://host:8080/")
    monkeypatch.setattr(type(client), "capabilities", lambda self: named)
    assert dataset.view(127.5, size=(32, 32)).gateway == "https://host:8080/"
    assert dataset.view(127.5, size=(32, 32), gateway="/proxy/8080/").gateway == "/proxy/8080/"
    with pytest.raises(InvalidArgumentError, match="gateway 'host:1'"):
        dataset.view(127.5, gateway="host:1")
    with pytest.raises(InvalidArgumentError, match="origin 'http://a:1': is for the gateway that a client of isoscope.serve"):
        dataset.view(127.5, origin="http://a:1")


def test_the_inlined_viewer_gets_the_state_and_ends_no_script_early(dataset, module, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    view = dataset.view(127.5, view="top", size=(120, 90), gateway=GATEWAY)
    html = view._repr_mimebundle_()["text/html"]
    script = re.search(r"<script>(.*)</script>", html, re.DOTALL).group(1)
    assert "</script" not in script and "<!--" not in script and html.count("</script") == 1
    options = json.loads(re.search(r"const options = (.*);", script).group(1))
    assert options["url"] == GATEWAY and options["state"] == view.state
    assert options["state"]["dataset"] == "shells" and options["state"]["isovalue"] == 127.5
    assert "eye" in options["state"]["camera"] and "viewport" not in options["state"]
    text = json.loads(re.search(r"const text = (\".*\");", script).group(1))
    assert text == module
    picture = dataset.render(127.5, view="top", size=(120, 90), background=(0, 0, 0, 0))
    assert base64.b64encode(picture.png).decode() in html
    assert script.index("options.state.backgroundColor ??= ") < script.index("mount(live, options)")
    if shutil.which("node"):
        subprocess.run(["node", "--check", "-"], input=script, text=True, check=True)


def test_a_wheel_without_the_viewer_says_so(dataset, monkeypatch):
    monkeypatch.setattr(_viewer_module, "text", lambda: None)
    view = dataset.view(127.5, size=(32, 32), gateway=GATEWAY)
    assert "without isoscope-view.js" in view._repr_mimebundle_()["text/html"] and "without" in repr(view)


class AnyWidget:
    """As much of anywidget.AnyWidget as the package uses."""

    def __init__(self, **values):
        self.picked = None
        self.handlers, self.observers, self.sent = [], [], queue.Queue()
        self.__dict__.update(values)

    def observe(self, handler, names):
        assert names == "comm"
        self.observers.append(handler)

    def close(self):
        """The comm goes, as when the cell is cleared."""
        for handler in self.observers:
            handler({"new": None})

    def on_msg(self, handler):
        self.handlers.append(handler)

    def send(self, content, buffers):
        self.sent.put((content, buffers))

    def receive(self, content):
        """A message from the browser."""
        for handler in self.handlers:
            handler(self, content, [])

    def frame(self):
        """The next frame that goes to the browser: JSON, image, depths."""
        content, (message,) = self.sent.get(timeout=30)
        assert content == {"type": "isoscope/frame"}
        (size,) = struct.unpack_from("<I", message)
        values = json.loads(message[4 : 4 + size])
        end = 4 + size + values["image"]["bytes"]
        assert len(message) == end + values["depthBytes"]
        return values, message[4 + size : end], message[end:]

    def _repr_mimebundle_(self):
        return {"application/vnd.jupyter.widget-view+json": {"model_id": "m"}, "text/plain": "a widget"}, {}


@pytest.fixture
def anywidget(monkeypatch, module):
    trait = types.SimpleNamespace(tag=lambda **_: None)
    traits = {name: lambda *_: trait for name in ("Unicode", "Dict", "Int", "Any")}
    monkeypatch.setitem(sys.modules, "anywidget", types.SimpleNamespace(AnyWidget=AnyWidget))
    monkeypatch.setitem(sys.modules, "traitlets", types.SimpleNamespace(**traits))


def test_with_anywidget_the_browsers_state_is_the_views(dataset, anywidget):
    view = dataset.view(127.5, size=(120, 90), gateway=GATEWAY)
    bundle = view._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in bundle and "text/html" not in bundle
    assert base64.b64decode(bundle["image/png"]) == dataset.render(127.5, size=(120, 90), background=(0, 0, 0, 0)).png
    assert view.widget.url == GATEWAY and view.widget.height == 90 and view.widget._esm.startswith("//")
    turned = dataset.render(60, azimuth=40, size=(120, 90))
    view.widget.state = {**isoscope_state(turned), "isovalue": 60, "laterField": 1}
    assert view.camera == turned.camera
    assert view.snapshot().png == turned.png
    assert view.snapshot(size=(60, 60)).size == (60, 60)


def test_the_saved_picture_lies_on_a_notebook_of_any_theme_unless_it_has_a_background(dataset, monkeypatch):
    monkeypatch.setitem(sys.modules, "anywidget", None)
    view = dataset.view(127.5, size=(64, 48))
    saved = _png.decode(base64.b64decode(view._repr_mimebundle_()["image/png"]))
    assert saved[0, 0, 3] == 0 and saved[24, 32, 3] == 255 and (saved[..., 3] == 0).mean() > 0.2
    assert (view.snapshot().rgba[..., 3] == 255).all(), "a snapshot is as Dataset.render gives it"
    view.state = {**view.state, "backgroundColor": {"red": 1, "green": 1, "blue": 1, "alpha": 1}}
    assert view._repr_mimebundle_()["image/png"] == base64.b64encode(view.snapshot().png).decode()


def test_a_view_of_nothing_warns_and_names_the_range(dataset):
    view = dataset.view(1e6, size=(32, 32))
    with pytest.warns(isoscope.SurfaceWarning, match="isovalue 1000000 has no surface: .*are in"):
        view._repr_mimebundle_()


def test_the_state_can_be_set_and_is_checked(dataset):
    view = dataset.view(127.5, size=(64, 64))
    view.state = {"dataset": "shells", "isovalue": 60}
    assert view.snapshot().png == dataset.render(60, view="front", size=64).png
    with pytest.raises(InvalidArgumentError, match="isovalues"):
        view.state = {"isovalues": 3}


def isoscope_state(frame):
    camera = frame.camera
    vector = lambda value: dict(zip("xyz", value))  # noqa: E731
    return {
        "camera": {
            "eye": vector(camera.eye), "target": vector(camera.target), "up": vector(camera.up),
            "perspective": {"fovYDegrees": camera.fov_y},
        }
    }  # fmt: skip


def state_message(sequence_number, frame, **state):
    view_state = {"sequenceNumber": str(sequence_number), "frame": frame, **state}
    return {"type": "isoscope/interact", "text": json.dumps({"viewState": view_state})}


def test_frames_come_through_the_kernel_where_the_browser_asks_for_it(client, anywidget):
    def interact(requests, upstream):
        """A server's side: a moving frame for each state, the exact one at rest."""
        for number, request in enumerate(requests, 1):
            if request.HasField("frame_shown"):
                continue
            frame = upstream.RenderIsosurface(request.view_state.frame, timeout=30)
            response = interact_pb.InteractResponse(
                sequence_number=request.view_state.sequence_number, frame_number=number, frame=frame,
                is_exact=request.view_state.is_at_rest,
            )  # fmt: skip
            response.depth_grid.width, response.depth_grid.depths = 2, b"\1\0\2\0"
            yield response

    with Proxy(client, interact=interact) as proxy, isoscope.connect(proxy.address) as through:
        dataset = through["shells"]
        view = dataset.view(127.5, size=(64, 48))
        assert "the kernel" in repr(view)
        frame = {**view.state, "viewport": {"widthPx": 64, "heightPx": 48}, "dataset": "another"}
        view.widget.receive({"type": "isoscope/open"})
        view.widget.receive(state_message(5, frame, isAtRest=True))
        values, image, depths = view.widget.frame()
        assert values["sequenceNumber"] == "5" and values["isExact"] and values["image"]["type"] == "image/png"
        assert image == dataset.render(127.5, size=(64, 48)).png and depths == b"\1\0\2\0"
        assert "png" not in values["frame"] and values["frame"]["camera"]["eye"]
        view.widget.receive({"type": "isoscope/interact", "text": '{"frameShown": {"frameNumber": "1"}}'})
        view.widget.receive({"type": "isoscope/interact", "text": '{"viewState": {"unknown": 1}}'})
        assert "unknown" in view.widget.frame()[0]["error"]["message"]
        view.widget.receive(state_message(6, {**frame, "surfaces": [{**frame["surfaces"][0], "isovalue": 60}]}))
        assert view.widget.frame()[1] == dataset.render(60, size=(64, 48)).png
        view.widget.receive({"type": "isoscope/close"})
        view.widget.receive(state_message(7, frame))
        view.widget.receive({"type": "isoscope/open"})
        view.widget.receive(state_message(8, frame))
        assert view.widget.frame()[0]["sequenceNumber"] == "8"


def view_threads():
    return [thread for thread in threading.enumerate() if thread.name == "isoscope-view"]


def wait_for_no_view_thread():
    for thread in view_threads():
        thread.join(30)
    return view_threads() == []


def test_no_thread_outlives_its_tab(client, anywidget, monkeypatch):
    calls = queue.Queue()

    def interact(requests, upstream):
        ended = threading.Event()
        calls.put(ended)
        try:
            for request in requests:
                frame = upstream.RenderIsosurface(request.view_state.frame, timeout=30)
                yield interact_pb.InteractResponse(sequence_number=request.view_state.sequence_number, frame=frame)
        finally:
            ended.set()

    def shows(view, number):
        view.widget.receive(state_message(number, {**view.state, "viewport": {"widthPx": 16, "heightPx": 16}}))
        return view.widget.frame()[0]["sequenceNumber"] == str(number)

    with Proxy(client, interact=interact) as proxy, isoscope.connect(proxy.address) as through:
        # The comm goes.
        view = through["shells"].view(127.5, size=(16, 16))
        view.widget.receive({"type": "isoscope/open"})
        assert shows(view, 1) and view_threads()
        view.widget.close()
        assert wait_for_no_view_thread() and calls.get(timeout=30).wait(30)
        # The browser disappears without notice to the kernel; a browser that was only silent continues.
        monkeypatch.setattr(viewer, "KernelFrames", functools.partial(KernelFrames, idle_seconds=0.2))
        view = through["shells"].view(127.5, size=(16, 16))
        view.widget.receive({"type": "isoscope/open"})
        assert shows(view, 2)
        assert wait_for_no_view_thread() and calls.get(timeout=30).wait(30)
        assert shows(view, 3) and wait_for_no_view_thread()

        # The comm can't send any more.
        def fail(content, buffers):
            raise RuntimeError("the comm is closed")

        view.widget.send = fail
        view.widget.receive(state_message(4, {**view.state, "viewport": {"widthPx": 16, "heightPx": 16}}))
        assert wait_for_no_view_thread()


def test_the_browser_hears_why_no_frame_comes_through_the_kernel(client, anywidget):
    def interact(requests, upstream):
        next(requests)
        raise Exception("refused")
        yield

    with Proxy(client, interact=interact) as proxy, isoscope.connect(proxy.address) as through:
        view = through["shells"].view(127.5, size=(64, 48))
        view.widget.receive({"type": "isoscope/open"})
        view.widget.receive(state_message(3, {}))
        values, image, _ = view.widget.frame()
        assert values["sequenceNumber"] == "3" and "refused" in values["error"]["message"] and image == b""
