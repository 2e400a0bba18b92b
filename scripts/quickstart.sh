#!/usr/bin/env bash
# From nothing to a picture: builds, cuts an MRI head into 4 shards, starts 4 agents and a
# coordinator as processes of their own, renders over gRPC, and stops what it started.
# The picture: build/quickstart/head.png
set -euo pipefail

if [ "$#" -gt 0 ]; then
  echo "Usage: scripts/quickstart.sh   (no arguments; see the head of the file)" >&2
  case "$1" in
    -h | --help) exit 0 ;;
    *) exit 2 ;;
  esac
fi

cd "$(dirname "${BASH_SOURCE[0]}")/.."
bash scripts/build.sh --target isoscope --target isoscope-agent --target isoscope-coordinator
. scripts/packages.sh
install_packages "${ISOSCOPE_DEMO_PACKAGES[@]}"

bin="$PWD/build/release/bin"
volume=/usr/share/mricron/templates/ch2.nii.gz
isovalue=60
out="$PWD/build/quickstart"
rm -rf "$out"
mkdir -p "$out/logs"

pids=()
stop_all() {
  local code=$?
  trap - EXIT INT TERM
  if [ "${#pids[@]}" -gt 0 ]; then
    kill "${pids[@]}" 2>/dev/null || true
    wait "${pids[@]}" 2>/dev/null || true
  fi
  exit "$code"
}
trap stop_all EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# start NAME EVENT PROGRAM...: starts a server and sets `address` to the one in its log line EVENT.
start() {
  local name="$1" event="$2"
  shift 2
  : >"$out/logs/$name.log"
  "$@" >"$out/logs/$name.log" 2>&1 </dev/null &
  pids+=("$!")
  local tries
  for ((tries = 0; tries < 300; tries++)); do
    address="$(sed -n "s/.* $event .*address=\([^ ]*\).*/\1/p" "$out/logs/$name.log")"
    if [ -n "$address" ]; then
      echo "$name listens on $address"
      return 0
    fi
    if ! kill -0 "${pids[-1]}" 2>/dev/null; then
      break
    fi
    sleep 0.1
  done
  echo "quickstart.sh: $name did not start:" >&2
  cat "$out/logs/$name.log" >&2
  return 1
}

echo "== partition"
"$bin/isoscope" partition "$volume" --output "$out/head" --shards 4

echo "== cluster"
agents=()
for shard in "$out"/head/shard-*; do
  start "agent-$(basename "$shard")" agent_started "$bin/isoscope-agent" "$shard" --listen 127.0.0.1:0
  agents+=(--agent "$address")
done
start coordinator coordinator_started "$bin/isoscope-coordinator" --listen 127.0.0.1:0 "${agents[@]}"
coordinator="$address"

# The coordinator has asked its agents once it has a dataset of which no shard is missing.
for ((tries = 0; tries < 300; tries++)); do
  if "$bin/isoscope" info --server "$coordinator" --json 2>/dev/null | grep -q '"missing_shards": \[\]'; then
    break
  fi
  sleep 0.1
done
"$bin/isoscope" info --server "$coordinator"

echo
echo "== render"
# From the front: y points to the back of the head, z to the crown.
"$bin/isoscope" render --server "$coordinator" --isovalue "$isovalue" \
  --eye 260,-480,60 --target 0,16,8 --up 0,0,1 --fov-y 26 \
  --background 0.1,0.11,0.13 --stats "$out/stats.json" --output "$out/head.png"

echo
echo "The picture: $out/head.png"
echo "Turn the head in a browser (Ctrl-C ends it):"
echo
echo "  $bin/isoscope view $out/head --isovalue $isovalue"
