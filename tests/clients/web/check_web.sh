#!/usr/bin/env bash
# Runs one check of clients/web; ends with 77 (skipped) where its program is missing:
#   check_web.sh types | unit | command | package | browser | page
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

# require PROGRAM PACKAGE
require() {
  if ! command -v "$1" >/dev/null; then
    exec python3 ../../support/skips.py node "$1 is missing; Debian has it in $2"
  fi
}

case "${1:-}" in
  types)
    require tsc node-typescript
    tsc --project tsconfig.json
    ;;
  unit)
    require node nodejs
    node --test view_test.mjs refinement_test.mjs view_state_test.mjs series_test.mjs label_sets_test.mjs undo_test.mjs values_test.mjs point_figures_test.mjs film_test.mjs
    ;;
  command)
    require node nodejs
    if [[ ! -x "${ISOSCOPE_BIN:-}/isoscope" ]]; then
      exec python3 ../../support/skips.py programs "ISOSCOPE_BIN names no folder with isoscope"
    fi
    node --test command_test.mjs
    ;;
  package)
    require node nodejs
    require tsc node-typescript
    if ! command -v protoc >/dev/null; then
      exec python3 ../../support/skips.py protoc "protoc is missing; Debian has it in protobuf-compiler"
    fi
    if ! /usr/bin/python3 -c 'import google.protobuf' 2>/dev/null; then
      exec python3 ../../support/skips.py python "Python's protobuf is missing; Debian has it in python3-protobuf"
    fi
    node --test package_test.mjs
    ;;
  browser)
    # Debian's own: another Python first on the PATH has no python3-selenium.
    exec /usr/bin/python3 browser_test.py
    ;;
  page)
    exec /usr/bin/python3 browser_page_test.py
    ;;
  *)
    echo "usage: check_web.sh types | unit | command | package | browser | page" >&2
    exit 2
    ;;
esac
