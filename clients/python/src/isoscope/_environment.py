"""What gRPC reads from the environment, once, when it is imported. The package imports this before all else."""

import os
import sys

if "grpc" not in sys.modules:
    # Calls in forked children.
    os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "1")
    # No log lines beside our errors.
    os.environ.setdefault("GRPC_VERBOSITY", "NONE")
