#!/usr/bin/env bash
# Tests the guards of the promises, or everything. Works on a bare machine: it installs and builds missing parts.
#
# Without arguments: the programs, every unit test, and the integration tests labelled `guard`: exact pictures with any
# number of agents and threads, faults, replicas, bad input.
# The rest (--rest, or with the first half --all): the other tests of programs, pictures, clients and benchmarks; unit
# tests under AddressSanitizer and UndefinedBehaviorSanitizer, and so those that are labelled `both` (other kernels,
# another malloc, hostile bytes); under ThreadSanitizer those that share data between threads without gRPC; clang
# checks the lock annotations, and libFuzzer runs for a minute.
# The last lines have the skipped tests and the result.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/test.sh [--all | --rest | --packages]

             the programs, unit tests, and the integration tests that guard the promises
  --all      these and the rest: other integration tests, clients, sanitizers, lock annotations, libFuzzer
  --rest     only the rest
  --packages only the Debian packages and the small image, in an empty Debian: as root, with a network
  -h, --help this text

ISOSCOPE_DATA_DIR       folder of real volumes that some tests use; if it is set, they must be there
ISOSCOPE_BROWSER_TESTS  off: Chromium and Node are not installed; tests of the page run if they are there
ISOSCOPE_REQUIRE        reasons, separated by commas, for which no test may be skipped (CONTRIBUTING.md lists them);
                        default: all that this script installs
USAGE
}

guards=true
rest=false
packages_only=false
for argument in "$@"; do
  case "$argument" in
    --all) rest=true ;;
    --rest) guards=false rest=true ;;
    --packages) guards=false packages_only=true ;;
    -h | --help)
      usage
      exit 0
      ;;
    *)
      echo "test.sh: unknown argument '$argument'; see --help" >&2
      exit 2
      ;;
  esac
done

cd "$(dirname "${BASH_SOURCE[0]}")/.."
export HOME="${HOME:-/tmp}"
# One cache for all checkouts: what is compiled does not depend on where the tree lies.
export CCACHE_BASEDIR="$PWD" CCACHE_NOHASHDIR=true
jobs="$(nproc)"
. scripts/packages.sh
packages=("${ISOSCOPE_UNIT_TEST_PACKAGES[@]}" "${ISOSCOPE_DEMO_PACKAGES[@]}")
required=(head programs openssl)
if [ "$packages_only" = true ]; then
  packages+=("${ISOSCOPE_PACKAGE_PACKAGES[@]}" lintian mmdebstrap)
fi
if [ "$rest" = true ]; then
  packages+=("${ISOSCOPE_CLIENT_TEST_PACKAGES[@]}" "${ISOSCOPE_REFERENCE_PACKAGES[@]}")
  required+=(python protoc shells vtk gnuplot clang)
  if [ ! -d /run/systemd/system ]; then
    packages+=("${ISOSCOPE_SERVICE_PACKAGES[@]}")
    required+=(prometheus)
  fi
  if [ "${ISOSCOPE_BROWSER_TESTS:-on}" != off ]; then
    packages+=("${ISOSCOPE_BROWSER_PACKAGES[@]}")
    required+=(browser node)
  fi
fi
if [ -n "${ISOSCOPE_DATA_DIR:-}" ]; then
  required+=(data)
fi
if [ -z "${ISOSCOPE_REQUIRE+set}" ]; then
  ISOSCOPE_REQUIRE="$(IFS=, && echo "${required[*]}")"
fi
export ISOSCOPE_REQUIRE
# Each skip is a line of this file: tests/support/skips.h.
export ISOSCOPE_SKIPS="$PWD/build/skips.txt"
mkdir -p build
: >"$ISOSCOPE_SKIPS"
summary=()
status=0

# run_stage NAME COMMAND...: records the result, and continues.
run_stage() {
  local name="$1" start="$SECONDS"
  shift
  echo "== $name"
  if "$@" </dev/null; then
    summary+=("$name ok ($((SECONDS - start)) s)")
  else
    summary+=("$name FAILED ($((SECONDS - start)) s)")
    status=1
  fi
}

run_ctest() {
  ctest --test-dir "$1" -j2 --output-on-failure --no-tests=error "${@:2}"
}

guard_tests() {
  run_ctest build/release -L '^(unit|guard)$'
}

other_tests() {
  run_ctest build/release -LE '^(unit|guard|package)$'
}

asan_tests() {
  cmake --preset asan --log-level=WARNING || return
  cmake --build --preset asan --parallel "$jobs" --target unit_tests both_tests &&
    run_ctest build/asan -L '^(unit|both)$'
}

# Tests labelled threads: they share data between threads without starting threads of gRPC. Its library is not built for
# ThreadSanitizer, which would report every object that gRPC passes between threads as a race. For TBB, the tsan preset
# has a stand-in (tests/support/tsan_tbb). Locks, also those of the tests, are base::Mutex, because abseil's are
# invisible too. There are no suppressions.
tsan_tests() {
  cmake --preset tsan --log-level=WARNING || return
  cmake --build --preset tsan --parallel "$jobs" --target threads_tests &&
    TSAN_OPTIONS=halt_on_error=1 run_ctest build/tsan -L '^threads$'
}

# The n-th allocation of a frame, of its picture and of its reads fails, for every n.
memory_tests() {
  ISOSCOPE_EVERY_ALLOCATION=1 run_ctest build/release -R '^(frame_memory|picture_memory|read_queue_memory)_test$'
}

lock_tests() {
  python3 tools/check_locks.py build/release --jobs "$jobs"
}

fuzz_tests() {
  bash scripts/fuzz.sh --short --jobs "$jobs"
}

# How many tests were skipped, by reason. A test that two stages skip counts twice.
print_skips() {
  local count
  count="$(wc -l <"$ISOSCOPE_SKIPS")"
  echo "test.sh: skipped: $count$(cut -f1 "$ISOSCOPE_SKIPS" | sort | uniq -c |
    awk '{ printf "%s %d %s", NR == 1 ? ":" : ",", $1, $2 }'); required: ${ISOSCOPE_REQUIRE:-nothing}"
}

run_stage packages install_packages "${packages[@]}"
if [ "$guards" = true ] && [ "$status" -eq 0 ]; then
  run_stage build bash scripts/build.sh --with-tests --target unit_tests --target guard_tests
  [ "$status" -ne 0 ] || run_stage "unit tests and guards" guard_tests
fi
if [ "$packages_only" = true ] && [ "$status" -eq 0 ]; then
  # All that is installed.
  targets=(isoscope isoscope-bench isoscope-agent isoscope-coordinator isoscope-gateway isoscope_client manuals)
  run_stage build bash scripts/build.sh --with-tests "${targets[@]/#/--target=}"
  [ "$status" -ne 0 ] || run_stage "packages and image" run_ctest build/release -L '^package$'
fi
if [ "$rest" = true ] && [ "$status" -eq 0 ]; then
  run_stage "build of the rest" bash scripts/build.sh --with-tests --target release_tests
  if [ "$status" -eq 0 ]; then
    run_stage "other tests" other_tests
    run_stage "failing allocations" memory_tests
    run_stage locks lock_tests
    run_stage fuzz fuzz_tests
    export ASAN_OPTIONS="${ASAN_OPTIONS:-detect_stack_use_after_return=1}"
    export UBSAN_OPTIONS="${UBSAN_OPTIONS:-print_stacktrace=1}"
    run_stage asan+ubsan asan_tests
    run_stage tsan tsan_tests
  fi
fi

print_skips
result=passed
[ "$status" -eq 0 ] || result=FAILED
printf -v stages '%s, ' "${summary[@]}"
echo "test.sh: $result: ${stages%, } in $SECONDS s"
exit "$status"
