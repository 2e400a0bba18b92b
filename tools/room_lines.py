#!/usr/bin/env python3
"""Prints a table in Markdown: lines of code by room, product and tests apart, at each of several commits.

    tools/room_lines.py OLDEST... NEWEST

Lines are those of cloc (Debian: cloc), without blanks and comments. Prose and generated code do not count. The last
columns are the newest lines as a share of the lines of each older commit.
"""

import csv
import io
import subprocess
import sys
import tempfile

# A room, and the folders of its tests. Folders of the product come first.
ROOMS = [
    ("core", ["core"], ["tests/unit/core", "tests/fuzz/core"]),
    ("core/source", ["core/source", "core/formats", "core/synthetic"],
     ["tests/unit/core/source", "tests/unit/core/formats", "tests/unit/core/synthetic", "tests/fuzz/core/source",
      "tests/fuzz/core/formats"]),
    ("core, the rest", None, None),
    ("wire, rpc", ["wire", "rpc", "core/rpc"],
     ["tests/unit/wire", "tests/unit/rpc", "tests/unit/core/rpc", "tests/fuzz/wire", "tests/fuzz/rpc",
      "tests/fuzz/core/rpc"]),
    ("proto", ["proto"], ["tests/unit/proto"]),
    ("partition-agent", ["partition-agent"], ["tests/unit/partition-agent", "tests/fuzz/partition-agent"]),
    ("server", ["server"], ["tests/unit/server", "tests/fuzz/server"]),
    ("web-gateway", ["web-gateway"], ["tests/unit/web-gateway", "tests/fuzz/web-gateway"]),
    ("client-cli", ["client-cli"], ["tests/unit/client-cli", "tests/fuzz/client-cli"]),
    ("clients/cpp", ["clients/cpp"], ["tests/unit/clients/cpp", "tests/fuzz/clients/cpp", "tests/clients/cpp"]),
    ("clients/python", ["clients/python/src"], ["clients/python/tests", "tests/clients/python"]),
    ("clients/web", ["clients/web"], ["tests/clients/web"]),
    ("bench", ["bench"], ["tests/unit/bench"]),
    ("tests of all rooms", [], ["tests/integration", "tests/support", "tests/unit/support", "tests/unit/tools",
                                "tests/golden", "tests/robustness", "tests/deploy", "tests/benchmarks"]),
]
NOT_CODE = "Markdown,SVG,Text,JSON,XML"


def lines_by_file(commit):
    """The lines of code of each file."""
    with tempfile.TemporaryDirectory() as folder:
        archive = subprocess.run(["git", "archive", commit], check=True, stdout=subprocess.PIPE).stdout
        subprocess.run(["tar", "x", "-C", folder, "--exclude=*_pb2*"], check=True, input=archive)
        report = subprocess.run(["cloc", "--csv", "--quiet", "--by-file", f"--exclude-lang={NOT_CODE}", "."],
                                check=True, cwd=folder, stdout=subprocess.PIPE, text=True).stdout
    rows = csv.DictReader(io.StringIO(report.lstrip()))
    return {row["filename"].removeprefix("./"): int(row["code"]) for row in rows if row["language"] != "SUM"}


def lines_below(files, folders):
    return sum(code for name, code in files.items() if any(name.startswith(folder + "/") for folder in folders))


def counts_of(files):
    """Product and tests of each room."""
    counts = [(lines_below(files, product or []), lines_below(files, tests or [])) for _, product, tests in ROOMS]
    names = [name for name, _, _ in ROOMS]
    core, source, wire = (counts[names.index(name)] for name in ("core", "core/source", "wire, rpc"))
    if any(name.startswith("core/rpc/") for name in files):  # where it stood until November 2026
        core = (core[0] - wire[0], core[1] - wire[1])
        counts[names.index("core")] = core
    counts[names.index("core, the rest")] = (core[0] - source[0], core[1] - source[1])
    return counts


def main(commits):
    tables = [counts_of(lines_by_file(commit)) for commit in commits]
    print("| room |", " | ".join(commits), "|", " | ".join(f"of {commit}" for commit in commits[:-1]), "|")
    print("|---|" + "---:|" * (2 * len(commits) - 1))
    for i, (name, _, _) in enumerate(ROOMS):
        for part, suffix in enumerate(["", ", tests"]):
            lines = [table[i][part] for table in tables]
            if any(lines):
                label = name if name.startswith("tests") else name + suffix
                shares = [f"{lines[-1] / old:.2f}" if old else "-" for old in lines[:-1]]
                print(f"| {label} |", " | ".join(map(str, lines)), "|", " | ".join(shares), "|")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(sys.argv[1:])
