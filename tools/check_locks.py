#!/usr/bin/env python3
"""Checks the lock annotations of the product with clang's -Wthread-safety, which GCC does not know.

    check_locks.py BUILD [--jobs N] [SOURCE...]

BUILD is a configured and built tree of any compiler: its compile_commands.json and its generated sources are used,
and nothing is compiled. Without SOURCE, those are checked that lock or annotate, or whose header does. Ends with 1
where an annotation is broken, and with 2 where clang or the tree is missing.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
CLANG = "clang++-14"
LOCKS = re.compile(r"ABSL_(PT_)?(GUARDED_BY|EXCLUSIVE|SHARED|LOCKS|ACQUI|UNLOCK|ASSERT_)|MutexLock")
PRODUCT = ("core", "clients", "server", "partition-agent", "web-gateway", "client-cli", "bench")
# Debian's ITK refuses every compiler but GCC.
LEFT_OUT = {"core/source/child/itk_types.cc"}
# GCC options that clang does not know, and options that only write files.
DROPPED = re.compile(r"-f(?:no-)?(?:sanitize.*|pch-preprocess)|-o|-c|-W.*|-M.*")
FLAGS = ["-fsyntax-only", "-Wno-everything", "-Wthread-safety", "-Werror=thread-safety"]


def locks(path):
    """Whether a source or its header has locks or annotations."""
    texts = [file.read_text() for file in (path, path.with_suffix(".h")) if file.is_file()]
    return any(LOCKS.search(text) for text in texts)


def command_of(entry, source):
    """clang's command for a source, by the entry of compile_commands.json that compiles it."""
    words = shlex.split(entry["command"])
    compiler = next(i for i, word in enumerate(words) if re.search(r"(g\+\+|clang\+\+|c\+\+)[-\d]*$", word))
    kept, skips = [CLANG], 0
    for word in words[compiler + 1 :]:
        if skips:
            skips -= 1
        elif word in ("-o", "-MF", "-MT", "-MQ", "-include"):
            skips = 1
        elif not DROPPED.fullmatch(word):
            kept.append(str(source) if word == entry["file"] else word)
    return kept + FLAGS


def sources_of(entry):
    """The sources that an entry compiles: its own, or those that a batch of the build includes."""
    path = (pathlib.Path(entry["directory"]) / entry["file"]).resolve()
    lines = path.read_text().splitlines() if path.suffix == ".cc" and path.is_file() else []
    included = [re.fullmatch(r'#include "(.*\.cc)"', line) for line in lines]
    if included and all(included):
        return [ROOT / match[1] for match in included]
    return [path]


def check(source, entry):
    return subprocess.run(command_of(entry, source), cwd=entry["directory"], capture_output=True, text=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("sources", nargs="*", type=pathlib.Path)
    options = parser.parse_args()
    if shutil.which(CLANG) is None:
        print(f"check_locks.py: no {CLANG}: install the packages ISOSCOPE_LINT_PACKAGES of scripts/packages.sh", file=sys.stderr)
        return 2
    database = options.build / "compile_commands.json"
    if not database.is_file():
        print(f"check_locks.py: no {database}: configure and build that tree first", file=sys.stderr)
        return 2
    wanted = {source.resolve() for source in options.sources}
    entries = {}
    for entry in json.loads(database.read_text()):
        for path in sources_of(entry):
            try:
                relative = path.relative_to(ROOT)
            except ValueError:
                relative = path
            is_product = relative.parts[0] in PRODUCT and str(relative) not in LEFT_OUT
            if path in wanted or (not wanted and is_product and locks(path)):
                entries[path] = entry
    if not entries or wanted - set(entries):
        print(f"check_locks.py: {database} has none of {sorted(map(str, wanted)) or 'the product'}", file=sys.stderr)
        return 2
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        for path, done in zip(entries, pool.map(check, entries, entries.values())):
            if done.returncode != 0:
                failed += 1
                print(f"{path}:\n{done.stdout}{done.stderr}", file=sys.stderr)
    print(f"check_locks.py: {len(entries)} sources, {failed} with errors")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
