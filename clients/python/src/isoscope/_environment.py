"""Imports gRPC with its log lines and its fork handlers off, and its waits by poll(2). The package imports this first.

gRPC's core reads the environment when the first channel is made. So the variables are set for this step, and then the
environment is as it was. A variable of the user's wins.
"""

import os
import sys

_VARIABLES = {
    "GRPC_VERBOSITY": "NONE",
    # On by default in builds for Python. They join threads that wait for the fork to end: a fork during a call may hang
    # (gRPC 1.51). isoscope._process_channel does what is needed.
    "GRPC_ENABLE_FORK_SUPPORT": "0",
    # By default an epoll set, which gRPC's shutdown leaves open. A forked child would share it with its parent, and
    # each would take events of the other: calls then waited for 5 or 10 s, and some failed.
    "GRPC_POLL_STRATEGY": "poll",
}


def _import_grpc() -> bool:
    """Returns whether gRPC surely has no epoll set."""
    is_first = "grpc" not in sys.modules
    # Who imported gRPC before us chose its log lines and its handlers.
    wanted = _VARIABLES if is_first else {"GRPC_POLL_STRATEGY": "poll"}
    ours = {name: value for name, value in wanted.items() if name not in os.environ}
    os.environ.update(ours)
    try:
        import grpc

        # Connects to nothing: a channel does so at its first call.
        grpc.insecure_channel("unix:isoscope").close()
        return is_first and os.environ["GRPC_POLL_STRATEGY"] == "poll"
    finally:
        for name in ours:
            os.environ.pop(name, None)


# False where another package imported gRPC before and may have made a channel, or the user chose how gRPC waits.
HAS_NO_EPOLL = _import_grpc()
