"""Connections: addresses, TLS, tokens, message sizes, retries.

1. `make_target` checks the arguments of `connect` and reads files and environment into a Target.
2. `make_channel` and `make_aio_channel` choose credentials and options; gRPC itself retries UNAVAILABLE.

Invariants: a token is sent in plaintext only to this machine, unless the user allows more; a pickled target has none.
"""

from __future__ import annotations

import dataclasses
import ipaddress
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import grpc

from isoscope._version import __version__
from isoscope.errors import InvalidArgumentError


DEFAULT_PORT = 50051
#: Deadline of a call in seconds, unless the client or the call says otherwise.
DEFAULT_TIMEOUT = 120.0
# Deadline of the first call, which checks that a server answers.
CONNECT_TIMEOUT = 10.0
_MAX_MESSAGE_BYTES = 256 << 20
_MIB = 1 << 20

# gRPC retries only calls that the server cannot have processed; all calls are idempotent. A call is tried four times
# within some two seconds, as long as no part of its answer has come.
_SERVICE_CONFIG = {
    "methodConfig": [
        {
            "name": [
                {"service": f"isoscope.v1.{service}"}
                for service in ("IsosurfaceService", "DatasetService", "ClusterService")
            ],
            "retryPolicy": {
                "maxAttempts": 4,
                "initialBackoff": "0.2s",
                "maxBackoff": "1.5s",
                "backoffMultiplier": 2.5,
                "retryableStatusCodes": ["UNAVAILABLE"],
            },
        }
    ]
}


@dataclass(frozen=True)
class Target:
    """Where and how to connect.

    Attributes:
        address: a gRPC target: HOST:PORT, or unix:PATH.
        tls: whether the connection is encrypted.
        ca_file, cert_file, key_file: PEM files; without `ca_file` gRPC's own roots hold.
        server_name: name that the server's certificate has, where it isn't that of the address.
        token: sent as `authorization: Bearer` with each call.
        token_file: the file that `token` was read from, if it was.
        metadata: more pairs for each call.
        timeout: deadline of a call, seconds.
        allow_insecure_token: whether the token may go unencrypted to another machine.
    """

    address: str
    tls: bool = False
    ca_file: str | None = None
    cert_file: str | None = None
    key_file: str | None = None
    server_name: str | None = None
    token: str | None = field(default=None, repr=False)
    token_file: str | None = None
    metadata: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    timeout: float = DEFAULT_TIMEOUT
    allow_insecure_token: bool = False

    def call_metadata(self) -> tuple[tuple[str, str], ...]:
        """Returns the metadata of each call."""
        return self.metadata + ((("authorization", f"Bearer {self.token}"),) if self.token else ())

    def __getstate__(self) -> dict[str, Any]:
        """Pickles where to connect: no token, and no metadata, which may hold secrets, too."""
        return {**self.__dict__, "token": None, "metadata": ()}

    def with_token(self) -> Target:
        """Returns a pickled target with this process's token: of its file, else of $ISOSCOPE_TOKEN."""
        if self.token_file is not None and os.path.isfile(self.token_file):
            return dataclasses.replace(self, token=_read_token(self.token_file))
        token = _token_of_environment()
        if token and not self.tls and not self.allow_insecure_token and not _is_local(self.address):
            token = None  # the server will say that it asks for one
        return dataclasses.replace(self, token=token, token_file=None)

    def credentials(self) -> Any:
        """Returns gRPC's credentials; InvalidArgumentError if a file can't be read."""
        return grpc.ssl_channel_credentials(
            root_certificates=_read(self.ca_file, "ca_file"),
            private_key=_read(self.key_file, "key_file"),
            certificate_chain=_read(self.cert_file, "cert_file"),
        )

    def options(self) -> list[tuple[str, Any]]:
        """Returns the options of a channel: those of our C++ clients, and retries."""
        options: list[tuple[str, Any]] = [
            ("grpc.primary_user_agent", f"isoscope-python/{__version__}"),
            ("grpc.max_receive_message_length", _MAX_MESSAGE_BYTES),
            ("grpc.max_send_message_length", _MAX_MESSAGE_BYTES),
            ("grpc.enable_retries", 1),
            ("grpc.service_config", json.dumps(_SERVICE_CONFIG)),
            ("grpc.keepalive_time_ms", 10_000),
            ("grpc.keepalive_timeout_ms", 5_000),
            ("grpc.http2.max_pings_without_data", 0),
            ("grpc.initial_reconnect_backoff_ms", 50),
            ("grpc.max_reconnect_backoff_ms", 1_000),
            ("grpc.min_reconnect_backoff_ms", 5_000),
            ("grpc.enable_http_proxy", 0),
            ("grpc.use_local_subchannel_pool", 1),
            ("grpc.http2.lookahead_bytes", _MIB),
            ("grpc.http2.max_frame_size", _MIB),
            ("grpc.experimental.tcp_read_chunk_size", _MIB // 4),
            ("grpc.experimental.tcp_min_read_chunk_size", _MIB // 16),
        ]
        if self.server_name:
            options.append(("grpc.ssl_target_name_override", self.server_name))
        return options


def _read(path: str | None, name: str) -> bytes | None:
    if path is None:
        return None
    try:
        with open(path, "rb") as file:
            return file.read()
    except OSError as error:
        raise InvalidArgumentError(f"{name}: can't read {path!r}: {error.strerror}") from error


def _read_token(path: str) -> str:
    """Returns the token in a file, without white space around it."""
    return _checked_token((_read(path, "token_file") or b"").decode("ascii", "replace"), f"token_file: {path!r}")


def _token_of_environment() -> str | None:
    """Returns $ISOSCOPE_TOKEN, as the programs take it; None if there is none."""
    token = os.environ.get("ISOSCOPE_TOKEN", "").strip()
    return _checked_token(token, "$ISOSCOPE_TOKEN") if token else None


def _checked_token(text: str, place: str) -> str:
    token = text.strip()
    if not token or not token.isascii() or not token.isprintable() or " " in token:
        raise InvalidArgumentError(f"{place} holds no token: one line of printable ASCII without spaces")
    return token


def make_target(
    address: str,
    *,
    tls: bool | None,
    ca_file: str | os.PathLike[str] | None,
    cert_file: str | os.PathLike[str] | None,
    key_file: str | os.PathLike[str] | None,
    server_name: str | None,
    token: str | None,
    token_file: str | os.PathLike[str] | None,
    allow_insecure_token: bool,
    metadata: Sequence[tuple[str, str]],
    timeout: float,
) -> Target:
    """Returns a checked target; InvalidArgumentError says what does not fit."""
    if address.startswith(("http://", "https://")):
        raise InvalidArgumentError(
            f"address {address!r}: that is the form of a web gateway's address; give the coordinator's, HOST:PORT "
            f"(default port: {DEFAULT_PORT})"
        )
    if tls is not False:
        ca_file = ca_file or os.environ.get("ISOSCOPE_TLS_CA") or None
        if cert_file is None and key_file is None:
            cert_file = os.environ.get("ISOSCOPE_TLS_CERT") or None
            key_file = os.environ.get("ISOSCOPE_TLS_KEY") or None
        server_name = server_name or os.environ.get("ISOSCOPE_TLS_SERVER_NAME") or None
    if (cert_file is None) != (key_file is None):
        raise InvalidArgumentError("cert_file and key_file belong together: give both or neither")
    if not timeout > 0:
        raise InvalidArgumentError(f"timeout {timeout!r}: must be above 0 seconds")
    files = {"ca_file": ca_file, "cert_file": cert_file, "key_file": key_file, "server_name": server_name}
    if tls is False and any(value is not None for value in files.values()):
        raise InvalidArgumentError("tls=False can't be given with ca_file, cert_file, key_file or server_name")
    secure = any(value is not None for value in files.values()) if tls is None else tls
    full = _with_port(address)
    if token_file is not None:
        if token is not None:
            raise InvalidArgumentError("token and token_file exclude each other: give one of them")
        token_file = os.fspath(token_file)
        token = _read_token(token_file)
    elif token is None:
        token = _token_of_environment()
    if token and not secure and not allow_insecure_token and not _is_local(full):
        raise InvalidArgumentError(
            f"a token would go to {full} unencrypted: pass tls=True or ca_file=..., or allow_insecure_token=True where "
            "the way there is encrypted by other means"
        )
    paths = {
        name: None if value is None else os.fspath(value) for name, value in files.items() if name != "server_name"
    }
    return Target(
        address=full,
        tls=secure,
        server_name=server_name,
        token=token,
        token_file=token_file,
        metadata=tuple((str(key).lower(), str(value)) for key, value in metadata),
        timeout=timeout,
        allow_insecure_token=allow_insecure_token,
        **paths,
    )


def _with_port(address: str) -> str:
    """Adds the default port to a host without one, also behind a resolver's name: gRPC's own default is 443."""
    text = address.strip()
    if not text:
        raise InvalidArgumentError("address is empty: give the coordinator's, HOST:PORT")
    if text.startswith(("unix:", "unix-abstract:", "xds:")):
        return text
    if text.startswith(("dns:", "ipv4:", "ipv6:")):
        scheme, _, rest = text.partition(":")
        # dns:[//AUTHORITY/]HOST, and for the others a list of addresses.
        authority, slash, hosts = rest.rpartition("/")
        return f"{scheme}:{authority}{slash}" + ",".join(_host_with_port(host, address) for host in hosts.split(","))
    return _host_with_port(text, address)


def _host_with_port(text: str, address: str) -> str:
    if text.startswith("["):
        return text if "]:" in text else f"{text}:{DEFAULT_PORT}"
    if text.count(":") > 1:
        return f"[{text}]:{DEFAULT_PORT}"
    host, colon, port = text.partition(":")
    if colon and not (port.isdigit() and 0 < int(port) < 65536):
        raise InvalidArgumentError(f"address {address!r}: the port must be a number from 1 to 65535, as in HOST:PORT")
    if not host:
        raise InvalidArgumentError(f"address {address!r}: the host is missing; give HOST:PORT")
    return text if colon else f"{text}:{DEFAULT_PORT}"


def _is_local(address: str) -> bool:
    if address.startswith("unix:"):
        return True
    host = address.rpartition(":")[0].strip("[]")
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def make_channel(target: Target) -> Any:
    """Returns a blocking channel."""
    if target.tls:
        return grpc.secure_channel(target.address, target.credentials(), target.options())
    return grpc.insecure_channel(target.address, target.options())


def make_aio_channel(target: Target) -> Any:
    """Returns a channel of the running event loop."""
    import grpc.aio

    if target.tls:
        return grpc.aio.secure_channel(target.address, target.credentials(), target.options())
    return grpc.aio.insecure_channel(target.address, target.options())
