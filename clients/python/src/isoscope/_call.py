"""A call without I/O: its request, the reading of its answer, and when it is tried again.

The clients run calls: they add a channel, and threads or an event loop. Each call is idempotent. A try that fails is
repeated only while no part of its answer has come.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeAlias, TypeVar

import grpc

from isoscope._channel import Target
from isoscope._process_channel import ProcessChannel
from isoscope._proto import cluster_service_pb2 as cluster_pb
from isoscope._proto import dataset_service_pb2 as datasets_pb
from isoscope._proto import isosurface_service_pb2 as pb
from isoscope._retry import Retries
from isoscope.data import Capabilities
from isoscope.errors import CancelledError, InternalError, InvalidArgumentError, printable, raise_explained

_T = TypeVar("_T")
_T_co = TypeVar("_T_co", covariant=True)
_Message: TypeAlias = Any
#: Makes a call and waits for its result.
Do: TypeAlias = Callable[["Call[Any]"], Any]


def _methods(module: Any, service: str, *names: str) -> dict[Any, tuple[str, Callable[[bytes], _Message]]]:
    """Returns path and reader of answers by the type of the request, which the protos name after the method."""
    return {
        getattr(module, f"{name}Request"): (
            f"/isoscope.v1.{service}/{name}", getattr(module, f"{name}Response").FromString,
        )
        for name in names
    }  # fmt: skip


_METHODS = {
    **_methods(datasets_pb, "DatasetService", "ListDatasets", "GetDataset", "GetHistogram"),
    **_methods(cluster_pb, "ClusterService", "GetCapabilities", "GetClusterStatus"),
    **_methods(pb, "IsosurfaceService", "RenderIsosurfaceStream", "PickSurface", "ExportIsosurface"),
}


class Answer(Protocol[_T_co]):
    """Takes the messages of an answer in order, then says what they mean."""

    def add(self, message: _Message) -> None: ...

    def result(self, do: Do | None) -> _T_co: ...


class One(Generic[_T]):
    """An answer of one message."""

    def __init__(self, decode: Callable[[_Message], _T]) -> None:
        self._decode = decode
        self._message: _Message = None

    def add(self, message: _Message) -> None:
        self._message = message

    def result(self, do: Do | None) -> _T:
        if self._message is None:
            raise InternalError("the server answered without a message")
        return self._decode(self._message)


def _is_sign_of_life(message: _Message) -> bool:
    """Returns whether a message of an export only tells that the server works on."""
    return isinstance(message, pb.ExportIsosurfaceResponse) and not (
        message.positions or message.normals or message.triangles or message.HasField("measures")
    )


class Call(Generic[_T]):
    """One call: its checked request, its deadline in seconds (None: the client's), and what becomes of its answer."""

    def __init__(self, request: _Message, answer: Answer[_T], timeout: float | None = None) -> None:
        self.request = request
        self.timeout = timeout
        self.has_taken = False
        self._answer = answer

    def add(self, message: _Message) -> None:
        """Takes the next message of the answer. A sign of life is none: the server works on."""
        if _is_sign_of_life(message):
            return
        self.has_taken = True
        self._answer.add(message)

    def result(self, do: Do | None) -> _T:
        """Returns what the whole answer means. `do` is for results that make calls later; None: they can't."""
        return self._answer.result(do)


class Connection:
    """Where a client's calls go, and their tries. The clients add how one waits."""

    _name = "isoscope.Client"

    def __init__(self, target: Target, make: Callable[[Target], Any]) -> None:
        self._target = target
        self._channel = ProcessChannel(target, make)
        self._capabilities: Capabilities | None = None

    @property
    def address(self) -> str:
        """Address of the server."""
        return self._target.address

    @property
    def token_file(self) -> str | None:
        """The file with the token that is sent: `--token-file` of the programs; None if it came otherwise, or none.

        `isoscope.serve` makes a token, and this file, which goes when the client is closed.
        """
        return self._target.token_file

    def __repr__(self) -> str:
        version = f", version {printable(self._capabilities.version)}" if self._capabilities else ""
        return f"<{self._name} of {self.address}{version}>"

    def _retries(self, call: Call[Any]) -> Retries:
        if call.timeout is not None and not call.timeout > 0:
            raise InvalidArgumentError(f"timeout {call.timeout!r}: must be above 0 seconds")
        return Retries(self._target.timeout if call.timeout is None else call.timeout)

    def _begin(self, call: Call[Any], retries: Retries) -> Any:
        """Begins a try; returns gRPC's iterator of messages. An answer of one message is a stream of one."""
        path, read = _METHODS[type(call.request)]
        method = self._channel.get().unary_stream(path, type(call.request).SerializeToString, read)
        try:
            return method(call.request, timeout=retries.timeout(), metadata=self._target.call_metadata())
        except ValueError as error:  # gRPC: the channel was closed by another thread
            if "closed" in str(error).lower():
                raise self._closed() from error
            raise

    def _closed(self) -> CancelledError:
        return CancelledError(f"the client of {self.address} is closed")

    def _delay_after(self, error: grpc.RpcError, call: Call[Any], retries: Retries) -> float:
        """Returns the seconds to wait before another try; raises what the error means where there is none."""
        delay = None if call.has_taken else retries.delay_after(error)
        if delay is None:
            raise_explained(error, self.address, retries.seconds, self._target.tls)
        return delay
