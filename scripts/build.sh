#!/usr/bin/env bash
# Installs what is missing and builds the programs: build/release/bin/{isoscope,isoscope-bench,
# isoscope-agent,isoscope-coordinator,isoscope-gateway}. Works from any folder; does little when all is there.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/build.sh [--with-tests] [--target T] [--jobs N]

  --with-tests  build the tests and benchmarks too
  --target T    build only this of it: release_tests is the part that scripts/test.sh runs
  --jobs N      compile N files at a time (default: one for each core)
  -h, --help    this text

ISOSCOPE_BROWSER_TESTS  off: with --with-tests, Chromium and Node are not installed

Packages: scripts/packages.sh; what is missing is installed as root or through sudo.
Programs: build/release/bin/
USAGE
}

with_tests=OFF
target=all
jobs="$(nproc)"
while [ "$#" -gt 0 ]; do
  case "$1" in
    --with-tests) with_tests=ON ;;
    --jobs)
      jobs="${2:-}"
      shift
      ;;
    --target)
      target="${2:-}"
      shift
      ;;
    -h | --help)
      usage
      exit 0
      ;;
    *)
      echo "build.sh: unknown argument '$1'; see --help" >&2
      exit 2
      ;;
  esac
  shift
done
if [ -z "$target" ]; then
  echo "build.sh: --target needs a name" >&2
  exit 2
fi
case "$jobs" in
  '' | *[!0-9]* | 0)
    echo "build.sh: --jobs needs a number of at least 1" >&2
    exit 2
    ;;
esac

cd "$(dirname "${BASH_SOURCE[0]}")/.."
# ccache keeps its files below HOME.
export HOME="${HOME:-/tmp}"
# One cache for all checkouts: what is compiled does not depend on where the tree lies.
export CCACHE_BASEDIR="$PWD" CCACHE_NOHASHDIR=true
. scripts/packages.sh
packages=("${ISOSCOPE_BUILD_PACKAGES[@]}")
if [ "$with_tests" = ON ]; then
  packages+=("${ISOSCOPE_TEST_PACKAGES[@]}" "${ISOSCOPE_DEMO_PACKAGES[@]}")
  if [ "${ISOSCOPE_BROWSER_TESTS:-on}" != off ]; then
    packages+=("${ISOSCOPE_BROWSER_PACKAGES[@]}")
  fi
fi
install_packages "${packages[@]}"

# Debian's GDCM tells at length about programs of its own that are not installed: warnings only.
cmake --preset release --log-level=WARNING \
  -DISOSCOPE_BUILD_TESTS="$with_tests" -DISOSCOPE_BUILD_BENCHMARKS="$with_tests"
cmake --build --preset release --parallel "$jobs" --target "$target"
echo "built: $PWD/build/release/bin/isoscope, isoscope-bench, isoscope-agent, isoscope-coordinator, isoscope-gateway"
