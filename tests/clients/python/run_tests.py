#!/usr/bin/env python3
"""Runs the tests of clients/python, or other tests of pytest, with an interpreter that has what they need.

    run_tests.py PROGRAMS [TESTS] [PYTEST-ARGUMENTS]

PROGRAMS is the folder of isoscope. The interpreter is $ISOSCOPE_PYTHON, this one, or Debian's
/usr/bin/python3: the first that imports grpc, protobuf, numpy and pytest. Without one it says so and
exits with 77: skipped.
"""

import os
import pathlib
import subprocess
import sys

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "support"))
import skips  # noqa: E402

TESTS = pathlib.Path(__file__).resolve().parents[3] / "clients" / "python" / "tests"
NEEDED = "import grpc, google.protobuf, numpy, pytest, sys; assert sys.version_info >= (3, 10)"


def main() -> int:
    programs, *arguments = sys.argv[1:]
    environment = {**os.environ, "ISOSCOPE_BIN": programs, "PYTHONDONTWRITEBYTECODE": "1"}
    for python in filter(None, (os.environ.get("ISOSCOPE_PYTHON"), sys.executable, "/usr/bin/python3")):
        try:
            if subprocess.run([python, "-c", NEEDED], stderr=subprocess.DEVNULL).returncode != 0:
                continue
        except OSError:
            continue
        tests = [] if arguments and os.path.exists(arguments[0]) else [TESTS]
        command = [python, "-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", *tests, *arguments]
        return subprocess.run(command, env=environment).returncode
    skips.skip_program(
        "python",
        "none >= 3.10 with grpc, protobuf, numpy and pytest (Debian: python3-grpcio python3-protobuf "
        "python3-numpy python3-pytest); ISOSCOPE_PYTHON may name one",
    )
    return skips.SKIPPED


if __name__ == "__main__":
    sys.exit(main())
