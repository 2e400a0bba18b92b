"""Refusals that tell when to come again: google.rpc.RetryInfo in the metadata of an error."""

from __future__ import annotations

import time
from typing import Any

import grpc
from google.protobuf import any_pb2, duration_pb2
from google.protobuf.message import DecodeError

_DETAILS_KEY = "grpc-status-details-bin"
_RETRY_INFO_URL = "type.googleapis.com/google.rpc.RetryInfo"
# google.rpc.Status.details and google.rpc.RetryInfo.retry_delay.
_DETAILS_FIELD = 3
_RETRY_DELAY_FIELD = 1
# The codes of errors that say that the same call may work later.
_REFUSALS = (grpc.StatusCode.RESOURCE_EXHAUSTED, grpc.StatusCode.UNAVAILABLE)


class Retries:
    """The tries of one call: how long each may take, and how long to wait before the next one."""

    def __init__(self, timeout: float) -> None:
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
    """Returns the seconds that a refusal tells to wait; None if it tells none."""
    if error.code() not in _REFUSALS:
        return None
    for key, value in error.trailing_metadata() or ():
        if key == _DETAILS_KEY and isinstance(value, bytes):
            try:
                return _delay_of_details(value)
            except (DecodeError, ValueError, IndexError):
                return None
    return None


def _delay_of_details(details: bytes) -> float | None:
    for field, value in _byte_fields(details):
        detail = any_pb2.Any()
        if field != _DETAILS_FIELD or not detail.ParseFromString(value) or detail.type_url != _RETRY_INFO_URL:
            continue
        delay = duration_pb2.Duration()
        for inner, inner_value in _byte_fields(detail.value):
            if inner == _RETRY_DELAY_FIELD:
                delay.ParseFromString(inner_value)
        seconds = delay.seconds + delay.nanos * 1e-9
        return seconds if seconds >= 0 else None
    return None


def _byte_fields(message: bytes) -> list[tuple[int, bytes]]:
    """Returns the numbers and values of the fields that hold bytes; ValueError or IndexError if it is no message."""
    fields = []
    at = 0
    while at < len(message):
        tag, at = _varint(message, at)
        kind = tag & 7
        if kind == 0:
            _, at = _varint(message, at)
        elif kind == 2:
            size, at = _varint(message, at)
            if size > len(message) - at:
                raise ValueError("cut")
            fields.append((tag >> 3, message[at : at + size]))
            at += size
        elif kind in (1, 5):
            at += 8 if kind == 1 else 4
        else:
            raise ValueError("a group")
    return fields


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise ValueError("too long")
