#!/usr/bin/env bash
# Runs a reviewer's checks besides the tests: format, floors, imports, clocks, and clang-tidy on changed files.
#
#   tools/check.sh [--all | BASE]   files changed since BASE (default: main), or all of them
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

base="${1:-main}"
tools/format.sh --check
python3 tools/check_layers.py
python3 tools/check_imports.py
python3 tools/check_clocks.py

# clang-tidy needs compile_commands.json and generated headers.
cmake --preset clang --log-level=WARNING -DISOSCOPE_PRECOMPILED_HEADERS=OFF
cmake --build --preset clang --target isoscope_proto isoscope_reflection_proto
# Debian's ITK headers refuse every compiler but GCC; this one source of those that include them is left out.
sources=('*.cc' ':!tests/fuzz' ':!core/source/child/itk_types.cc')
if [ "$base" = --all ]; then
  mapfile -d '' files < <(git ls-files -z --cached --others --exclude-standard -- "${sources[@]}")
else
  mapfile -d '' files < <(
    git diff -z --name-only --diff-filter=d "$base" -- "${sources[@]}"
    git ls-files -z --others --exclude-standard -- "${sources[@]}"
  )
fi
if [ "${#files[@]}" -gt 0 ]; then
  printf '%s\0' "${files[@]}" |
    xargs -0 --max-procs="$(nproc)" --max-args=1 clang-tidy-14 -p build/clang --quiet
fi
echo "check.sh: passed"
