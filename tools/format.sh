#!/usr/bin/env bash
# Formats all C++ files of the repository in place; with --check only lists those that are not.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

clang_format="$(command -v clang-format-14 || true)"
if [ -z "$clang_format" ]; then
  echo "format.sh: clang-format-14 is missing (another version formats differently):" \
    "apt-get install clang-format-14" >&2
  exit 1
fi
mode=(-i)
case "${1:-}" in
  '') ;;
  --check) mode=(--dry-run --Werror) ;;
  *)
    echo "Usage: tools/format.sh [--check]" >&2
    exit 2
    ;;
esac
git ls-files -z --cached --others --exclude-standard -- '*.cc' '*.h' |
  xargs -0 --no-run-if-empty "$clang_format" "${mode[@]}"
