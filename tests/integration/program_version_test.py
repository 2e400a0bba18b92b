#!/usr/bin/env python3
"""All programs say one version, and one source of the build has it: a commit compiles nothing else.

    program_version_test.py BUILD
"""

import pathlib
import re
import subprocess
import sys
import unittest

BUILD = pathlib.Path(sys.argv[1]).resolve()
PROGRAMS = ("isoscope", "isoscope-agent", "isoscope-bench", "isoscope-coordinator", "isoscope-gateway")
SOURCE = BUILD / "core" / "base" / "program_version.cc"


class ProgramVersion(unittest.TestCase):
    def setUp(self):
        self.version = re.search(r'return "([^"]+)"', SOURCE.read_text()).group(1)

    def test_every_program_says_it(self):
        for name in PROGRAMS:
            program = BUILD / "bin" / name
            with self.subTest(program=name):
                said = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout
                self.assertEqual(said, f"{name} {self.version}\n")

    def test_no_command_of_the_build_has_it(self):
        # Without Git it is CMake's, which commands have.
        files = [BUILD / "build.ninja", BUILD / "compile_commands.json"] if "+git" in self.version else []
        for path in filter(pathlib.Path.exists, files):
            self.assertNotIn(self.version, path.read_text())

    def test_one_object_is_made_of_it(self):
        for path in filter(pathlib.Path.exists, [BUILD / "build.ninja"]):
            users = re.findall(r"^build (\S+\.o):.*program_version\.cc(?: |$)", path.read_text(), re.MULTILINE)
            self.assertEqual(users, ["core/base/CMakeFiles/isoscope_program_version.dir/program_version.cc.o"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
