"""Imports gRPC with its log lines off. The package imports this before all else.

gRPC's core reads the environment when the first channel is made. So the variable is set for this step, and then the
environment is as it was. A variable of the user's wins.
"""

import os
import sys


def _import_grpc() -> None:
    is_ours = "GRPC_VERBOSITY" not in os.environ
    if is_ours:
        os.environ["GRPC_VERBOSITY"] = "NONE"
    try:
        import grpc

        # Connects to nothing: a channel does so at its first call.
        grpc.insecure_channel("unix:isoscope").close()
    finally:
        if is_ours:
            os.environ.pop("GRPC_VERBOSITY", None)


if "grpc" not in sys.modules:
    _import_grpc()
