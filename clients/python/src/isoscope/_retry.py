"""Refusals with a retry delay: google.rpc.RetryInfo in the metadata of an error."""

from __future__ import annotations

import time
from typing import Any

import grpc
from google.protobuf import any_pb2, descriptor_pb2, descriptor_pool, duration_pb2, message_factory
from google.protobuf.message import DecodeError

_DETAILS_KEY = "grpc-status-details-bin"
_RETRY_INFO = "google.rpc.RetryInfo"


def _google_rpc() -> tuple[Any, Any]:
    """Returns the classes of google.rpc.Status and google.rpc.RetryInfo, with the fields that are read here.

    In a pool of their own: Debian 12 has no googleapis-common-protos, and where it is installed the default pool has
    these names already.
    """
    pool = descriptor_pool.DescriptorPool()
    for module in (any_pb2, duration_pb2):
        pool.AddSerializedFile(module.DESCRIPTOR.serialized_pb)
    file = descriptor_pb2.FileDescriptorProto(
        name="google/rpc/isoscope_retry.proto",
        package="google.rpc",
        syntax="proto3",
        dependency=["google/protobuf/any.proto", "google/protobuf/duration.proto"],
    )
    fields = descriptor_pb2.FieldDescriptorProto
    status = file.message_type.add(name="Status")
    status.field.add(
        name="details", number=3, label=fields.LABEL_REPEATED, type=fields.TYPE_MESSAGE,
        type_name=".google.protobuf.Any",
    )  # fmt: skip
    info = file.message_type.add(name="RetryInfo")
    info.field.add(
        name="retry_delay", number=1, label=fields.LABEL_OPTIONAL, type=fields.TYPE_MESSAGE,
        type_name=".google.protobuf.Duration",
    )  # fmt: skip
    pool.AddSerializedFile(file.SerializeToString())

    def message_class(name: str) -> Any:
        descriptor = pool.FindMessageTypeByName(name)
        if hasattr(message_factory, "GetMessageClass"):  # protobuf 4.22 and newer
            return message_factory.GetMessageClass(descriptor)
        return message_factory.MessageFactory(pool).GetPrototype(descriptor)

    return message_class("google.rpc.Status"), message_class(_RETRY_INFO)


_Status, _RetryInfo = _google_rpc()
# Codes of errors that may be temporary: the same call may succeed later.
_REFUSALS = (grpc.StatusCode.RESOURCE_EXHAUSTED, grpc.StatusCode.UNAVAILABLE)


class Retries:
    """The tries of one call: how long each may take, and how long to wait before the next one."""

    def __init__(self, timeout: float) -> None:
        self.seconds = timeout
        self._end = time.monotonic() + timeout

    def timeout(self) -> float:
        """Returns the seconds that are left."""
        return max(self._end - time.monotonic(), 0.001)

    def delay_after(self, error: grpc.RpcError) -> float | None:
        """Returns the seconds to wait before another try; None: the error is final.

        Only what the server tells counts: a RESOURCE_EXHAUSTED that tells no time means a picture that can never
        fit, and gRPC itself tries UNAVAILABLE again.
        """
        delay = told_delay(error)
        return None if delay is None or time.monotonic() + delay >= self._end else delay


def told_delay(error: Any) -> float | None:
    """Returns the retry delay of a refusal in seconds; None if it has none."""
    if error.code() not in _REFUSALS:
        return None
    for key, value in error.trailing_metadata() or ():
        if key == _DETAILS_KEY and isinstance(value, bytes):
            try:
                return _delay_of(_Status.FromString(value))
            except DecodeError:
                return None
    return None


def _delay_of(status: Any) -> float | None:
    for detail in status.details:
        if detail.type_url.rpartition("/")[2] == _RETRY_INFO:
            delay = _RetryInfo.FromString(detail.value).retry_delay
            seconds = float(delay.seconds + delay.nanos * 1e-9)
            return seconds if seconds >= 0 else None
    return None
