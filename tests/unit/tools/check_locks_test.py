"""check_locks.py finds a member that is used without its lock, and takes GCC's flags."""

import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "tests" / "support"))
import skips  # noqa: E402

SOURCE = """
#include "core/base/mutex.h"
class Counter {
 public:
  void Add() { %s ++count_; }
 private:
  isoscope::base::Mutex mutex_;
  int count_ ABSL_GUARDED_BY(mutex_) = 0;
};
void Use(Counter* counter) { counter->Add(); }
"""
FLAGS = "-std=c++20 -Wall -Wlogical-op -fpch-preprocess -fno-sanitize=vptr -O2 -o x.o -c"


class CheckLocksTest(unittest.TestCase):
    def run_on(self, lock):
        with tempfile.TemporaryDirectory() as folder:
            source = pathlib.Path(folder) / "counter.cc"
            source.write_text("#include \"absl/base/thread_annotations.h\"\n" + SOURCE % lock)
            command = f"env A=b ccache /usr/bin/g++ -I{ROOT} {FLAGS} {source}"
            database = [{"directory": folder, "file": str(source), "command": command}]
            (pathlib.Path(folder) / "compile_commands.json").write_text(json.dumps(database))
            return subprocess.run([sys.executable, str(ROOT / "tools" / "check_locks.py"), folder, str(source)],
                                  capture_output=True, text=True)  # fmt: skip

    @skips.skip_unless(shutil.which("clang++-14"), "clang", "no clang++-14 (Debian: clang-14)")
    def test_a_use_without_the_lock_is_found(self):
        done = self.run_on("")
        self.assertEqual(1, done.returncode, done.stderr)
        self.assertIn("requires holding mutex 'mutex_'", done.stderr)

    @skips.skip_unless(shutil.which("clang++-14"), "clang", "no clang++-14 (Debian: clang-14)")
    def test_a_use_with_it_is_not(self):
        done = self.run_on("const isoscope::base::MutexLock lock(&mutex_);")
        self.assertEqual(0, done.returncode, done.stderr)

    def test_a_tree_that_is_none_is_said(self):
        done = subprocess.run([sys.executable, str(ROOT / "tools" / "check_locks.py"), "/absent"],
                              capture_output=True, text=True)  # fmt: skip
        self.assertEqual(2, done.returncode)
        self.assertIn("check_locks.py: no ", done.stderr)


if __name__ == "__main__":
    unittest.main()
