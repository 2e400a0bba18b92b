#!/usr/bin/env bash
# Fuzzes every decoder of foreign bytes with libFuzzer, AddressSanitizer and UBSan: docs/lab/fuzzing.md.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/fuzz.sh [--short | --seconds N] [--driver NAME]... [--corpus DIR] [--jobs N] [--no-build]

Builds the drivers (preset "fuzz", clang), writes their seeds, runs them and prints a table. Ends
with 1 if there is a finding, and says how to reproduce it.

  --short        a minute in all, for CI: the decoders of our own files and of bands, which compile in a few minutes
  --seconds N    for each driver (default: 300)
  --driver NAME  this one only, may be given several times (default: all; "list" names them)
  --corpus DIR   keeps what the drivers find between runs (default: build/fuzz/corpus)
  --jobs N       drivers that run at a time, and files that are compiled (default: 2)
  --no-build     runs what is built already, and leaves out what is not
  -h, --help     this text

Findings: build/fuzz/findings/DRIVER/
USAGE
}

fail() {
  echo "fuzz.sh: $*; see --help" >&2
  exit 2
}

seconds=300
jobs=2
corpus=build/fuzz/corpus
builds=yes
short=no
wanted=()
while [ "$#" -gt 0 ]; do
  case "$1" in
    --seconds | --jobs | --corpus | --driver)
      [ "$#" -gt 1 ] || fail "$1 needs a value"
      case "$1" in
        --seconds) seconds="$2" ;;
        --jobs) jobs="$2" ;;
        --corpus) corpus="$(realpath -m -- "$2")" ;;
        --driver) wanted+=("$2") ;;
      esac
      shift
      ;;
    --no-build) builds=no ;;
    --short) short=yes ;;
    -h | --help)
      usage
      exit 0
      ;;
    *) fail "unknown argument '$1'" ;;
  esac
  shift
done
for number in "$seconds" "$jobs"; do
  case "$number" in
    '' | *[!0-9]* | 0) fail "'$number' is no whole number of at least 1" ;;
  esac
done

if [ "$short" = yes ]; then
  wanted=(manifest_fuzz block_codec_fuzz block_overhang_fuzz range_table_fuzz histogram_file_fuzz shard_reader_fuzz pixel_codec_fuzz
    open_pixels_fuzz trace_context_fuzz)
  seconds=$(((60 * jobs + ${#wanted[@]} - 1) / ${#wanted[@]}))
fi

cd "$(dirname "${BASH_SOURCE[0]}")/.."
export CCACHE_BASEDIR="$PWD" CCACHE_NOHASHDIR=true
if [ "$builds" = yes ]; then
  command -v clang++-14 >/dev/null ||
    fail "clang++-14 is missing: install the packages ISOSCOPE_LINT_PACKAGES of scripts/packages.sh"
  cmake --preset fuzz --log-level=WARNING >/dev/null
fi
list=build/fuzz/fuzzers/drivers.txt
[ -f "$list" ] || fail "$list is missing: run once without --no-build"
if [ "${wanted[*]:-}" = list ]; then
  cut -d' ' -f1 "$list"
  exit 0
fi
for name in "${wanted[@]}"; do
  grep -q "^$name " "$list" || fail "there is no driver '$name': --driver list names them"
done
if [ "${#wanted[@]}" -eq 0 ]; then
  mapfile -t wanted < <(cut -d' ' -f1 "$list")
fi
if [ "$builds" = yes ]; then
  cmake --build --preset fuzz --parallel "$jobs" --target "${wanted[@]}"
fi

# Runs one driver, and leaves its row of the table in a file.
run_driver() {
  local name="$1" program="build/fuzz/fuzzers/$1" dictionary max_bytes has_threads
  read -r _ dictionary max_bytes has_threads < <(grep "^$name " "$list")
  local logs=build/fuzz/logs findings="build/fuzz/findings/$name"
  local seeds="build/fuzz/seeds/$name" inputs="$corpus/$name" log="build/fuzz/logs/$name.log"
  mkdir -p "$logs" "$findings" "$inputs" "build/fuzz/scratch/$name"
  rm -rf "$seeds" && mkdir -p "$seeds"
  # Temporary files of a driver that crashes stay in its own folder.
  export TMPDIR="$PWD/build/fuzz/scratch/$name"
  # A library that requests more than 1 GiB gets null, and must handle it. Our own code requests by operator new, which
  # then is a finding.
  export ASAN_OPTIONS="detect_stack_use_after_return=0:allocator_may_return_null=1:max_allocation_size_mb=1024:malloc_context_size=12"
  export UBSAN_OPTIONS=print_stacktrace=1
  ISOSCOPE_FUZZ_SEEDS="$seeds" "$program" >"$log" 2>&1 || true
  local options=(-max_total_time="$seconds" -max_len="$max_bytes" -timeout=25 -rss_limit_mb=2048
    -malloc_limit_mb=1048576 -print_final_stats=1 -artifact_prefix="$findings/")
  if [ "$dictionary" != - ]; then
    options+=(-dict="tests/fuzz/dictionaries/$dictionary")
  fi
  if [ "$has_threads" = TRUE ]; then
    options+=(-detect_leaks=0)
  fi
  local status=passed
  "$program" "${options[@]}" "$inputs" "$seeds" >>"$log" 2>&1 || status=FINDING
  rm -rf "$TMPDIR"
  local last executions edges features count
  last="$(grep -E '^#[0-9]+.* cov: ' "$log" | tail -n 1)"
  executions="$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")"
  edges="$(sed -n 's/.* cov: \([0-9]*\).*/\1/p' <<<"$last")"
  features="$(sed -n 's/.* ft: \([0-9]*\).*/\1/p' <<<"$last")"
  count="$(find "$inputs" -type f | wc -l)"
  printf '%-26s %12s %8s %9s %7s  %s\n' "$name" "${executions:--}" "${edges:--}" "${features:--}" \
    "$count" "$status" >"$logs/$name.row"
}

running=0
ran=()
for name in "${wanted[@]}"; do
  if [ ! -x "build/fuzz/fuzzers/$name" ]; then
    echo "fuzz.sh: $name is not built, and left out" >&2
    continue
  fi
  if [ "$running" -ge "$jobs" ]; then
    wait -n || true
    running=$((running - 1))
  fi
  run_driver "$name" &
  running=$((running + 1))
  ran+=("$name")
done
wait

printf '%-26s %12s %8s %9s %7s  %s\n' driver executions edges features corpus result
found=0
for name in "${ran[@]}"; do
  cat "build/fuzz/logs/$name.row"
done
for name in "${ran[@]}"; do
  if grep -q 'FINDING$' "build/fuzz/logs/$name.row"; then
    found=1
    input="$(find "build/fuzz/findings/$name" -type f -printf '%T@ %p\n' | sort -n | tail -n 1 | cut -d' ' -f2-)"
    echo
    echo "$name: $(grep -m1 -E 'broken promise|ERROR: |runtime error' "build/fuzz/logs/$name.log" || echo 'see its log')"
    echo "  log        build/fuzz/logs/$name.log"
    echo "  reproduce  build/fuzz/fuzzers/$name ${input:-(no input was kept)}"
    echo "  without clang: build/release/tests/$name ${input:-}"
  fi
done
exit "$found"
