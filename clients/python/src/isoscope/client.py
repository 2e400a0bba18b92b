"""The blocking client. `isoscope.aio` has the same names, to be awaited."""

from __future__ import annotations

import contextlib
import time
import weakref
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Literal, TypeVar, overload

import grpc

from isoscope import _core
from isoscope._call import Call, Connection
from isoscope._channel import Target, make_channel
from isoscope._serving.gateway import RunningGateway
from isoscope.camera import CameraLike
from isoscope.data import AgentState, Capabilities, Histogram, Mesh, PickedPoint, Suggestion, SurfaceMeasures
from isoscope.errors import InvalidArgumentError, IsoscopeError
from isoscope.frame import Frame
from isoscope.labels import Label
from isoscope.look import ClipLike, SurfaceLike
from isoscope.viewer import View, make_view

__all__ = ["Client", "Dataset", "connect"]

_T = TypeVar("_T")
# Who types waits no longer.
_COMPLETION_SECONDS = 2.0


@_core.shaped_like(_core.connection)
def connect(*where: Any, **how: Any) -> Client:
    target, connect_timeout = _core.connection(*where, **how)
    client = Client(target)
    try:
        client._capabilities = client.capabilities(timeout=connect_timeout)
    except BaseException:
        client.close()
        raise
    return client


class Client(Connection):
    """A connection to a coordinator, made by `isoscope.connect` or `isoscope.serve`.

    Close it, or use it as a context manager. Thread-safe.
    """

    def __init__(self, target: Target, on_close: Callable[[], None] | None = None) -> None:
        super().__init__(target, make_channel)
        self._on_close = on_close
        # Of `isoscope.serve`: starts the web gateway, for pages of these origins.
        self._start_gateway: Callable[[Sequence[str]], RunningGateway] | None = None

    def datasets(self, *, timeout: float | None = None) -> list[Dataset]:
        """Returns all datasets, in order of name."""
        return [Dataset(_client=self, **fields) for fields in self._do(_core.datasets(timeout))]

    def dataset(self, name: str = "", *, timeout: float | None = None) -> Dataset:
        """Returns a dataset; the name may be left out if the server has just one.

        Raises:
            NotFoundError: there is none of that name; the message lists the datasets.
        """
        return Dataset(_client=self, **self._do(_core.dataset(name, timeout)))

    def __getitem__(self, name: str) -> Dataset:
        return self.dataset(name)

    def __iter__(self) -> Iterator[str]:
        """Gives the names that `client[name]` takes, as a mapping does; `datasets` has the datasets."""
        return iter([dataset.name for dataset in self.datasets()])

    def __contains__(self, name: object) -> bool:
        return any(one == name for one in self)

    def __len__(self) -> int:
        """Returns the number of datasets."""
        return len(self.datasets())

    def __bool__(self) -> bool:
        """A client is true, with datasets or without: `if client:` makes no call."""
        return True

    def keys(self) -> list[str]:
        """Returns the names of the datasets, in order."""
        return [dataset.name for dataset in self.datasets()]

    def _ipython_key_completions_(self) -> list[str]:
        """Names for `client["` and the Tab key. A server that does not answer gives none, and soon."""
        with contextlib.suppress(IsoscopeError):
            return [dataset.name for dataset in self.datasets(timeout=_COMPLETION_SECONDS)]
        return []

    def capabilities(self, *, timeout: float | None = None) -> Capabilities:
        """Returns the server's version and limits."""
        return self._do(_core.capabilities(timeout))

    def agents(self, *, timeout: float | None = None) -> list[AgentState]:
        """Returns the agents of the cluster, and whether they can be reached."""
        return self._do(_core.agents(timeout))

    def close(self) -> None:
        """Closes the connection, and ends what `isoscope.serve` had started. Any number of times."""
        channel = self._channel.take_to_close()
        if channel is not None:
            channel.close()
        on_close, self._on_close = self._on_close, None
        if on_close is not None:
            on_close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles where to connect, without the token; see `_shared_client`."""
        return _shared_client, (self._target, self._capabilities)

    def _do(self, call: Call[_T]) -> _T:
        """Makes one call and waits; errors are this package's. An interrupt stops the server."""
        retries = self._retries(call)
        while True:
            with self._channel.call_at_work():
                answer = self._begin(call, retries)
                try:
                    for message in answer:
                        call.add(message)
                    return call.result(self._do)
                except grpc.RpcError as error:
                    delay = self._delay_after(error, call, retries)
                except BaseException:
                    answer.cancel()
                    raise
            time.sleep(delay)


# The clients of this process's unpickled datasets, by target, as long as one of the datasets lives.
_SHARED: weakref.WeakValueDictionary[Target, Client] = weakref.WeakValueDictionary()


def _shared_client(target: Target, capabilities: Capabilities | None) -> Client:
    """Returns the client of an unpickled dataset. It connects at its first call, with the token of this process."""
    target = target.with_token()
    client = _SHARED.get(target)
    if client is None or client._channel.is_closed:
        client = _SHARED[target] = Client(target)
        client._capabilities = capabilities
    return client


class Dataset(_core.DatasetOfClient):
    """A volume on the server. Rendering, picking and meshes do not change it; all calls are idempotent.

    Its calls fail with FailedPreconditionError if the name has other contents by now: `refresh` gets them.
    """

    _client: Client

    @_core.shaped_like(_core.render)
    def render(self, *what: Any, **how: Any) -> Frame:
        return self._client._do(_core.render(self, *what, **self._resolved(how)))

    @overload
    def pick(
        self, pixels: tuple[int, int], isovalue: float | None = None, *, frame: Frame | None = None,
        all_fields: bool = False, **look: Any,
    ) -> PickedPoint | None: ...

    @overload
    def pick(
        self, pixels: Sequence[Sequence[int]], isovalue: float | None = None, *, frame: Frame | None = None,
        all_fields: bool = False, **look: Any,
    ) -> list[PickedPoint | None]: ...

    @_core.shaped_like(_core.pick)
    def pick(self, *what: Any, **how: Any) -> PickedPoint | None | list[PickedPoint | None]:
        return self._client._do(_core.pick(self, *what, **self._resolved(how)))

    @_core.shaped_like(_core.mesh)
    def mesh(self, *what: Any, **how: Any) -> Mesh:
        call = _core.mesh(self, *what, **self._resolved(how))
        mesh = self._client._do(call)
        notes = _core.notes_on_mesh(call, mesh, self._client._capabilities)
        if notes is not None:
            with contextlib.suppress(IsoscopeError):  # the mesh is right without them
                self._client._do(notes)
        return mesh

    @_core.shaped_like(_core.measure)
    def measure(self, *what: Any, **how: Any) -> list[SurfaceMeasures]:
        return self._client._do(_core.measure(self, *what, **self._resolved(how)))

    @_core.shaped_like(_core.histogram)
    def histogram(self, *what: Any, **how: Any) -> Histogram:
        return self._client._do(_core.histogram(self, *what, **how))

    def present_labels(self, **what: Any) -> tuple[Label, ...]:
        """Returns the labels but 0 that samples have, if all are whole numbers; else those with names.

        Reads all samples, unless they are integers whose range is below 4096.

        Args:
            what: field, component, time and step, as in `render`.
        """
        if _core.has_exact_bins(self, what):
            return _core.present(self, self.histogram(4096, **what))
        return _core.listed(self, self._client._do(_core.label_values(self, **what)))

    def _resolved(self, how: dict[str, Any]) -> dict[str, Any]:
        """Returns the arguments of a call with the labels of "all"."""
        if not _core.wants_present(how):
            return how
        labels = self.present_labels(**_core.selection_of(how))
        if not labels:
            raise InvalidArgumentError("labels='all': the dataset has no labels but 0, or none is known; give values")
        return {**how, "labels": labels}

    def suggestions(self, **what: Any) -> tuple[Suggestion, ...]:
        """Returns isovalues that are worth a look, of field, component, time and step as in `render`.

        There are none if samples were not counted.
        """
        return self.histogram(**what).suggestions

    def refresh(self) -> Dataset:
        """Asks for the description again: `missing_shards` changes as agents come and go."""
        return self._client.dataset(self.name)

    def view(
        self,
        isovalue: float | None = None,
        *,
        surfaces: Sequence[SurfaceLike] | SurfaceLike | None = None,
        camera: CameraLike | None = None,
        view: str | None = None,
        clip: ClipLike | None = None,
        field: str | None = None,
        component: str | int | None = None,
        time: float | None = None,
        step: int | Literal["first", "last"] | None = None,
        size: tuple[int, int] = (800, 600),
        gateway: str | None = None,
        token: str | None = None,
        page: bool | None = None,
        origin: str | None = None,
    ) -> View:
        """Returns a view for a notebook cell: the surface under the mouse, and the exact picture.

        A client of `isoscope.serve` starts the web gateway of this machine for its first view. The cell then has the
        gateway's page, with isovalue, labels, steps and all other controls; with anywidget it is a widget whose state
        comes back to Python. Without a gateway, and in the saved notebook, the cell shows the exact picture.

        Args:
            isovalue, surfaces, camera, view, clip, field, component, time, step, size: as in `render`; default: the
                suggested isovalue.
            gateway: the gateway's address, as the browser reaches it; default: what the server names, or the one that a
                client of `serve` starts.
            token: token of the gateway, where it wants one.
            page: whether the cell has the gateway's page with its controls; default: where anywidget is not installed,
                and the client is one of `serve`. A gateway of your own needs --allow-origin and --allow-framing with
                the origin of the notebook.
            origin: origin of the notebook's page, such as "http://localhost:8888", for the gateway that `serve` starts;
                default: that of the Jupyter server of this kernel.
        """
        return make_view(
            self, isovalue, surfaces=surfaces, camera=camera, view=view, clip=clip, size=size, gateway=gateway,
            token=token, page=page, origin=origin, field=field, component=component, time=time, step=step,
        )  # fmt: skip
