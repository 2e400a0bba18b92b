#!/usr/bin/env bash
# The long form of tests that scripts/test.sh runs for seconds. Either pictures of random volumes on both back ends, and
# agents that are killed under load while other processes use the processor; or a very large number of small random
# frames, of volumes or of series. Builds missing programs. Ends with 1 at the first failure, with the command to repeat
# it.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/soak.sh [MINUTES] [--seed N]
       scripts/soak.sh --threads|--labels|--series|--levels|--depth-bounds [--frames N] [--seed N]
       scripts/soak.sh --parts [--kills N] [--seed N]
       scripts/soak.sh --remote [--faults N] [--s3rver FOLDER] [--seed N]

  MINUTES     of all parts together (default: 30)
  --threads   instead, small random frames: each is drawn with 1, 2, 3, 8 or 32 threads, some memory
              limit, options and cut of its volume, and compared with the same frame of one agent
              without culling and limit; prints seeds, frames, differences, and frames by threads
              and limits
  --labels    the same of random segmentations, with surfaces of labels; a tenth again with OpenGL
  --series    the same of random series (fields, components, steps, colours by another field), each
              compared with the frame of a dataset of its array alone; a tenth again with OpenGL
  --levels    the same of levels: volumes, segmentations and series with levels, colours by another
              field, samples, occlusion, silhouettes, and up to 64 threads; each is compared with
              the frame of levels that do not come from partitioning; a hundredth again with OpenGL
  --depth-bounds
              the depths of random frames are compared with the bounds of depth of their blocks; one
              view of each volume
  --parts     instead, datasets are cut in 1, 4 and 16 parts; processes are killed at random moments
              and run again, and the joined dataset is compared with that of one process
  --remote    instead, scripts/remote_soak.py: commands on files at an address, of nginx and of a
              server of S3, each behind a proxy that does wrong at random; their bytes are compared
  --faults N  how many answers the proxies spoil, at least (default: 2000)
  --s3rver FOLDER
              where npm installed s3rver; without it only nginx is asked
  --kills N   how many processes are killed for each number of parts (default: 200)
  --frames N  how many frames are compared, at least (default: 100000; of series and labels 20000; of
              --depth-bounds 10000)
  --seed N    of the first volume or series; each one after it has the next (default: from the clock)
  -h, --help  this text
USAGE
}

fail() {
  echo "soak.sh: $1; see --help" >&2
  exit 2
}

minutes=
frames=
kills=
faults=
s3rver=
small=
while [ $# -gt 0 ]; do
  case "$1" in
    -h | --help)
      usage
      exit 0
      ;;
    --threads | --labels | --series | --levels | --depth-bounds | --parts | --remote)
      [ -z "$small" ] ||
        fail "--threads, --labels, --series, --levels, --depth-bounds, --parts and --remote are runs of their own"
      small="$1"
      ;;
    --s3rver)
      [ -d "${2:-}/node_modules/s3rver" ] || fail "--s3rver '${2:-}' is no folder with node_modules/s3rver"
      s3rver="$2"
      shift
      ;;
    --frames | --kills | --faults | --seed)
      [[ "${2:-}" =~ ^[1-9][0-9]*$ ]] || fail "$1 '${2:-}' is not a number"
      if [ "$1" = --frames ]; then
        frames="$2"
      elif [ "$1" = --kills ]; then
        kills="$2"
      elif [ "$1" = --faults ]; then
        faults="$2"
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
if [ -n "$small" ] && [ -n "$minutes" ]; then
  fail "$small ends after --frames, --kills or --faults, not after minutes"
elif [ "$small" != --remote ] && [ -n "$faults$s3rver" ]; then
  fail "--faults and --s3rver need --remote"
elif [ "$small" = --remote ] && [ -n "$frames$kills" ]; then
  fail "--remote ends after --faults, not after --frames or --kills"
elif [ "$small" != --parts ] && [ -n "$kills" ]; then
  fail "--kills needs --parts"
elif [ "$small" = --parts ] && [ -n "$frames" ]; then
  fail "--parts ends after --kills, not after --frames"
elif [ -z "$small" ] && [ -n "$frames" ]; then
  fail "--frames needs --threads, --labels, --series, --levels or --depth-bounds"
fi

cd "$(dirname "${BASH_SOURCE[0]}")/.."
if [ "$small" = --remote ]; then
  bash scripts/build.sh
  options=(--faults "${faults:-2000}" --s3rver "$s3rver")
  if [ -n "${ISOSCOPE_SOAK_SEED:-}" ]; then
    options+=(--seed "$ISOSCOPE_SOAK_SEED")
  fi
  exec python3 scripts/remote_soak.py build/release/bin "${options[@]}"
fi
bash scripts/build.sh --with-tests
tests=build/release/tests

if [ "$small" = --parts ]; then
  ISOSCOPE_SOAK_KILLS="${kills:-200}" python3 tests/integration/parts_test.py build/release/bin '' \
    PartsTest.test_parts_that_are_killed_at_random_moments_end_in_the_same_bytes
  exit
fi

if [ -n "$small" ]; then
  # Writing a small dataset safely to a disk takes longer than drawing it.
  if [ -w /dev/shm ]; then
    export TMPDIR=/dev/shm
  fi
  run() {
    ISOSCOPE_SOAK_FRAMES="$2" "$tests/soak_test" --gtest_filter="$1" --gtest_brief=1
  }
  if [ "$small" = --threads ]; then
    run '*SmallFrames/Cpu' "${frames:-100000}"
  elif [ "$small" = --labels ]; then
    run '*FramesOfLabels/Cpu' "${frames:-20000}"
    run '*FramesOfLabels/Egl' "$((${frames:-20000} / 10 + 1))"
  elif [ "$small" = --levels ]; then
    run '*FramesOfLevels/Cpu' "${frames:-100000}"
    run '*FramesOfLevels/Egl' "$((${frames:-100000} / 100 + 1))"
  elif [ "$small" = --depth-bounds ]; then
    run '*ExactDepthsLieBetweenTheirBounds/Cpu' "${frames:-10000}"
  else
    run 'BackEnds/SoakTest.FramesOfSeries*/Cpu' "${frames:-20000}"
    run 'BackEnds/SoakTest.FramesOfSeries*/Egl' "$((${frames:-20000} / 10 + 1))"
  fi
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
