"""Skips a test where something is missing on this machine, counted, as tests/support/skips.h does.

    ISOSCOPE_REQUIRE  reasons, separated by commas: such a skip is a failure ("all": each one)
    ISOSCOPE_SKIPS    a file that gets a line "reason<TAB>message" for each skip

CONTRIBUTING.md lists the reasons. Shells call it as a program: `exec python3 skips.py REASON MESSAGE...`
"""

import os
import sys
import unittest

SKIPPED = 77  # the exit code that CTest takes for a skip


def is_required(reason, required=None):
    """Whether a skip for this reason is a failure."""
    names = [name.strip() for name in (os.environ.get("ISOSCOPE_REQUIRE", "") if required is None else required).split(",")]
    return reason in names or "all" in names


def note_skip(reason, message):
    """Notes a skip. Returns whether it is a failure."""
    path = os.environ.get("ISOSCOPE_SKIPS")
    if path:
        with open(path, "a", encoding="utf-8") as file:
            file.write(f"{reason}\t{message}".replace("\n", " ") + "\n")
    return is_required(reason)


def skip(reason, message):
    """Ends a test of unittest or pytest as skipped, or as failed where ISOSCOPE_REQUIRE names the reason."""
    if note_skip(reason, message):
        raise AssertionError(f"ISOSCOPE_REQUIRE names {reason}: {message}")
    raise unittest.SkipTest(f"{reason}: {message}")


def skip_unless(condition, reason, message):
    """The same as a decorator of a class of tests or of a test method."""

    def decorate(test):
        def skipped(self):
            skip(reason, message)

        if condition:
            return test
        if isinstance(test, type):
            test.setUpClass = classmethod(skipped)
            return test
        skipped.__name__ = test.__name__
        return skipped

    return decorate


def skip_program(reason, message):
    """Ends the program as skipped, or with 1 where ISOSCOPE_REQUIRE names the reason."""
    if note_skip(reason, message):
        print(f"FAILED: ISOSCOPE_REQUIRE names {reason}: {message}", file=sys.stderr)
        sys.exit(1)
    print(f"skipped: {reason}: {message}", file=sys.stderr)
    sys.exit(SKIPPED)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: skips.py REASON MESSAGE...")
    skip_program(sys.argv[1], " ".join(sys.argv[2:]))
