"""The web gateway of a server of `isoscope.serve`: it starts when a notebook first shows a view.

It listens on this machine's loopback address and asks for a token of its own, which is in the cells that it serves.
Pages of the origins that it is told may show its page in a frame, and may ask for frames.
"""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import secrets
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from isoscope._serving.programs import KeptProgram, find_beside
from isoscope.errors import ProgramError

_START_SECONDS = 30.0
# Of the version that can let pages of other origins show its page.
_FRAMING = "--allow-framing"


@dataclass(frozen=True)
class RunningGateway:
    """A gateway that runs.

    Attributes:
        url: its address, "http://127.0.0.1:PORT/".
        token: what every request for data must show.
        has_page: whether pages of its origins may show its page in a frame.
    """

    url: str
    token: str
    has_page: bool


class LocalGateway:
    """Starts a gateway when it is first asked for, and once more where another origin comes. Thread-safe.

    Args:
        program: the program `isoscope`, in whose folder, else on the PATH, is `isoscope-gateway`.
        server: address of the coordinator.
        token_file: file with its token.
        write_private: writes a text to a file that only this user can read, and returns the file's path.
    """

    def __init__(self, program: str, server: str, token_file: str, write_private: Callable[[str], str]) -> None:
        self._program = program
        self._server = server
        self._token_file = token_file
        self._write_private = write_private
        self._lock = threading.Lock()
        self._token = secrets.token_urlsafe(32)
        self._own_token_file: str | None = None
        self._origins: tuple[str, ...] = ()
        self._process: KeptProgram | None = None
        self._running: RunningGateway | None = None
        self._port = 0
        self._is_closed = False

    def start(self, origins: Sequence[str]) -> RunningGateway:
        """Returns the gateway, for pages of these origins, as "http://localhost:8888", and of those of before.

        Raises:
            ProgramError: `isoscope-gateway` is not installed, or has ended with an error.
        """
        with self._lock:
            if self._is_closed:
                raise ProgramError("the client is closed, and so is its gateway")
            wanted = tuple(dict.fromkeys([*self._origins, *origins]))
            is_running = self._process is not None and self._process.is_running()
            if self._running is None or not is_running or wanted != self._origins:
                self._end()
                try:
                    self._running = self._start(wanted)
                except ProgramError:
                    if is_running:  # a text that is no origin must not end the cells of before
                        self._running = self._start(self._origins)
                    raise
                self._origins = wanted
            return self._running

    def close(self) -> None:
        """Ends it. Any number of times."""
        with self._lock:
            self._is_closed = True
            self._end()

    def _end(self) -> None:
        process, self._process, self._running = self._process, None, None
        if process is not None:
            process.close()

    def _start(self, origins: Sequence[str]) -> RunningGateway:
        """Prefers the port of before, so that the cells of before go on."""
        gateway = find_beside(self._program, "isoscope-gateway")
        if gateway is None:
            raise ProgramError(
                f"the program 'isoscope-gateway' is neither beside {self._program} nor on the PATH: install it, or "
                "pass the address of one that runs, view(gateway='http://HOST:8080/')"
            )
        for port in dict.fromkeys([self._port, 0]):
            try:
                return self._start_at(gateway, port, origins)
            except ProgramError:
                if port == 0:
                    raise
        raise AssertionError("port 0 has returned or raised")

    def _start_at(self, gateway: str, port: int, origins: Sequence[str]) -> RunningGateway:
        try:
            return self._run(gateway, port, origins, has_page=True)
        except ProgramError as error:
            if _FRAMING not in str(error):
                raise
        return self._run(gateway, port, origins, has_page=False)

    def _run(self, gateway: str, port: int, origins: Sequence[str], has_page: bool) -> RunningGateway:
        self._own_token_file = self._own_token_file or self._write_private(self._token)
        command = [
            gateway, "--server", self._server, "--token-file", self._token_file, "--listen", f"127.0.0.1:{port}",
            "--gateway-token-file", self._own_token_file, "--log-format", "json",
        ]  # fmt: skip
        for origin in origins:
            command += ["--allow-origin", origin, *([_FRAMING, origin] if has_page else [])]
        # The flags say all: the variables of the programs may be for another gateway.
        environment = {name: value for name, value in os.environ.items() if not name.startswith("ISOSCOPE_")}
        log = pathlib.Path(self._own_token_file).with_name("gateway.log")
        process = KeptProgram(command, log, environment)
        try:
            address = _address_in(process.wait_for_log('"gateway_started"', _START_SECONDS))
        except BaseException:
            process.close()
            raise
        self._process = process
        self._port = int(address.rpartition(":")[2])
        return RunningGateway(f"http://{address}/", self._token, has_page)


def _address_in(line: str) -> str:
    """Returns HOST:PORT of the line that a gateway logs when it has started."""
    with contextlib.suppress(ValueError):
        address = json.loads(line).get("address")
        if isinstance(address, str) and address.rpartition(":")[2].isdigit():
            return address
    raise ProgramError(f"isoscope-gateway logs no address that this package can read: {line.strip()}")
