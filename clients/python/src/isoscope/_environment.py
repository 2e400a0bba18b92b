"""Imports gRPC with forks on and log lines off. The package imports this before all else.

gRPC reads both from the environment: its Python part when it is imported, its C core when the first channel is made. So
the variables are set for these two steps, and then the environment is as it was. A variable of the user's wins.
"""

import os
import sys

_VARIABLES = {
    "GRPC_ENABLE_FORK_SUPPORT": "1",  # calls in forked children
    "GRPC_VERBOSITY": "NONE",  # no log lines beside our errors
}


def _import_grpc() -> None:
    added = {name: value for name, value in _VARIABLES.items() if name not in os.environ}
    os.environ.update(added)
    try:
        import grpc

        # Connects to nothing: a channel does so at its first call.
        grpc.insecure_channel("unix:isoscope").close()
    finally:
        for name in added:
            os.environ.pop(name, None)


if "grpc" not in sys.modules:
    _import_grpc()
