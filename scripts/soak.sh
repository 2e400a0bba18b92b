#!/usr/bin/env bash
# The long form of tests that scripts/test.sh runs for seconds: pictures of random volumes on both
# back ends, and agents that are killed under load, while other processes want the processor. Builds
# what is missing. Ends with 1 at the first failure, and says how to repeat it.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/soak.sh [MINUTES]

  MINUTES     of all parts together (default: 30)
  -h, --help  this text

ISOSCOPE_SOAK_SEED  first seed of the random volumes (default: from the clock)
USAGE
}

minutes="${1:-30}"
case "$minutes" in
  -h | --help)
    usage
    exit 0
    ;;
  '' | 0* | *[!0-9]*)
    echo "soak.sh: '$minutes' is not a number of minutes; see --help" >&2
    exit 2
    ;;
esac

cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/build.sh --with-tests
tests=build/release/tests

# A third of the time for each part.
export ISOSCOPE_SOAK_SECONDS=$((minutes * 20))
for back_end in Cpu Egl; do
  echo "== random volumes, $back_end"
  "$tests/soak_test" --gtest_filter="*/$back_end" --gtest_brief=1
done

echo "== faults under load"
load=()
trap 'kill "${load[@]}" 2>/dev/null || true' EXIT
for ((i = 0; i < $(nproc); i++)); do
  (while :; do :; done) &
  load+=("$!")
done
end=$((SECONDS + ISOSCOPE_SOAK_SECONDS))
runs=0
while ((SECONDS < end)); do
  "$tests/fault_test" --gtest_brief=1
  runs=$((runs + 1))
done
echo "soak.sh: passed: $ISOSCOPE_SOAK_SECONDS s of random volumes on each back end, $runs runs of the fault tests"
