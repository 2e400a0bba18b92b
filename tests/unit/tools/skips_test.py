"""Skips of Python and of shells: counted, failures where they are required, and none goes past the helper."""

import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
ROOT = pathlib.Path(__file__).resolve().parents[3]
SUPPORT = ROOT / "tests" / "support"
sys.path.insert(0, str(SUPPORT))
import skips  # noqa: E402


class SkipsTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.file = pathlib.Path(self.folder.name) / "skips.txt"
        self.environment = {**os.environ, "ISOSCOPE_SKIPS": str(self.file), "ISOSCOPE_REQUIRE": "vtk, head"}

    def run_program(self, *words):
        return subprocess.run([sys.executable, str(SUPPORT / "skips.py"), *words], env=self.environment,
                              capture_output=True, text=True)  # fmt: skip

    def test_a_program_ends_with_77_or_with_1_where_the_reason_is_required(self):
        done = self.run_program("data", "no", "volume")
        self.assertEqual((77, "skipped: data: no volume\n"), (done.returncode, done.stderr))
        done = self.run_program("vtk", "none")
        self.assertEqual(1, done.returncode)
        self.assertIn("ISOSCOPE_REQUIRE names vtk", done.stderr)
        self.assertEqual("data\tno volume\nvtk\tnone\n", self.file.read_text())

    def test_a_name_is_required_whole(self):
        self.assertFalse(skips.is_required("data", ""))
        self.assertFalse(skips.is_required("data", "metadata"))
        self.assertTrue(skips.is_required("data", "vtk, data"))
        self.assertTrue(skips.is_required("data", "all"))

    def test_methods_and_classes_are_skipped_or_fail(self):
        program = """
import sys, unittest
sys.path.insert(0, sys.argv.pop(1))
import skips

@skips.skip_unless(False, REASON, "none")
class Whole(unittest.TestCase):
    def test_one(self):
        raise ValueError("ran")

class Part(unittest.TestCase):
    @skips.skip_unless(False, REASON, "none")
    def test_one(self):
        raise ValueError("ran")

    @skips.skip_unless(True, REASON, "none")
    def test_two(self):
        pass

unittest.main()
"""
        for reason, code, sentence in (("data", 0, "skipped=2"), ("vtk", 1, "ISOSCOPE_REQUIRE names vtk")):
            done = subprocess.run([sys.executable, "-c", program.replace("REASON", repr(reason)), str(SUPPORT)],
                                  env=self.environment, capture_output=True, text=True)  # fmt: skip
            self.assertEqual(code, done.returncode, done.stderr)
            self.assertIn(sentence, done.stderr)
            self.assertNotIn("ValueError", done.stderr)

    def test_no_skip_goes_past_the_helper(self):
        own = re.compile(r"GTEST_SKIP\(|pytest\.skip\(|importorskip|SkipTest\(|skipUnless|skipIf|\.skipTest\(|exit 77|exit\(77\)")
        for folder in ("tests", "clients", "deploy"):
            for path in (ROOT / folder).rglob("*"):
                if path.suffix not in (".cc", ".h", ".py", ".sh", ".txt") or "node_modules" in path.parts:
                    continue
                if path.parent == SUPPORT or path == pathlib.Path(__file__).resolve():
                    continue
                found = own.search(path.read_text(errors="replace"))
                self.assertIsNone(found, f"{path}: {found and found.group()}: use tests/support/skips")


if __name__ == "__main__":
    unittest.main()
