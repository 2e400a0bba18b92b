"""`Dataset.view`: the surface under the mouse in a notebook cell, and the exact picture in any case.

The browser's part is isoscope-view.js of clients/web as one module, which talks to the web gateway;
Python is not in the way of a frame. With anywidget installed it is a widget whose state comes back to
Python, and which gets its frames through the kernel where the browser can't reach the gateway; without,
as in Debian's Notebook 6.4, the module is inlined in the cell's HTML. Either way the
cell holds the exact PNG: a saved notebook shows it without a gateway, a kernel or a browser's memory.
"""

from __future__ import annotations

import base64
import functools
import html
import importlib
import json
import shlex
import uuid
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from google.protobuf import json_format

from isoscope import _answer, _core, _request, _viewer_module
from isoscope._kernel_frames import KernelFrames
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope.camera import Camera, CameraLike
from isoscope.errors import FailedPreconditionError, InvalidArgumentError
from isoscope.look import ClipLike, SurfaceLike

if TYPE_CHECKING:
    from isoscope.frame import Frame

# A view works with any dataset of a blocking client. `isoscope.client` makes views, so it is not imported here.
_Dataset: TypeAlias = Any

__all__ = ["View"]

@functools.cache
def _widget_class() -> Any:
    """Returns the widget's class; None without anywidget or without the module."""
    module = _viewer_module.text()
    if module is None:
        return None
    try:
        anywidget: Any = importlib.import_module("anywidget")
        traitlets: Any = importlib.import_module("traitlets")
    except ImportError:
        return None

    traits = {
        "_esm": module,
        "url": traitlets.Unicode("").tag(sync=True),
        "token": traitlets.Unicode("").tag(sync=True),
        "state": traitlets.Dict().tag(sync=True),
        "height": traitlets.Int(600).tag(sync=True),
        "stats": traitlets.Dict().tag(sync=True),
        "picked": traitlets.Any(None).tag(sync=True),
    }
    return type("IsoscopeWidget", (anywidget.AnyWidget,), traits)


class View:
    """A view in a notebook cell: display it, or leave it as the last expression of a cell.

    Attributes:
        dataset: the `isoscope.Dataset` that is shown.
        gateway: address of the web gateway, as the browser reaches it; "" if there is none.
        size: (width, height) of the cell's picture in pixels.
        widget: the anywidget behind it; None without anywidget.
    """

    def __init__(
        self, dataset: _Dataset, request: pb.RenderIsosurfaceRequest, size: tuple[int, int], gateway: str, token: str
    ) -> None:
        self.dataset = dataset
        self.gateway = gateway
        self.size = size
        self._request = request
        self._token = token
        self._frame: Frame | None = None
        self._frame_request: bytes = b""
        self.widget: Any = None
        cls = _widget_class()
        if cls is not None:
            widget = self.widget = cls(url=gateway, token=token, state=self._state(), height=size[1])
            # For browsers that can't reach the gateway: the module decides when.
            def send(content: dict[str, Any], buffers: list[bytes]) -> None:
                widget.send(content, buffers=buffers)

            frames = KernelFrames(dataset._client, send, dataset.name)
            widget.on_msg(lambda _, content, buffers: frames.handle(content))
            # The comm is destroyed when the widget is closed, in the browser or here.
            widget.observe(lambda change: None if change["new"] else frames.close(), names="comm")

    @property
    def state(self) -> dict[str, Any]:
        """The view's state, as RenderIsosurfaceRequest in JSON; with a widget, the browser's present one."""
        return dict(self.widget.state) if self.widget is not None else self._state()

    @state.setter
    def state(self, state: Mapping[str, Any]) -> None:
        try:
            self._request = json_format.ParseDict(dict(state), pb.RenderIsosurfaceRequest())
        except json_format.ParseError as error:
            raise InvalidArgumentError(f"state of a view: {error}") from error
        if self.widget is not None:
            self.widget.state = self._state()

    @property
    def camera(self) -> Camera:
        """The camera of the state; before the browser knows the one of the first look, that of the exact picture."""
        request = self._current()
        return _answer.camera(request.camera) if request.HasField("camera") else self.snapshot().camera

    @property
    def picked(self) -> Any:
        """The last click, as JSON; None without a widget, or before a click."""
        return self.widget.picked if self.widget is not None else None

    def snapshot(self, size: tuple[int, int] | None = None) -> Frame:
        """Returns the exact frame of what is shown, as `Dataset.render` gives it.

        Args:
            size: (width, height), pixels; default: the view's.
        """
        request = self._current()
        width, height = size or self.size
        request.viewport.width_px, request.viewport.height_px = width, height
        serialized = request.SerializeToString(deterministic=True)
        if self._frame is None or serialized != self._frame_request:
            frame: Frame = self.dataset._client._do(_core.frame(request))
            self._frame, self._frame_request = frame, serialized
        return self._frame

    def __repr__(self) -> str:
        return f"View({self.dataset.name!r}, {self._how()})"

    def _how(self) -> str:
        if _viewer_module.text() is None:
            return f"the exact picture: this package was built without {_viewer_module.NAME}"
        if self.widget is not None:
            return f"widget, frames from {self.gateway + ', else' if self.gateway else ''} the kernel"
        return f"inlined, frames from {self.gateway}" if self.gateway else "the exact picture: no gateway"

    def _current(self) -> pb.RenderIsosurfaceRequest:
        """Returns a copy of the request that is shown."""
        request = pb.RenderIsosurfaceRequest()
        if self.widget is not None:
            json_format.ParseDict(self.state, request, ignore_unknown_fields=True)
            request.ClearField("output")
            request.dataset = self.dataset.name
        else:
            request.CopyFrom(self._request)
        return request

    def _state(self) -> dict[str, Any]:
        state: dict[str, Any] = json_format.MessageToDict(self._request)
        state.pop("viewport", None)
        state.pop("output", None)
        return state

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        picture = base64.b64encode(self.snapshot().png).decode("ascii")
        bundle: dict[str, Any] = {"text/plain": repr(self), "image/png": picture}
        if self.widget is not None:
            shown = self.widget._repr_mimebundle_()
            bundle.update(shown[0] if isinstance(shown, tuple) else shown or {})
        else:
            bundle["text/html"] = self._html(picture)
        return bundle

    def _html(self, picture: str) -> str:
        """Returns the cell: the exact picture, and over it the live view once its first frame is there."""
        width, height = self.size
        image = (
            f'<img alt="isosurface of {html.escape(self.dataset.name, quote=True)}" width="{width}" height="{height}" '
            f'style="max-width:100%;height:auto;display:block" src="data:image/png;base64,{picture}">'
        )
        module = _viewer_module.text()
        if not self.gateway or module is None:
            return f'<div>{image}<div style="font-size:smaller">{html.escape(self._hint())}</div></div>'
        options = {"url": self.gateway, "token": self._token or None, "state": self._state(), "wheel": "focused"}
        # The module becomes a blob, so that an ordinary script of a cell's output can import it.
        return (
            f'<div id="{(name := f"isoscope-{uuid.uuid4().hex}")}" '
            f'style="position:relative;width:{width}px;max-width:100%;height:{height}px">'
            f'{image}<div class="isoscope-live" style="position:absolute;inset:0;visibility:hidden"></div></div>'
            f"<script>(async () => {{\n"
            f"const root = document.getElementById({json.dumps(name)});\n"
            f"const text = {_script_json(module)};\n"
            f"const url = URL.createObjectURL(new Blob([text], {{type: 'text/javascript'}}));\n"
            f"const {{mount}} = await import(url);\n"
            f"URL.revokeObjectURL(url);\n"
            f"const live = root.querySelector('.isoscope-live');\n"
            f"const view = mount(live, {_script_json(options)});\n"
            f"view.addEventListener('frame', () => {{ live.style.visibility = 'visible'; }}, {{once: true}});\n"
            f"}})();</script>"
        )

    def _hint(self) -> str:
        if _viewer_module.text() is None:
            name = _viewer_module.NAME
            return f"The exact picture. This package was built without {name}: build the wheel from a checkout."
        return (
            "The exact picture. For the surface under the mouse, start the web gateway: "
            f"'isoscope-gateway --server {self._server_flags()} --allow-origin ORIGIN', with the origin of this "
            "page, such as http://localhost:8888, and pass view(gateway='http://localhost:8080/', token=TOKEN), with "
            "the token in the address that it prints; or install anywidget."
        )

    def _server_flags(self) -> str:
        """Returns the server's address, and the file with its token if there is one: never the token."""
        client = self.dataset._client
        address: str = client.address
        return address + (f" --token-file {shlex.quote(client.token_file)}" if client.token_file else "")


def _script_json(value: Any) -> str:
    """Returns JSON that may stand in a script of an HTML page."""
    return json.dumps(value).replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def make_view(
    dataset: _Dataset,
    isovalue: float | None,
    *,
    surfaces: Sequence[SurfaceLike] | SurfaceLike | None,
    camera: CameraLike | None,
    view: str | None,
    clip: ClipLike | None,
    size: tuple[int, int],
    gateway: str | None,
    token: str | None,
    **selection: Any,
) -> View:
    """Returns the view of `Dataset.view`."""
    if isovalue is None and surfaces is None:
        suggestions = dataset.suggestions(**selection)
        if not suggestions:
            raise FailedPreconditionError(
                f"dataset {dataset.name!r} has no suggested isovalue (its samples were not counted): give isovalue=..."
            )
        isovalue = suggestions[0].isovalue
    if gateway is None:
        gateway = dataset._client.capabilities().gateway_address or ""
    if gateway and not gateway.startswith(("http://", "https://", "/")):
        raise InvalidArgumentError(f"gateway {gateway!r}: must begin with http://, https:// or /")
    request = _request.frame(
        dataset, isovalue, surfaces=surfaces, camera=camera, view=view, clip=clip, size=size,
        capabilities=dataset._client._capabilities, **selection,
    )  # fmt: skip
    if _request.asks_first_look(camera, view):
        _request.set_first_look(request)
    return View(dataset, request, (request.viewport.width_px, request.viewport.height_px), gateway, token or "")
