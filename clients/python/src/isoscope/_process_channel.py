"""One channel for each process, and what a fork does to it.

gRPC's threads do not follow into a forked child, so its core works there only if it was shut down before. gRPC's own
handlers are off (isoscope._environment): on a busy machine those of version 1.51 ended 3 of 100 children, and now and
then a parent that forked during a call hung.

1. Before a fork, channels without a call at work are closed, and gRPC ends its threads, in some milliseconds.
2. Afterwards each process makes a channel at its next call.
3. If a channel stayed open, or gRPC's threads were there still, because of a call or of another channel, the child's
   calls are refused. Threads alone do not tell: on a busy machine a new one has not taken its name yet.
4. gRPC never closes the epoll set of its first channel. A child that shared it would lose events to its parent, and so
   would the parent. So gRPC waits by poll(2); a child of a process where it does not is refused.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from typing import Any

import grpc

from isoscope import _environment
from isoscope._channel import Target
from isoscope.errors import CancelledError, FailedPreconditionError

# Names of the threads of gRPC's core, as Linux cuts them: 15 characters. The last one, "grpc_shutdown", ends the others
# and then holds the lock that a new channel needs: a child forked there would wait for it for ever.
_CORE_THREADS = (
    "default-executo",
    "resolver-execut",
    "grpc_global_tim",
    "event_engine",
    "timer_manager",
    "lifeguard",
    "grpc_shutdown",
)
# The core ends its threads within 10 ms on a busy machine; this is for one that hardly runs.
_SHUTDOWN_SECONDS = 1.0


class ProcessChannel:
    """A channel that is made when it is first used, and anew after a fork. Thread-safe."""

    def __init__(self, target: Target, make: Callable[[Target], Any]) -> None:
        self._target = target
        self._make = make
        self._lock = threading.Lock()
        self._pid = -1
        self._channel: Any = None
        self._calls = 0
        self._closed = False
        _CHANNELS.add(self)

    def get(self) -> Any:
        """Returns this process's channel.

        Raises:
            CancelledError: the client is closed.
            FailedPreconditionError: this process was forked where gRPC could not follow; see the module's head.
        """
        with self._lock:
            if self._closed:
                raise CancelledError(f"the client of {self._target.address} is closed")
            if self._channel is None or self._pid != os.getpid():
                if _cut_off is not None:
                    raise FailedPreconditionError(
                        f"process {os.getpid()} was forked {_cut_off.when}, so it can't call "
                        f"{self._target.address}: {_cut_off.advice}, or start processes by multiprocessing's method "
                        "'spawn'"
                    )
                # The parent's channel is left alone: its sockets and threads belong to the parent.
                self._channel = self._make(self._target)
                self._pid = os.getpid()
            return self._channel

    @contextlib.contextmanager
    def call_at_work(self) -> Iterator[None]:
        """As long as this lasts, a fork does not close the channel."""
        with self._lock:
            self._calls += 1
        try:
            yield
        finally:
            with self._lock:
                self._calls -= 1

    def _is_open_here(self) -> bool:
        """Whether this process has a channel here that is not closed."""
        return self._channel is not None and self._pid == os.getpid()

    @property
    def is_closed(self) -> bool:
        """Whether calls are refused."""
        return self._closed

    def take_to_close(self) -> Any:
        """Returns the channel to close, or None, and refuses calls from now on."""
        with self._lock:
            channel = self._channel if self._is_open_here() else None
            self._channel, self._closed = None, True
            return channel


@dataclasses.dataclass(frozen=True)
class _CutOff:
    """Why gRPC can't work in a forked child, and what its user may do."""

    when: str
    advice: str


_AT_WORK = _CutOff(
    "while gRPC was at work",
    "fork while no call is at work and no async client or other channel of gRPC is open",
)
_SHARED_EPOLL = _CutOff(
    "from one whose gRPC waits by epoll, which a child would share",
    "import isoscope before what makes channels of gRPC, and leave GRPC_POLL_STRATEGY unset",
)

# The channels of this process, for the fork handlers.
_CHANNELS: weakref.WeakSet[ProcessChannel] = weakref.WeakSet()
# What cuts off the child of this process's next fork: its copy of gRPC can't work.
_cuts_off: _CutOff | None = None
# What cut off this process, or one before it.
_cut_off: _CutOff | None = None


def _has_core_threads() -> bool:
    """Whether gRPC's core is at work; False where the system has no list of threads."""
    with contextlib.suppress(OSError):
        for thread in os.listdir("/proc/self/task"):
            with contextlib.suppress(OSError), open(f"/proc/self/task/{thread}/comm") as name:
                if name.read().strip() in _CORE_THREADS:
                    return True
    return False


def _has_epoll_of_grpc() -> bool:
    """Whether gRPC has an epoll set that a forked child would share. In doubt, as with another C library's set, True."""
    if _environment.HAS_NO_EPOLL:
        return False
    with contextlib.suppress(OSError):
        for descriptor in os.listdir("/proc/self/fd"):
            with contextlib.suppress(OSError):
                if os.readlink(f"/proc/self/fd/{descriptor}") != "anon_inode:[eventpoll]":
                    continue
                with open(f"/proc/self/fdinfo/{descriptor}") as info:
                    # "tfd: 4 events: 80000001 data: 7f0c52a4e1c8 ...": gRPC's data are addresses, Python's descriptors.
                    watched = [line.split() for line in info if line.startswith("tfd:")]
                if any(int(words[5], 16) >> 32 not in (0, 0xFFFFFFFF) for words in watched):
                    return True
    return False


def _close_idle(channel: ProcessChannel) -> bool:
    """Closes the channel of this process, unless a call is at work. Returns whether it closed one."""
    # Who holds the lock begins a call or ends one; a fork in a signal handler may interrupt just that.
    if not channel._lock.acquire(blocking=False):
        return False
    try:
        idle = channel._channel
        # A channel of an event loop is closed only by its loop.
        if channel._calls > 0 or channel._pid != os.getpid() or not isinstance(idle, grpc.Channel):
            return False
        channel._channel = None
    finally:
        channel._lock.release()
    idle.close()
    return True


def _before_fork() -> None:
    """Closes the channels without a call, and waits until gRPC has ended its threads."""
    global _cuts_off
    channels = list(_CHANNELS)
    has_closed = [_close_idle(channel) for channel in channels]
    end = time.monotonic() + (_SHUTDOWN_SECONDS if any(has_closed) else 0)
    while (at_work := _has_core_threads()) and time.monotonic() < end:
        time.sleep(0.001)
    if at_work or any(channel._is_open_here() for channel in channels):
        _cuts_off = _AT_WORK
    else:
        _cuts_off = _SHARED_EPOLL if _has_epoll_of_grpc() else None


def _in_child() -> None:
    """A thread that only the parent has may have held a lock, or made a call."""
    global _cut_off
    _cut_off = _cut_off or _cuts_off
    for channel in list(_CHANNELS):
        channel._lock = threading.Lock()
        channel._calls = 0


os.register_at_fork(before=_before_fork, after_in_child=_in_child)
