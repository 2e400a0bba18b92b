#!/usr/bin/env python3
"""The version: what scripts/version.sh prints for a tag, a commit and a tarball, and the source that is written of it.

    version_test.py CMAKE
"""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

CMAKE = sys.argv[1]
ROOT = pathlib.Path(__file__).resolve().parents[3]
# https://peps.python.org/pep-0440, Appendix B, without what we never write.
PEP_440 = re.compile(r"[0-9]+(\.[0-9]+)*(\+[a-z0-9]+(\.[a-z0-9]+)*)?")


class Version(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        # A project inside of another one's repository.
        self.outside = pathlib.Path(scratch.name)
        self.tree = self.outside / "isoscope"
        for name in ("scripts/version.sh", "cmake/WriteVersion.cmake", "CMakeLists.txt"):
            (self.tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, self.tree / name)
        text = (ROOT / "CMakeLists.txt").read_text()
        self.of_cmake = re.search(r"^  VERSION ([0-9.]+)$", text, re.MULTILINE).group(1)

    def git(self, *arguments, folder=None):
        names = {f"GIT_{who}_{what}": "x@example.org" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")}
        subprocess.run(
            ["git", "-c", "init.defaultBranch=main", *arguments], cwd=folder or self.tree, check=True,
            capture_output=True, env={"PATH": os.environ["PATH"], "HOME": "/nonexistent", **names},
        )  # fmt: skip

    def commit(self, folder=None):
        self.git("add", "--all", folder=folder)
        self.git("commit", "--allow-empty", "--message", "x", folder=folder)

    def run_script(self, **environment):
        return subprocess.run(
            ["bash", self.tree / "scripts" / "version.sh"], cwd="/", capture_output=True, text=True,
            env={"PATH": os.environ["PATH"], "HOME": "/nonexistent", **environment},
        )  # fmt: skip

    def version(self, **environment):
        done = self.run_script(**environment)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue(PEP_440.fullmatch(done.stdout.strip()), done.stdout)
        return done.stdout.strip()

    def test_without_git_it_is_that_of_cmake(self):
        self.assertEqual(self.version(), self.of_cmake)
        self.git("init", folder=self.outside)
        self.commit(self.outside)
        self.git("tag", "v9.9.9", folder=self.outside)
        self.assertEqual(self.version(), self.of_cmake)

    def test_with_git_it_names_tag_and_commit(self):
        self.git("init")
        self.assertEqual(self.version(), self.of_cmake)
        self.commit()
        self.commit()
        self.assertRegex(self.version(), rf"^{re.escape(self.of_cmake)}\+git2\.g[0-9a-f]{{7,}}$")
        (self.tree / "CMakeLists.txt").write_text("  VERSION 7.0.0\n")
        self.assertRegex(self.version(), r"^7\.0\.0\+git2\.g[0-9a-f]{7,}\.dirty$")
        self.commit()
        self.git("tag", "v7.1.0")
        self.git("tag", "v8.0.0-rc1")
        self.git("tag", "vendor")
        self.assertEqual(self.version(), "7.1.0")
        (self.tree / "CMakeLists.txt").write_text("\n")
        self.assertEqual(self.version(), "7.1.0+dirty")
        self.commit()
        self.assertRegex(self.version(), r"^7\.1\.0\+git1\.g[0-9a-f]{7,}$")

    def test_the_environment_overrides(self):
        self.git("init")
        self.commit()
        self.assertEqual(self.version(ISOSCOPE_VERSION="1.2.3"), "1.2.3")
        for wrong in ('1.0"', "1 0", "v1.0", "1", "1.0-2", "1.0\n"):
            done = self.run_script(ISOSCOPE_VERSION=wrong)
            self.assertEqual((done.returncode, done.stdout), (1, ""), wrong)

    def write(self, version=""):
        output = self.tree / "out.cc"
        subprocess.run(
            [CMAKE, f"-DOUTPUT={output}", f"-DVERSION={version}", "-P", self.tree / "cmake" / "WriteVersion.cmake"],
            check=True, capture_output=True, env={"PATH": os.environ["PATH"], "HOME": "/nonexistent"},
        )  # fmt: skip
        return output.read_text(), output.stat().st_mtime_ns

    def test_the_source_changes_with_the_version_only(self):
        self.git("init")
        self.commit()
        first = self.write()
        self.assertIn(f'"{self.version()}"', first[0])
        self.assertEqual(self.write(), first)
        self.commit()
        self.assertNotEqual(self.write()[0], first[0])
        self.assertIn('"4.5.6"', self.write("4.5.6")[0])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
