"""Errors: one class for each gRPC status code, with the server's sentence as message.

Each is an `IsoscopeError`; where Python has a class of the same meaning, it is that as well, so that
`except ValueError`, `except LookupError`, `except ConnectionError` and `except TimeoutError` work.
"""

from __future__ import annotations

import unicodedata
from typing import Any, NoReturn

import grpc

__all__ = [
    "CancelledError",
    "DataLossError",
    "DeadlineExceededError",
    "FailedPreconditionError",
    "InternalError",
    "InvalidArgumentError",
    "IsoscopeError",
    "MissingPackageError",
    "NotFoundError",
    "PermissionDeniedError",
    "ProgramError",
    "ResourceExhaustedError",
    "SurfaceWarning",
    "UnauthenticatedError",
    "UnavailableError",
    "UnimplementedError",
]


class SurfaceWarning(UserWarning):
    """A surface does not show in a picture, or a mesh has none of it; the message says why. Not an error.

    `warnings.simplefilter("error", isoscope.SurfaceWarning)` makes it one.
    """


class IsoscopeError(Exception):
    """Base of all errors of this package.

    Attributes:
        code: name of the gRPC status code, such as "INVALID_ARGUMENT"; "UNKNOWN" where there is none.
        message: a sentence for people: what is wrong, where, and what is allowed.
    """

    code = "UNKNOWN"

    def __init__(self, message: str, code: str | None = None) -> None:
        super().__init__(message)
        self.message = message
        if code is not None:
            self.code = code

    def __reduce__(self) -> tuple[Any, ...]:
        return (type(self), (self.message, self.code))


class InvalidArgumentError(IsoscopeError, ValueError):
    """An argument is out of its range; the message names it, its value and the allowed values."""

    code = "INVALID_ARGUMENT"


class NotFoundError(IsoscopeError, LookupError):
    """There is no dataset of that name; the message lists the datasets."""

    code = "NOT_FOUND"


class FailedPreconditionError(IsoscopeError):
    """The dataset's shards are not all served, or the agents don't fit each other."""

    code = "FAILED_PRECONDITION"


class ResourceExhaustedError(IsoscopeError):
    """Too many frames wait, or the picture needs more memory than the server may use.

    A refusal that tells a time to wait was tried again, until the call's time was up.
    """

    code = "RESOURCE_EXHAUSTED"


class UnavailableError(IsoscopeError, ConnectionError):
    """No server answers, or an agent was lost during the frame; was tried again before it came here."""

    code = "UNAVAILABLE"


class DeadlineExceededError(IsoscopeError, TimeoutError):
    """The call's time was up."""

    code = "DEADLINE_EXCEEDED"


class CancelledError(IsoscopeError):
    """The call was cancelled, or the client was closed meanwhile."""

    code = "CANCELLED"


class DataLossError(IsoscopeError):
    """A shard is damaged; the message names the place. For the operator of the server."""

    code = "DATA_LOSS"


class InternalError(IsoscopeError):
    """A bug of the server."""

    code = "INTERNAL"


class UnimplementedError(IsoscopeError):
    """The server is too old for this call, or is no Isoscope server."""

    code = "UNIMPLEMENTED"


class UnauthenticatedError(IsoscopeError, PermissionError):
    """The server wants a token or a client certificate, or does not accept this one."""

    code = "UNAUTHENTICATED"


class PermissionDeniedError(IsoscopeError, PermissionError):
    """The token is valid and does not allow this."""

    code = "PERMISSION_DENIED"


_CLASSES: dict[str, type[IsoscopeError]] = {cls.code: cls for cls in IsoscopeError.__subclasses__()}
_CLASSES["OUT_OF_RANGE"] = InvalidArgumentError


class ProgramError(IsoscopeError, OSError):
    """A local program of `isoscope.serve` is not installed, or ended with an error."""

    code = "FAILED_PRECONDITION"


class MissingPackageError(IsoscopeError, ImportError):
    """A Python package is not installed that this call needs; the message has the command that installs it."""

    code = "FAILED_PRECONDITION"


# Begins of gRPC's own messages when no server was reached: the server's messages never begin so.
_NO_CONNECTION = (
    "failed to connect",
    "connections to all backends",
    "dns resolution failed",
    "name resolution",
    "empty address list",
    "connection refused",
    "connect failed",
    "no such file",
    "socket closed",
    "connection reset",
    "recvmsg",
    "ssl_error",
    "handshak",
    "timeout occurred",
    "tcp handshaker",
)


# gRPC's own messages for broken connections: a damaged TLS record, or a server that shuts down. Our servers have other
# messages, and so has a cancellation here.
_BROKEN = {("UNKNOWN", "Stream removed"), ("CANCELLED", "CANCELLED")}


# Separators of lines and paragraphs, marks of the direction of text, tags: as core/base/printable.h.
_STEERING = frozenset(
    "\u061c\u200e\u200f\u2028\u2029\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
) | {chr(code) for code in range(0xE0000, 0xE0080)}


def printable(text: str) -> str:
    """Returns text of others as a terminal may get it: '?' for characters that steer it, but line feeds and tabs."""
    return "".join(
        "?" if (unicodedata.category(c) == "Cc" and c not in "\n\t") or c in _STEERING else c for c in text
    )


def explain(error: grpc.RpcError, address: str, timeout: float | None, secure: bool) -> IsoscopeError:
    """Returns what a call's error means: of the class of its code, with a sentence that helps."""
    code = error.code().name if isinstance(error.code(), grpc.StatusCode) else "UNKNOWN"
    details = printable(error.details() or "")
    if (code, details) in _BROKEN:
        code, details = "UNAVAILABLE", f"the connection to {address} broke ({details}); try again"
    if code == "UNAVAILABLE" and any(words in details.lower() for words in _NO_CONNECTION):
        details = (
            f"no coordinator answers at {address} ({details}); "
            + (
                "check the address, and that it speaks TLS with a certificate for that name"
                if secure
                else f"start one with 'isoscope serve DIR --listen {address}' or isoscope-coordinator, or, where "
                "the server wants TLS, pass tls=True or ca_file=..."
            )
        )
    elif code == "DEADLINE_EXCEEDED" and details.lower() in ("", "deadline exceeded"):
        details = f"no answer from {address} within {timeout:g} s; pass timeout=SECONDS for a longer wait"
    elif code == "UNIMPLEMENTED":
        details = f"{address} does not know this call ({details}): it is an older coordinator, or none"
    elif not details:
        details = f"{address} answered {code} without a message"
    return _CLASSES.get(code, IsoscopeError)(details, code)


def raise_explained(error: grpc.RpcError, address: str, timeout: float | None, secure: bool) -> NoReturn:
    """Raises what `explain` returns. The gRPC error is its cause, unless a traceback of it would steer a terminal."""
    details = error.details() or ""
    raise explain(error, address, timeout, secure) from (error if printable(details) == details else None)
