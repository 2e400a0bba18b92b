#!/usr/bin/env bash
# Installs what is missing and builds the programs: build/release/bin/{isoscope,isoscope-bench,
# isoscope-agent,isoscope-coordinator,isoscope-gateway}. Works from any folder; does little when all is there.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/build.sh [--with-tests] [--target T]... [--no-install] [--jobs N]

  --with-tests  build the tests and benchmarks too
  --target T    build only this of it, several times for more: isoscope is the command line
  --no-install  list the packages that are missing, and build only if there are none
  --jobs N      compile N files at a time (default: one for each core; each takes up to 1 GB of memory)
  -h, --help    this text

Packages: scripts/packages.sh; what is missing is installed as root or through sudo.
Programs: build/release/bin/
USAGE
}

with_tests=OFF
targets=()
install=yes
jobs="$(nproc)"
while [ "$#" -gt 0 ]; do
  case "$1" in
    --with-tests) with_tests=ON ;;
    --jobs)
      jobs="${2:-}"
      shift
      ;;
    --target)
      if [ -z "${2:-}" ]; then
        echo "build.sh: --target needs a name" >&2
        exit 2
      fi
      targets+=("$2")
      shift
      ;;
    --target=?*) targets+=("${1#*=}") ;;
    --no-install) install=no ;;
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
  packages+=("${ISOSCOPE_TEST_PACKAGES[@]}")
fi
if [ "$install" = no ]; then
  absent="$(missing_packages "${packages[@]}")"
  if [ -n "$absent" ]; then
    echo "build.sh: these Debian packages are missing; install them, or run without --no-install:" >&2
    echo "$absent"
    exit 1
  fi
fi
install_packages "${packages[@]}"

# Debian's GDCM tells at length about programs of its own that are not installed: warnings only.
cmake --preset release --log-level=WARNING \
  -DISOSCOPE_BUILD_TESTS="$with_tests" -DISOSCOPE_BUILD_BENCHMARKS="$with_tests"
export NINJA_STATUS='[%f/%t, %es] '
cmake --build --preset release --parallel "$jobs" --target "${targets[@]:-all}" | show_build_progress
echo "built, in $PWD/build/release/bin: ${targets[*]:-isoscope, isoscope-bench, isoscope-agent, isoscope-coordinator, isoscope-gateway}"
