#!/usr/bin/env bash
# Injects faults into a running cluster by a seeded schedule and judges every answer: the long form of the test that
# scripts/test.sh runs for a minute. Builds missing programs. docs/lab/robustness.md has the details.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/robustness.sh [--seed N] [--faults N] [OPTIONS]

  --seed N    decides requests and faults (default: 1)
  --faults N  how many (default: 2000, some half an hour)
  -h, --help  this text, and that of the harness with all other options

The report goes to build/robustness/seed-N.txt and .json. Exit code 1: there are findings, and the data and
logs of the run are kept; the same seed gives the same faults at the same times.
USAGE
}

cd "$(dirname "${BASH_SOURCE[0]}")/.."
seed=1
faults=2000
others=()
while [ $# -gt 0 ]; do
  case "$1" in
    -h | --help)
      usage
      echo
      python3 tests/robustness/run.py --help
      exit 0
      ;;
    --seed | --faults)
      if ! [[ "${2:-}" =~ ^[0-9]+$ ]]; then
        echo "robustness.sh: $1 '${2:-}' is not a number; see --help" >&2
        exit 2
      fi
      printf -v "${1#--}" %s "$2"
      shift
      ;;
    *) others+=("$1") ;;
  esac
  shift
done

# shellcheck source=scripts/packages.sh
. scripts/packages.sh
install_packages "${ISOSCOPE_TEST_PACKAGES[@]}" "${ISOSCOPE_UNIT_TEST_PACKAGES[@]}" "${ISOSCOPE_CLIENT_TEST_PACKAGES[@]}"
bash scripts/build.sh
mkdir -p build/robustness
python3 tests/robustness/run.py --seed "$seed" --faults "$faults" --rate 3 --at-once 4 \
  --text "build/robustness/seed-$seed.txt" --json "build/robustness/seed-$seed.json" "${others[@]}"
