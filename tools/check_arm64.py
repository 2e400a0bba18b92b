#!/usr/bin/env python3
"""Whether the product compiles for arm64: the sources of a build, by Debian's cross compiler, without code.

    check_arm64.py BUILD [--jobs N]

BUILD is a build folder with a compile_commands.json. Libraries' headers are those of this machine, which are the same
for arm64 but for what the C library and OpenSSL choose by machine: the cross compiler's own headers come first. Nothing
is linked and nothing runs, so this says that there is no x86 in the sources, and no more.

Needs Debian's g++-12-aarch64-linux-gnu. Exits with 1 if a source does not compile, and prints why.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import shlex
import shutil
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
COMPILER = "aarch64-linux-gnu-g++-12"
# Floating-point contraction and warnings are the build's; what is native is not.
DROPPED = ("-march", "-mtune", "-MD", "-MT", "-MF", "-o", "-c", "-include", "-Winvalid-pch")
# As cmake/IsoscopeCompilerOptions.cmake has it.
DISABLED_TARGETS = "(HWY_SVE|HWY_SVE2|HWY_SVE_256|HWY_SVE2_128)"
WITH_VALUE = ("-MT", "-MF", "-o", "-include")


def cross(command: str) -> list[str]:
    """The arguments of a compile command, for the cross compiler."""
    words = shlex.split(command)
    first = next(i for i, word in enumerate(words) if word.endswith(("g++", "c++", "clang++", "clang++-14")))
    arguments = [COMPILER, "-fsyntax-only", f"-DHWY_DISABLED_TARGETS={DISABLED_TARGETS}"]
    words = words[first + 1 :]
    i = 0
    while i < len(words):
        word = words[i]
        i += 1
        if word.startswith(DROPPED):
            i += word in WITH_VALUE
            continue
        if word == "-isystem" and words[i].startswith("/usr"):
            arguments += ["-idirafter", words[i]]
            i += 1
            continue
        arguments.append(word)
    return [*arguments, "-idirafter", "/usr/include", "-idirafter", "/usr/include/x86_64-linux-gnu"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    options = parser.parse_args()
    if shutil.which(COMPILER) is None:
        print(f"check_arm64.py: no {COMPILER} (Debian: g++-12-aarch64-linux-gnu)", file=sys.stderr)
        return 2
    entries = json.loads((options.build / "compile_commands.json").read_text())
    product = [
        entry
        for entry in entries
        if not any(part in entry["file"] for part in ("/tests/", "/proto/")) and entry["file"].endswith(".cc")
    ]

    def compile_one(entry: dict) -> tuple[str, subprocess.CompletedProcess]:
        return entry["file"], subprocess.run(
            cross(entry["command"]), cwd=entry["directory"], capture_output=True, text=True
        )

    failed = 0
    with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
        for file, done in pool.map(compile_one, product):
            if done.returncode != 0:
                failed += 1
                print(f"{file}:\n{done.stderr[:3000]}")
    print(f"check_arm64.py: {len(product) - failed} of {len(product)} sources compile for arm64")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
