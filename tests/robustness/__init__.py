"""Faults under load: real processes, a seeded schedule of faults, a model that judges every answer.

run.py is the command, docs/lab/robustness.md says what it does and what it found.

    schedule.py    which fault when, on whom: a function of the seed and the topology
    cluster.py     the processes: agents, coordinators, a reference; ports, logs, exits
    proxy.py       the process between the parties: cuts, delays, throttles, stops, corrupts connections
    faults.py      carries a fault out and heals it
    pool.py        the pool of requests, and how an answer becomes a digest
    load.py        threads that ask all the time
    documented.py  the errors that the comments of the protos allow
    model.py       judges an answer: exact, a documented error, or a finding
    quiet.py       looks, between storms, whether everything is well and idle again
    report.py      the table, as text and as JSON
"""

import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "support"))
import skips  # noqa: E402


def try_another_python(error):
    """Called where gRPC can't be imported: goes on as $ISOSCOPE_PYTHON or Debian's python3, else ends with 77."""
    tried = os.environ.get("ISOSCOPE_TRIED_PYTHONS", "").split(os.pathsep) + [os.path.realpath(sys.executable)]
    for python in filter(None, (os.environ.get("ISOSCOPE_PYTHON"), "/usr/bin/python3")):
        if os.path.exists(python) and os.path.realpath(python) not in tried:
            environment = {**os.environ, "ISOSCOPE_TRIED_PYTHONS": os.pathsep.join(tried)}
            os.execve(python, [python, *sys.argv], environment)
    skips.skip_program("python", f"{error}; on Debian: apt-get install python3-grpcio python3-protobuf python3-numpy")
