"""The programs of this machine: where they are, and one that runs as long as this process and its owner live.

Likewise a folder of temporary files, which goes however this process ends.
"""

from __future__ import annotations

import contextlib
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence

from isoscope.errors import ProgramError, printable

# Ends the program on SIGTERM, or when this process closes its end of the pipe, in whatever way it ends. It has its own
# session, so that Ctrl-C in a notebook reaches only the notebook.
_KEEPER = """
exec 3<&0
"$@" </dev/null 3<&- &
child=$!
trap 'kill $child 2>/dev/null' TERM INT
(cat <&3; kill $child) >/dev/null 2>&1 &
watcher=$!
exec 3<&-
wait $child
status=$?
while kill -0 $child 2>/dev/null; do wait $child; status=$?; done
# Its number may soon be another program's.
kill $watcher 2>/dev/null
exit $status
"""
# Removes a folder when this process closes its end of the pipe. A program that still writes there soon fails.
_CLEANER = """
trap '' TERM INT HUP
read -r line
for attempt in 1 2 3 4 5 6 7 8; do
  rm -rf -- "$1" 2>/dev/null && exit
  sleep 1
done
"""
_END_SECONDS = 15.0
_POLL_SECONDS = 0.02


def find_program() -> str:
    """Returns the path of the program `isoscope`: $ISOSCOPE_BIN (the program, or its folder), else the PATH.

    Raises:
        ProgramError: it is not installed.
    """
    named = os.environ.get("ISOSCOPE_BIN")
    if named:
        path = os.path.join(named, "isoscope") if os.path.isdir(named) else named
        if _can_run(path):
            return path
        raise ProgramError(f"$ISOSCOPE_BIN is {named!r}: there is no program 'isoscope' that can be run")
    found = shutil.which("isoscope")
    if found is None:
        raise ProgramError(
            "the program 'isoscope' is not installed here: put its folder on the PATH or into $ISOSCOPE_BIN "
            "(in a checkout, scripts/build.sh makes build/release/bin), or use isoscope.connect('HOST:PORT')"
        )
    return found


def find_beside(program: str, name: str) -> str | None:
    """Returns another program of the same folder, else of the PATH; None if there is none."""
    for folder in dict.fromkeys([os.path.dirname(program), os.path.dirname(os.path.realpath(program))]):
        path = os.path.join(folder, name)
        if _can_run(path):
            return path
    return shutil.which(name)


def _can_run(path: str) -> bool:
    return os.path.isfile(path) and os.access(path, os.X_OK)


def last_line(text: str) -> str:
    """Returns the last line that says something: the programs' errors are one sentence, with a hint to --help."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("Run with --help")]
    return printable(lines[-1].strip()) if lines else "it said nothing"


class KeptProgram:
    """A program that ends when this is closed, and with this process. Only the process that started it ends it.

    Args:
        command: the program and its arguments.
        log: file for what it writes to its standard error.
        environment: its environment; None: that of this process.
    """

    def __init__(
        self, command: Sequence[str], log: pathlib.Path, environment: Mapping[str, str] | None = None
    ) -> None:
        self._pid = os.getpid()
        self._name = os.path.basename(command[0])
        self._log = log
        with open(log, "wb", opener=lambda path, flags: os.open(path, flags, 0o600)) as file:
            self._process: subprocess.Popen[str] | None = subprocess.Popen(
                ["/bin/sh", "-c", _KEEPER, "isoscope-serve", *command],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=file,
                text=True,
                start_new_session=True,
                env=environment,
            )

    def first_line(self) -> str:
        """Waits for the first line of its standard output; "" if the program has ended without one.

        The rest is not read: a program that prints more blocks.
        """
        assert self._process is not None and self._process.stdout is not None
        line = self._process.stdout.readline().strip()
        if not line:
            self._process.wait()
        return line

    def wait_for_log(self, event: str, seconds: float) -> str:
        """Waits for a line of the log with this word, and returns it.

        Raises:
            ProgramError: the program has ended, or has not written the line in this time.
        """
        assert self._process is not None
        end = time.monotonic() + seconds
        while True:
            has_ended = self._process.poll() is not None
            found = [line for line in self.log_text().splitlines(keepends=True) if event in line and line.endswith("\n")]
            if found:
                return found[0]
            if has_ended:
                raise ProgramError(f"{self._name} failed: {last_line(self.log_text())}")
            if time.monotonic() > end:
                raise ProgramError(f"{self._name} has not started within {seconds:g} s: {last_line(self.log_text())}")
            time.sleep(_POLL_SECONDS)

    def log_text(self) -> str:
        """Returns what it has written to its standard error."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def is_running(self) -> bool:
        """Returns whether it runs, as far as this process can tell."""
        return self._process is not None and os.getpid() == self._pid and self._process.poll() is None

    def close(self) -> None:
        """Lets work in hand finish, for a while; then kills. Any number of times."""
        if os.getpid() != self._pid or self._process is None:
            return
        process, self._process = self._process, None
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        try:
            process.wait(timeout=_END_SECONDS)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()


class ScratchFolder:
    """A folder of temporary files that goes when this is closed, and with this process, even if that is killed.

    Only the process that made it removes it.

    Attributes:
        path: of the folder.
    """

    def __init__(self) -> None:
        self._pid = os.getpid()
        self.path = tempfile.mkdtemp(prefix="isoscope-")
        try:
            self._cleaner: subprocess.Popen[bytes] | None = subprocess.Popen(
                ["/bin/sh", "-c", _CLEANER, "isoscope-scratch", self.path],
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except BaseException:
            shutil.rmtree(self.path, ignore_errors=True)
            raise

    def close(self) -> None:
        """Removes the folder. Any number of times."""
        if os.getpid() != self._pid or self._cleaner is None:
            return
        cleaner, self._cleaner = self._cleaner, None
        shutil.rmtree(self.path, ignore_errors=True)
        if cleaner.stdin is not None:
            cleaner.stdin.close()
        cleaner.wait()
