"""The client for asyncio, with the names of the blocking one.

    async with isoscope.aio.connect("host:50051") as client:
        dataset = await client.dataset("head")
        frame = await dataset.render(isovalue=60, planes=["depth"])

A client belongs to the event loop that it was made in, and to its process.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Generator, Sequence
from typing import Any, TypeVar, overload

import grpc
import grpc.aio

from isoscope import _core
from isoscope._call import Call, Connection
from isoscope._channel import Target, make_aio_channel
from isoscope.data import AgentState, Capabilities, Histogram, Mesh, PickedPoint, Suggestion, SurfaceMeasures
from isoscope.errors import InvalidArgumentError, IsoscopeError
from isoscope.frame import Frame
from isoscope.labels import Label

__all__ = ["Client", "Dataset", "connect"]

_T = TypeVar("_T")


class _Connecting:
    """The result of `connect`: await it for a client, or use it in `async with`."""

    def __init__(self, target: Target, connect_timeout: float) -> None:
        self._target = target
        self._connect_timeout = connect_timeout
        self._client: Client | None = None

    async def _connect(self) -> Client:
        client = Client(self._target)
        try:
            client._capabilities = await client.capabilities(timeout=self._connect_timeout)
        except BaseException:
            await client.close()
            raise
        return client

    def __await__(self) -> Generator[Any, None, Client]:
        return self._connect().__await__()

    async def __aenter__(self) -> Client:
        self._client = await self._connect()
        return self._client

    async def __aexit__(self, *_: object) -> None:
        if self._client is not None:
            await self._client.close()


@_core.shaped_like(_core.connection)
def connect(*where: Any, **how: Any) -> _Connecting:
    return _Connecting(*_core.connection(*where, **how))


class Client(Connection):
    """A connection to a coordinator. Close it, or use `async with`."""

    _name = "isoscope.aio.Client"

    def __init__(self, target: Target) -> None:
        super().__init__(target, make_aio_channel)

    async def datasets(self, *, timeout: float | None = None) -> list[Dataset]:
        """Returns all datasets, in order of name."""
        return [Dataset(_client=self, **fields) for fields in await self._do(_core.datasets(timeout))]

    async def dataset(self, name: str = "", *, timeout: float | None = None) -> Dataset:
        """Returns a dataset; the name may be left out if the server has just one."""
        return Dataset(_client=self, **await self._do(_core.dataset(name, timeout)))

    async def capabilities(self, *, timeout: float | None = None) -> Capabilities:
        """Returns the server's version and limits."""
        return await self._do(_core.capabilities(timeout))

    async def agents(self, *, timeout: float | None = None) -> list[AgentState]:
        """Returns the agents of the cluster, and whether they can be reached."""
        return await self._do(_core.agents(timeout))

    async def close(self) -> None:
        """Closes the connection; calls in work are cancelled. Any number of times."""
        channel = self._channel.take_to_close()
        if channel is not None:
            await channel.close()

    async def __aenter__(self) -> Client:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        raise TypeError("an async client belongs to its event loop and is not pickled: pickle an isoscope.Dataset")

    async def _do(self, call: Call[_T]) -> _T:
        """Makes one call; errors are this package's. A cancelled task stops the server."""
        retries = self._retries(call)
        while True:
            answer: Any = None
            try:
                answer = self._begin(call, retries)
                async for message in answer:
                    call.add(message)
                return call.result(None)
            except grpc.RpcError as error:
                delay = self._delay_after(error, call, retries)
            except grpc.aio.UsageError as error:
                raise self._closed() from error
            except BaseException as error:
                if answer is not None:
                    answer.cancel()
                # What grpcio says if a cancellation comes with the end of the answer.
                if isinstance(error, UnboundLocalError) and "raw_response" in str(error):
                    raise asyncio.CancelledError from error
                raise
            await asyncio.sleep(delay)


class Dataset(_core.DatasetOfClient):
    """A volume on the server: the methods of `isoscope.Dataset`, to be awaited."""

    _client: Client

    @_core.shaped_like(_core.render)
    async def render(self, *what: Any, **how: Any) -> Frame:
        return await self._client._do(_core.render(self, *what, **(await self._resolved(how))))

    @overload
    async def pick(
        self, pixels: tuple[int, int], isovalue: float | None = None, *, frame: Frame | None = None,
        all_fields: bool = False, **look: Any,
    ) -> PickedPoint | None: ...

    @overload
    async def pick(
        self, pixels: Sequence[Sequence[int]], isovalue: float | None = None, *, frame: Frame | None = None,
        all_fields: bool = False, **look: Any,
    ) -> list[PickedPoint | None]: ...

    @_core.shaped_like(_core.pick)
    async def pick(self, *what: Any, **how: Any) -> PickedPoint | None | list[PickedPoint | None]:
        return await self._client._do(_core.pick(self, *what, **(await self._resolved(how))))

    @_core.shaped_like(_core.mesh)
    async def mesh(self, *what: Any, **how: Any) -> Mesh:
        call = _core.mesh(self, *what, **(await self._resolved(how)))
        mesh = await self._client._do(call)
        notes = _core.notes_on_mesh(call, mesh, self._client._capabilities)
        if notes is not None:
            with contextlib.suppress(IsoscopeError):  # the mesh is right without them
                await self._client._do(notes)
        return mesh

    @_core.shaped_like(_core.measure)
    async def measure(self, *what: Any, **how: Any) -> list[SurfaceMeasures]:
        return await self._client._do(_core.measure(self, *what, **(await self._resolved(how))))

    @_core.shaped_like(_core.histogram)
    async def histogram(self, *what: Any, **how: Any) -> Histogram:
        return await self._client._do(_core.histogram(self, *what, **how))

    async def present_labels(self, **what: Any) -> tuple[Label, ...]:
        """Returns the labels but 0 that samples have, if all are whole numbers; else those with names.

        Reads all samples, unless they are integers whose range is below 4096.

        Args:
            what: field, component, time and step, as in `render`.
        """
        if _core.has_exact_bins(self, what):
            return _core.present(self, await self.histogram(4096, **what))
        return _core.listed(self, await self._client._do(_core.label_values(self, **what)))

    async def _resolved(self, how: dict[str, Any]) -> dict[str, Any]:
        """Returns the arguments of a call with the labels of "all"."""
        if not _core.wants_present(how):
            return how
        labels = await self.present_labels(**_core.selection_of(how))
        if not labels:
            raise InvalidArgumentError("labels='all': the dataset has no labels but 0, or none is known; give values")
        return {**how, "labels": labels}

    async def suggestions(self, **what: Any) -> tuple[Suggestion, ...]:
        """Returns isovalues that are worth a look, of field, component, time and step as in `render`.

        There are none if samples were not counted.
        """
        return (await self.histogram(**what)).suggestions

    async def refresh(self) -> Dataset:
        """Asks for the description again: `missing_shards` changes as agents come and go."""
        return await self._client.dataset(self.name)
