"""`Dataset.view`: the surface under the mouse in a notebook cell, and the exact picture in any case.

Frames go from the web gateway to the browser; Python is not in the way of one. A cell is one of these:

    page       the gateway's page in a frame, with all controls: of `isoscope.serve`, which starts the gateway
    widget     with anywidget: the state comes back to Python, and frames come through the kernel where the
               browser can't reach the gateway
    module     isoscope-view.js of clients/web, inlined in the cell's HTML: with a gateway of the user's
    picture    without a gateway

Each holds the exact PNG: a saved notebook shows it without a gateway, a kernel or a browser's memory. Without a background
of its own it is transparent, so that it suits light and dark notebooks.
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
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias
from urllib.parse import urlencode

from google.protobuf import json_format

from isoscope import _answer, _core, _request, _viewer_module
from isoscope._kernel_frames import KernelFrames
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope._serving.notebook_origins import notebook_origins
from isoscope.camera import Camera, CameraLike
from isoscope.errors import FailedPreconditionError, InvalidArgumentError, ProgramError
from isoscope.look import ClipLike, SurfaceLike

if TYPE_CHECKING:
    from isoscope.frame import Frame

# A view works with any dataset of a blocking client. `isoscope.client` makes views, so it is not imported here.
_Dataset: TypeAlias = Any

__all__ = ["View"]

# What the page has beside and above the picture, CSS pixels: page.css.
_PANEL_WIDTH, _BAR_HEIGHT = 328, 48
# Below this the page is that of a phone.
_LEAST_WIDTH, _LEAST_HEIGHT = 780, 440
# Backgrounds of live pictures without one of their own: those of the page's themes.
_DARK = {"red": 0.0431, "green": 0.0549, "blue": 0.0784, "alpha": 1}
_LIGHT = {"red": 1, "green": 1, "blue": 1, "alpha": 1}


@dataclass(frozen=True)
class _Gateway:
    """The gateway of a view.

    Attributes:
        url: its address, as the browser reaches it; "" if there is none.
        token: what it asks for; "" for nothing.
        shows_page: whether the cell has its page.
        problem: why there is none, if that is known.
    """

    url: str = ""
    token: str = ""
    shows_page: bool = False
    problem: str = ""


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
        widget: the anywidget behind it; None without anywidget, and where the cell has the gateway's page.
    """

    def __init__(
        self, dataset: _Dataset, request: pb.RenderIsosurfaceRequest, size: tuple[int, int], gateway: _Gateway
    ) -> None:
        self.dataset = dataset
        self.gateway = gateway.url
        self.size = size
        self._request = request
        self._gateway = gateway
        self._frames: dict[bool, tuple[bytes, Frame]] = {}
        self.widget: Any = None
        cls = None if gateway.shows_page else _widget_class()
        if cls is not None:
            widget = self.widget = cls(url=gateway.url, token=gateway.token, state=self._state(), height=size[1])
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
        """Returns the exact frame of what is shown, as `Dataset.render` gives it; its warnings, too.

        Without a widget that is what the view began with: the page keeps its state to itself.

        Args:
            size: (width, height), pixels; default: the view's.
        """
        return self._exact(size or self.size, is_still=False)

    def _exact(self, size: tuple[int, int], is_still: bool) -> Frame:
        """Returns the exact frame; of a still without a background of its own, on a transparent one."""
        request = self._current()
        _request.ask_for_notes(request, self.dataset._client._capabilities)
        request.viewport.width_px, request.viewport.height_px = size
        if is_still and not request.HasField("background_color"):
            request.background_color.SetInParent()  # its alpha is 0
        serialized = request.SerializeToString(deterministic=True)
        before = self._frames.get(is_still)
        if before is None or serialized != before[0]:
            before = serialized, self.dataset._client._do(_core.frame(request))
            self._frames[is_still] = before
        return before[1]

    def __repr__(self) -> str:
        return f"View({self.dataset.name!r}, {self._how()})"

    def _how(self) -> str:
        if self._gateway.shows_page:
            return "the gateway's page"
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
        picture = base64.b64encode(self._exact(self.size, is_still=True).png).decode("ascii")
        bundle: dict[str, Any] = {"text/plain": repr(self), "image/png": picture}
        if self.widget is not None:
            shown = self.widget._repr_mimebundle_()
            bundle.update(shown[0] if isinstance(shown, tuple) else shown or {})
        else:
            bundle["text/html"] = self._html(picture)
        return bundle

    def _html(self, picture: str) -> str:
        """Returns the cell: the exact picture, and in its place what moves, once that is there."""
        width, height = self.size
        image = (
            f'<img alt="{html.escape(self._title(), quote=True)}" width="{width}" height="{height}" '
            f'style="max-width:100%;height:auto;display:block" src="data:image/png;base64,{picture}">'
        )
        if self._gateway.shows_page:
            return self._page_html(image)
        module = _viewer_module.text()
        if not self.gateway or module is None:
            return f'<div>{image}<div style="font-size:smaller">{html.escape(self._hint())}</div></div>'
        return self._module_html(image, module)

    def _title(self) -> str:
        return f"isosurface of {self.dataset.name}"

    def _page_html(self, image: str) -> str:
        """Returns the picture with a script that puts the gateway's page in its place, if the browser gets there.

        The gateway's own module makes the page's address of the state. The page that shows the cell gets the module
        only if it is of an origin that the gateway knows: so both is tried before the picture goes.
        """
        width = max(self.size[0] + _PANEL_WIDTH, _LEAST_WIDTH)
        height = max(self.size[1] + _BAR_HEIGHT, _LEAST_HEIGHT)
        state = self._state()
        # Without a background of its own, the page has that of the notebook's theme.
        if not state.get("surfaces"):
            state["surfaces"] = [{"isovalue": state.pop("isovalue", 0)}]
        # JSON of a proto leaves zeros out.
        for surface in state["surfaces"]:
            if "labels" not in surface:
                surface.setdefault("isovalue", 0)
        query = urlencode({"token": self._gateway.token} if self._gateway.token else {})
        lost = (
            f" does not get to {self.gateway}: its kernel has ended, or the browser is on another machine, or the page "
            "has another origin, which view(origin=...) names."
        )
        return (
            f'<div id="{(name := f"isoscope-{uuid.uuid4().hex}")}">{image}'
            f'<div class="isoscope-note" style="font-size:smaller"></div></div>'
            f"<script>(async () => {{\n"
            f"const root = document.getElementById({json.dumps(name)});\n"
            f"const base = new URL({_script_json(self.gateway.rstrip('/') + '/')}, document.baseURI);\n"
            f"let words;\n"
            f"try {{\n"
            f"  const {{stateToHash}} = await import(new URL('view-state.js', base).href);\n"
            f"  words = stateToHash({_script_json(state)});\n"
            f"}} catch {{\n"
            f"  root.querySelector('.isoscope-note').textContent = "
            f"'The exact picture: this page, ' + location.origin + ',' + {_script_json(lost)};\n"
            f"  return;\n"
            f"}}\n"
            f"const theme = document.body.dataset.jpThemeLight === 'false' ? 'dark' : 'light';\n"
            f"const frame = document.createElement('iframe');\n"
            f"frame.src = base.href + '?theme=' + theme + {_script_json('&' + query if query else '')} + '#' + words;\n"
            f"frame.title = {_script_json(self._title())};\n"
            f"frame.allow = 'clipboard-write; fullscreen';\n"
            f"frame.style.cssText = 'display:block;border:0;max-width:100%;width:{width}px;height:{height}px';\n"
            f"root.replaceChildren(frame);\n"
            f"}})();</script>"
        )

    def _module_html(self, image: str, module: str) -> str:
        """Returns the picture, and over it the viewer's module once its first frame is there."""
        width, height = self.size
        options = {"url": self.gateway, "token": self._gateway.token or None, "state": self._state(), "wheel": "focused"}
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
            f"const options = {_script_json(options)};\n"
            f"const isDark = document.body.dataset.jpThemeLight === 'false';\n"
            f"options.state.backgroundColor ??= isDark ? {_script_json(_DARK)} : {_script_json(_LIGHT)};\n"
            f"const view = mount(live, options);\n"
            f"view.addEventListener('frame', () => {{ live.style.visibility = 'visible'; }}, {{once: true}});\n"
            f"}})();</script>"
        )

    def _hint(self) -> str:
        if _viewer_module.text() is None:
            name = _viewer_module.NAME
            return f"The exact picture. This package was built without {name}: build the wheel from a checkout."
        if self._gateway.problem:
            return f"The exact picture. For the surface under the mouse no web gateway started: {self._gateway.problem}"
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
    page: bool | None,
    origin: str | None,
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
    request = _request.frame(
        dataset, isovalue, surfaces=surfaces, camera=camera, view=view, clip=clip, size=size,
        capabilities=dataset._client._capabilities, **selection,
    )  # fmt: skip
    if _request.asks_first_look(camera, view):
        _request.set_first_look(request)
    shown = _gateway_of(dataset, gateway, token, page, origin)
    return View(dataset, request, (request.viewport.width_px, request.viewport.height_px), shown)


def _gateway_of(
    dataset: _Dataset, gateway: str | None, token: str | None, page: bool | None, origin: str | None
) -> _Gateway:
    """Returns the gateway that was given, else the one that the server names, else that of a client of `serve`."""
    client = dataset._client
    start = client._start_gateway
    if origin is not None and (gateway is not None or start is None):
        raise InvalidArgumentError(
            f"origin {origin!r}: is for the gateway that a client of isoscope.serve starts; start your own with "
            f"--allow-origin {origin}"
        )
    url = client.capabilities().gateway_address or "" if gateway is None else gateway
    if url and not url.startswith(("http://", "https://", "/")):
        raise InvalidArgumentError(f"gateway {url!r}: must begin with http://, https:// or /")
    if url or start is None:
        return _Gateway(url, token or "", shows_page=bool(url and page))
    if not page and _widget_class() is not None:
        return _Gateway()  # the widget gets its frames through the kernel
    try:
        started = start(notebook_origins() if origin is None else [origin])
    except ProgramError as error:
        return _Gateway(problem=error.message)
    return _Gateway(started.url, started.token, shows_page=started.has_page and page is not False)
