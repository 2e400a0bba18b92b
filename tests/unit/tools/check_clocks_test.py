"""Tests tools/check_clocks.py (its path is the first argument): each way to read the date is found."""

import importlib.util
import pathlib
import sys
import tempfile
import unittest

SCRIPT = sys.argv.pop(1)
_spec = importlib.util.spec_from_file_location("check_clocks", SCRIPT)
check_clocks = importlib.util.module_from_spec(_spec)
sys.dont_write_bytecode = True
_spec.loader.exec_module(check_clocks)


class DateOfTest(unittest.TestCase):
    def test_dates_are_found(self):
        for file, line in [
            ("a.cc", "const auto start = absl::Now();"),
            ("a.h", "std::function<absl::Time()> clock = absl::Now;"),
            ("a.h", "absl::Time deadline;"),
            ("a.cc", "context.set_deadline(absl::ToChronoTime(x));"),
            ("a.cc", "absl::GetCurrentTimeNanos()"),
            ("a.cc", "std::chrono::system_clock::now()"),
            ("a.cc", "std::chrono::high_resolution_clock::now()"),
            ("a.cc", "changed.wait_until(lock, std::chrono::system_clock::now() + d);"),
            ("a.cc", "srand(time(nullptr));"),
            ("a.cc", "std::time(NULL)"),
            ("a.cc", "::time(&now)"),
            ("a.cc", "gettimeofday(&now, nullptr);"),
            ("a.cc", "clock_gettime(CLOCK_REALTIME, &now);"),
            ("a.cc", "timerfd_create(CLOCK_REALTIME_ALARM, 0)"),
            ("a.cc", "gpr_now(GPR_CLOCK_REALTIME)"),
            ("a.cc", "pthread_cond_timedwait(&c, &m, &t);"),
            ("a.cc", "sem_timedwait(&s, &t);"),
            ("a.py", "end = time.time() + 5"),
            ("a.py", "from time import sleep, time"),
            ("a.py", "datetime.now()"),
            ("a.py", "datetime.datetime.utcnow()"),
            ("a.js", "const start = Date.now();"),
            ("a.ts", "const start = new Date();"),
            ("a.html", "<script>Date()</script>"),
            ("a.js", "performance.timeOrigin + x"),
            ("a.sh", "end=$(($(date +%s) + 5))"),
            ("a.sh", "end=$((EPOCHSECONDS + 5))"),
        ]:
            self.assertIsNotNone(check_clocks.date_of(file, line), (file, line))

    def test_other_clocks_and_comments_pass(self):
        for file, line in [
            ("a.cc", "base::MonotonicNow() + absl::Seconds(2)"),
            ("a.cc", "std::chrono::steady_clock::now()"),
            ("a.cc", "clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);"),
            ("a.cc", "absl::FormatTime(format, date, absl::UTCTimeZone())"),
            ("a.cc", "double run_time(0);"),
            ("a.cc", "// absl::Now() is the date"),
            ("a.cc", "selection.time(nullptr)"),
            ("a.py", "time.monotonic() + 5  # not time.time()"),
            ("a.py", "from time import monotonic, sleep"),
            ("a.js", "performance.now()"),
            ("a.js", "new Date(dataset.time)"),
            ("a.sh", "end=$((SECONDS + 5))"),
            ("a.sh", "# date +%s"),
            ("a.md", "absl::Now()"),
        ]:
            self.assertIsNone(check_clocks.date_of(file, line), (file, line))


class CheckTreeTest(unittest.TestCase):
    def test_complaints_name_file_line_and_what_to_do(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            (root / "rpc").mkdir(parents=True)
            (root / "build").mkdir()
            (root / "rpc/a.cc").write_text("int x;\nauto t = absl::Now();\n")
            (root / "rpc/transport.cc").write_text("auto t = absl::Now();\n")
            (root / "rpc/certificate_watch.cc").write_text("int x;\n")
            (root / "build/b.cc").write_text("auto t = absl::Now();\n")
            complaints = check_clocks.check(root)
        self.assertEqual(len(complaints), 2, complaints)
        self.assertTrue(complaints[0].startswith("rpc/a.cc:2: absl::Now reads the machine's date"), complaints)
        self.assertIn("use base::MonotonicNow", complaints[0])
        self.assertIn("rpc/certificate_watch.cc:1: may read the date", complaints[1])

    def test_each_source_that_may_read_the_date_is_there_and_has_a_reason(self):
        root = pathlib.Path(SCRIPT).resolve().parent.parent
        for file, reason in check_clocks.DATED.items():
            self.assertTrue((root / file).exists(), file)
            self.assertTrue(reason, file)


if __name__ == "__main__":
    unittest.main()
