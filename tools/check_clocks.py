#!/usr/bin/env python3
"""Checks that intervals, deadlines and waits use a clock that nobody sets.

    tools/check_clocks.py [ROOT]     checks the tree

A machine's date can jump by hours. So only the sources of DATED read it, each with its reason: logs, times of files,
certificates. All others use core/base/monotonic_time.h, time.monotonic() of Python, performance.now() of JavaScript.
Prints `file:line: what is wrong`; exit code 1 if anything is.
"""

import pathlib
import re
import sys

# Sources that may read the date, and why.
DATED = {
    "core/base/absl_waits.cc": "abseil gives the ends of its waits as dates",
    "core/base/metrics.cc": "Prometheus asks for the date of a process's start",
    "core/io/work_folder.cc": "times of files, and of the machine's start",
    "core/partition/part_writer.cc": "other machines read when a part was alive",
    "core/source/source_stamps.cc": "times of files",
    "core/source/remote/remote_client.cc": "requests of S3 are signed with their date",
    "core/source/remote/retry_policy.cc": "Retry-After may be a date, compared with the answer's own",
    "scripts/remote_soak.py": "requests of S3 are signed with their date",
    "rpc/certificate_watch.cc": "certificates end at a date",
    "rpc/certificate_watch.h": "certificates end at a date",
    "rpc/transport.cc": "certificates have dates",
    "server/access/audit_log.cc": "lines of the audit log have dates",
    "server/access/audit_log.h": "lines of the audit log have dates",
    "client-cli/commands/info_parts.cc": "the age of what other machines wrote",
    "client-cli/commands/top_command.cc": "the screen shows the date",
    "client-cli/terminal/top_screen.h": "the screen shows the date",
    "client-cli/session/cache_entry.cc": "times of files",
    "client-cli/session/cache_entry.h": "times of files",
    "bench/interactive.py": "results have dates",
    "bench/machine.cc": "results have dates",
    "scripts/package.sh": "times of files",
    "tests/unit/client-cli/session/cache_entry_test.cc": "times of files",
    "tests/unit/core/base/absl_waits_test.cc": "ends of waits as gRPC gives them",
    "tests/unit/core/base/monotonic_time_test.cc": "a date does not become a monotonic time",
    "tests/unit/rpc/grpc_time_test.cc": "gRPC gives some times as dates",
    "clients/web/view/state-stream.js": "the browser reads the date once: its page and its workers share that origin",
    "clients/web/view/worker.js": "the browser reads the date once: its page and its workers share that origin",
    "examples/node/picture_server.js": "grpc-js takes deadlines as dates",
}

SUFFIXES = {
    ".h": "c++", ".cc": "c++",
    ".py": "python",
    ".js": "javascript", ".mjs": "javascript", ".ts": "javascript", ".html": "javascript",
    ".sh": "shell",
}

# What reads the date, or waits for one.
DATES = {
    "c++": re.compile(
        r"absl::Now\b|absl::Time\b|absl::ToChronoTime\b|GetCurrentTime(?:Nanos|Alarm)|\bsystem_clock\b"
        r"|\bhigh_resolution_clock\b|\bfile_clock::now\b|\bCLOCK_REALTIME|\bGPR_CLOCK_REALTIME\b"
        r"|\bgettimeofday\b|\btimespec_get\b|\bftime\s*\("
        r"|(?<![\w.>])(?:std::|::)?time\s*\(\s*(?:nullptr|NULL|0|&)"
        r"|\b(?:pthread_cond_timedwait|pthread_mutex_timedlock|pthread_rwlock_timed\w+|sem_timedwait|mq_timed\w+)\b"
    ),
    "python": re.compile(
        r"\btime\.(?:time|time_ns|ctime|localtime|gmtime)\s*\(|\bfrom time import\b[^#]*\btime\b"
        r"|\bdatetime\.(?:now|utcnow|today)\b|\bdate\.today\b|\bCLOCK_REALTIME\b"
    ),
    "javascript": re.compile(r"\bDate\.now\b|\bnew Date\s*\(\s*\)|\bDate\s*\(\s*\)|\bperformance\.timeOrigin\b"),
    "shell": re.compile(r"\bdate\b[^|;&]*\+%s|\bEPOCH(?:SECONDS|REALTIME)\b"),
}
COMMENT = {
    "c++": re.compile(r"//.*"),
    "javascript": re.compile(r"(?<!:)//.*"),
    "python": re.compile(r"#.*"),
    "shell": re.compile(r"(?:^|\s)#.*"),
}
ADVICE = {
    "c++": "use base::MonotonicNow (core/base/monotonic_time.h)",
    "python": "use time.monotonic()",
    "javascript": "use performance.now()",
    "shell": "use $SECONDS",
}
SKIPPED = {".git", "build", "node_modules", "third_party"}


def date_of(file, line):
    """Returns what reads the date in `line` of `file`, or None."""
    language = SUFFIXES.get(pathlib.PurePosixPath(file).suffix)
    if language is None:
        return None
    match = DATES[language].search(COMMENT[language].sub("", line))
    return match and (match.group(0).strip(), ADVICE[language])


def files_of(root):
    """Yields the sources below `root`, as paths relative to it."""
    folders = [root]
    while folders:
        for path in sorted(folders.pop().iterdir()):
            if path.is_dir() and not path.is_symlink():
                if path.name not in SKIPPED:
                    folders.append(path)
            elif path.suffix in SUFFIXES and path.is_file():
                yield path.relative_to(root).as_posix()


def check(root):
    """Returns all faults of the tree below `root`."""
    complaints = []
    seen = set()
    for file in files_of(root):
        if file in OWN:
            continue
        for number, line in enumerate((root / file).read_text(encoding="utf-8", errors="replace").splitlines(), 1):
            found = date_of(file, line)
            if found is None:
                continue
            seen.add(file)
            if file not in DATED:
                complaints.append(
                    f"{file}:{number}: {found[0]} reads the machine's date, which can jump: {found[1]}, or say in "
                    "DATED of tools/check_clocks.py why a date is right here")
    for file in DATED:
        if (root / file).exists() and file not in seen:
            complaints.append(f"{file}:1: may read the date (tools/check_clocks.py) but does not")
    return complaints


# They name what they look for.
OWN = {"tools/check_clocks.py", "tests/unit/tools/check_clocks_test.py", "tests/support/date_functions.cc"}


def main():
    default = pathlib.Path(__file__).resolve().parent.parent
    complaints = check(pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else default)
    for complaint in complaints:
        print(complaint)
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
