"""Imports gRPC with its log lines and its fork handlers off. The package imports this before all else.

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
}


def _import_grpc() -> None:
    ours = {name: value for name, value in _VARIABLES.items() if name not in os.environ}
    os.environ.update(ours)
    try:
        import grpc

        # Connects to nothing: a channel does so at its first call.
        grpc.insecure_channel("unix:isoscope").close()
    finally:
        for name in ours:
            os.environ.pop(name, None)


if "grpc" not in sys.modules:
    _import_grpc()
