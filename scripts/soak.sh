#!/usr/bin/env bash
# The long form of tests that scripts/test.sh runs for seconds. Either pictures of random volumes on both back ends, and
# agents that are killed under load while other processes use the processor; or a very large number of small random
# frames. Builds missing programs. Ends with 1 at the first failure, with the command to repeat it.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/soak.sh [MINUTES] [--seed N]
       scripts/soak.sh --threads [--frames N] [--seed N]

  MINUTES     of all parts together (default: 30)
  --threads   instead, small random frames: each is drawn with 1, 2, 3, 8 or 32 threads, some memory
              limit, options and cut of its volume, and compared with the same frame of one agent
              without culling and limit; prints seeds, frames, differences, and frames by threads
              and limits
  --frames N  how many frames are compared, at least (default: 100000)
  --seed N    of the first volume; each one after it has the next (default: from the clock)
  -h, --help  this text
USAGE
}

fail() {
  echo "soak.sh: $1; see --help" >&2
  exit 2
}

minutes=
frames=
threads=false
while [ $# -gt 0 ]; do
  case "$1" in
    -h | --help)
      usage
      exit 0
      ;;
    --threads) threads=true ;;
    --frames | --seed)
      [[ "${2:-}" =~ ^[1-9][0-9]*$ ]] || fail "$1 '${2:-}' is not a number"
      if [ "$1" = --frames ]; then
        frames="$2"
      else
        export ISOSCOPE_SOAK_SEED="$2"
      fi
      shift
      ;;
    '' | 0* | *[!0-9]*) fail "'$1' is not a number of minutes" ;;
    *) minutes="$1" ;;
  esac
  shift
done
if "$threads" && [ -n "$minutes" ]; then
  fail "--threads ends after --frames, not after minutes"
elif ! "$threads" && [ -n "$frames" ]; then
  fail "--frames needs --threads"
fi

cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/build.sh --with-tests
tests=build/release/tests

if "$threads"; then
  # Writing a small dataset safely to a disk takes longer than drawing it.
  if [ -w /dev/shm ]; then
    export TMPDIR=/dev/shm
  fi
  ISOSCOPE_SOAK_FRAMES="${frames:-100000}" "$tests/soak_test" --gtest_filter='*SmallFrames/Cpu' --gtest_brief=1
  exit
fi

# A third of the time for each part.
export ISOSCOPE_SOAK_SECONDS=$((${minutes:-30} * 20))
for back_end in Cpu Egl; do
  echo "== random volumes, $back_end"
  "$tests/soak_test" --gtest_filter="*WholePicture/$back_end" --gtest_brief=1
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
