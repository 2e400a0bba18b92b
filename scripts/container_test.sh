#!/usr/bin/env bash
# Builds the container images, runs deploy/compose.yaml with a real volume and checks its promises:
#
# 1. The picture equals that of an embedded run, bit for bit.
# 2. An agent sees only its own shard, and its container has no more rights than needed.
# 3. A lost agent makes requests fail until it is back.
# 4. All containers end cleanly on SIGTERM.
#
# Needs a container engine and compose; reports their absence and succeeds without them. Not part of scripts/test.sh.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/container_test.sh [--no-build] [VOLUME [ISOVALUE]]

  --no-build  use the images isoscope, isoscope-cli-cpu, isoscope-agent, isoscope-coordinator and
              isoscope-gateway as they are
  -h, --help  this text

VOLUME defaults to the MRI head of Debian's mricron-data, ISOVALUE to 60.

BASE_IMAGE     what the images are built on (default: debian:bookworm-slim)
BUILD_OPTIONS  more options for `docker build`, such as --network host
TEST_PORT      port of this host that the coordinator is published on (default: 50951); the gateway has the next one,
               and the page of isoscope view the one after that
USAGE
}

build=true
positional=()
for argument in "$@"; do
  case "$argument" in
    --no-build) build=false ;;
    -h | --help)
      usage
      exit 0
      ;;
    -*)
      echo "container_test.sh: unknown argument '$argument'; see --help" >&2
      exit 2
      ;;
    *) positional+=("$argument") ;;
  esac
done
volume="${positional[0]:-/usr/share/mricron/templates/ch2.nii.gz}"
isovalue="${positional[1]:-60}"
port="${TEST_PORT:-50951}"
server="localhost:$port"
export BASE_IMAGE="${BASE_IMAGE:-debian:bookworm-slim}"

cd "$(dirname "${BASH_SOURCE[0]}")/.."

if ! docker info >/dev/null 2>&1; then
  echo "container_test.sh: skipped: no container engine answers (docker info)"
  exit 0
fi
if docker compose version >/dev/null 2>&1; then
  compose=(docker compose)
elif command -v docker-compose >/dev/null; then
  compose=(docker-compose)
else
  echo "container_test.sh: skipped: neither 'docker compose' nor docker-compose is installed"
  exit 0
fi
if [ ! -r "$volume" ]; then
  echo "container_test.sh: no volume '$volume'; give one, or install mricron-data" >&2
  exit 2
fi
volume="$(realpath "$volume")"

passed=0
failed=0

pass() {
  passed=$((passed + 1))
  echo "pass  $1"
}

fail() {
  failed=$((failed + 1))
  echo "FAIL  $1${2:+: $2}"
}

# check NAME COMMAND...: passes if the command succeeds; its output is shown if it does not.
check() {
  local name="$1" output
  shift
  if output="$("$@" 2>&1)"; then
    pass "$name"
  else
    fail "$name" "$output"
  fi
}

# check_equal NAME ACTUAL EXPECTED
check_equal() {
  if [ "$2" = "$3" ]; then
    pass "$1"
  else
    fail "$1" "got '$2', expected '$3'"
  fi
}

# eventually SECONDS COMMAND...: tries until it succeeds.
eventually() {
  local end=$((SECONDS + $1))
  shift
  until "$@" >/dev/null 2>&1; do
    if [ "$SECONDS" -ge "$end" ]; then
      "$@"
      return
    fi
    sleep 0.2
  done
}

work="$(mktemp -d)"
project="isoscope-test-$$"
agents=(agent-0 agent-1 agent-2 agent-3)
# The gateway is separate: it has a place for temporary files.
services=(coordinator "${agents[@]}")
export ISOSCOPE_DATASET="$work/head" ISOSCOPE_PUBLISH="127.0.0.1:$port" ISOSCOPE_RENDERER=cpu
export ISOSCOPE_GATEWAY_PUBLISH="127.0.0.1:$((port + 1))"
export ISOSCOPE_AGENT_MEMORY=2g ISOSCOPE_COORDINATOR_MEMORY=1g ISOSCOPE_THREADS=0

files=(--file deploy/compose.yaml)
run_compose() {
  "${compose[@]}" --project-name "$project" "${files[@]}" "$@"
}

finish() {
  local code=$?
  trap - EXIT INT TERM
  if [ "$failed" -gt 0 ] || [ "$code" -ne 0 ]; then
    run_compose logs --no-color --tail 20 2>/dev/null || true
  fi
  run_compose down --volumes >/dev/null 2>&1 || true
  rm -rf "$work"
  exit "$code"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

# The command line from its image, as the user who runs this, on the network of this host.
isoscope() {
  docker run --rm --network host --read-only --user "$(id -u):$(id -g)" --volume "$work:/data" \
    --volume "$(dirname "$volume"):/source:ro" isoscope "$@"
}

container() {
  run_compose ps --all --quiet "$1"
}

in_container() {
  docker exec "$(container "$1")" "${@:2}"
}

inspect() {
  docker inspect --format "$2" "$(container "$1")"
}

render_through_server() {
  isoscope render --server "$server" --isovalue "$isovalue" --stats /data/stats.json --output "/data/$1"
}

is_complete() {
  isoscope info --server "$server" --json | tr -d ' \n' | grep -q '"missing_shards":\[\]'
}

are_healthy() {
  local service
  for service in "${services[@]}" gateway; do
    [ "$(inspect "$service" '{{.State.Health.Status}}')" = healthy ] || return
  done
}

if [ "$build" = true ]; then
  echo "== images"
  for target in coordinator agent gateway cli cli-cpu; do
    image="isoscope-$target"
    [ "$target" = cli ] && image=isoscope
    # shellcheck disable=SC2086  # several options
    docker build ${BUILD_OPTIONS:-} --build-arg BASE_IMAGE="$BASE_IMAGE" \
      --build-arg ISOSCOPE_VERSION="$(bash scripts/version.sh)" --target "$target" \
      --tag "$image" . >"$work/build.log" 2>&1 || {
      tail -n 40 "$work/build.log" >&2
      echo "container_test.sh: docker build --target $target failed" >&2
      exit 1
    }
  done
fi
for image in isoscope-coordinator isoscope-agent isoscope-gateway isoscope isoscope-cli-cpu; do
  check "$image runs: $(docker run --rm "$image" --version)" docker run --rm "$image" --version
  check_equal "$image is not root" "$(docker run --rm --entrypoint id "$image" -u)" 10001
  echo "      size $(($(docker image inspect --format '{{.Size}}' "$image") / 1000000)) MB"
done

echo "== view"
viewer="$(docker run --rm --detach --publish "127.0.0.1:$((port + 2)):8080" --volume "$(dirname "$volume"):/source:ro" \
  isoscope-cli-cpu view "/source/$(basename "$volume")")"
page() { docker logs "$viewer" 2>/dev/null | grep '^http://localhost:8080/?token='; }
check "view prints an address for the host" eventually 60 page
check "which answers there" curl -fsS -o /dev/null "$(page | sed "s/:8080/:$((port + 2))/")"
check "view ends with the container" docker stop "$viewer"

echo "== dataset"
check "partition in the isoscope image" \
  isoscope partition "/source/$(basename "$volume")" --output /data/head --shards 4
check "embedded render in the isoscope image" \
  isoscope render /data/head --renderer cpu --isovalue "$isovalue" --output /data/embedded.png

echo "== cluster"
check "compose up" run_compose up --detach --no-build
check "all shards are found" eventually 60 is_complete
check "all health checks pass" eventually 60 are_healthy
for i in 0 1 2 3; do
  agent="agent-$i"
  check_equal "$agent sees the files of its own shard and no other's" \
    "$(in_container "$agent" find /shard -type f -exec sha256sum {} + | sed 's|/shard/||' | sort)" \
    "$(cd "$work/head/shard-0000$i-of-00004" && find . -type f -exec sha256sum {} + | sed 's|\./||' | sort)"
  # Only the host's files that the engine itself mounts.
  check_equal "$agent has one mount" "$(inspect "$agent" '{{range .Mounts}}{{.Destination}} {{.RW}};{{end}}')" \
    "/shard false;"
done
for service in "${services[@]}"; do
  check_equal "$service is not root" "$(in_container "$service" id -u)" 10001
  # shellcheck disable=SC2016  # the container's shell expands it
  check_equal "$service has a read-only root file system, even for root" \
    "$(docker exec --user 0 "$(container "$service")" sh -c \
      'for folder in / /tmp /home/* /usr/local/bin; do
         touch $folder/x 2>/dev/null && echo "could write to $folder"; done; echo tried')" tried
done
check_equal "agents are limited in memory" "$(inspect agent-0 '{{.HostConfig.Memory}}')" "$((2 << 30))"
# shellcheck disable=SC2016  # a Go template
check_equal "agents publish no port" \
  "$(inspect agent-0 '{{range $port, $to := .NetworkSettings.Ports}}{{range $to}}{{.HostPort}}{{end}}{{end}}')" ""

echo "== picture"
check "render through the cluster" render_through_server cluster.png
check "the picture is that of the embedded run" cmp "$work/cluster.png" "$work/embedded.png"
check_equal "all four agents drew" \
  "$(tr -d ' \n' <"$work/stats.json" | grep -o '"busy_ms":' | wc -l)" 4

echo "== loss of an agent"
docker kill "$(container agent-2)" >/dev/null
if error="$(render_through_server lost.png 2>&1)"; then
  fail "a frame without agent-2 is an error" "$error"
elif [[ "$error" =~ UNAVAILABLE|FAILED_PRECONDITION ]]; then
  pass "a frame without agent-2 is an error: $error"
else
  fail "a frame without agent-2 is UNAVAILABLE or FAILED_PRECONDITION" "$error"
fi
check "no picture is written then" test ! -e "$work/lost.png"
docker start "$(container agent-2)" >/dev/null
check "agent-2 is found again" eventually 60 is_complete
check "the next frame succeeds" render_through_server again.png
check "and is the same picture" cmp "$work/again.png" "$work/embedded.png"

echo "== OpenGL in the containers (a GPU's or Mesa's software EGL)"
check "embedded render with EGL" \
  isoscope render /data/head --renderer egl --isovalue "$isovalue" --output /data/embedded-egl.png
export ISOSCOPE_RENDERER=egl
check "compose up with ISOSCOPE_RENDERER=egl" run_compose up --detach --no-build
check "all shards are found" eventually 60 is_complete
check_equal "all agents draw with EGL" \
  "$(isoscope info --server "$server" --json | grep -c '"renderer": *"egl')" 4
check "render through the cluster with EGL" render_through_server cluster-egl.png
check "the picture is that of the embedded run" cmp "$work/cluster-egl.png" "$work/embedded-egl.png"

echo "== end"
start="$SECONDS"
check "compose stop" run_compose stop
check "within the drain time ($((SECONDS - start)) s)" test $((SECONDS - start)) -lt 30
for service in "${services[@]}" gateway; do
  check_equal "$service ended with exit code 0" "$(inspect "$service" '{{.State.ExitCode}}')" 0
done

if [ -e scripts/make_certificates.sh ] && [[ "$(isoscope render --help)" == *--tls-ca* ]]; then
  echo "== TLS"
  bash scripts/make_certificates.sh "$work/certificates" --agent agents --coordinator coordinator \
    --gateway gateway >/dev/null
  export ISOSCOPE_CERTIFICATES="$work/certificates" ISOSCOPE_RENDERER=cpu
  ISOSCOPE_USER="$(id -u):$(id -g)"
  export ISOSCOPE_USER
  files+=(--file deploy/compose.tls.yaml)
  with_token=(--server "$server" --tls-ca /data/certificates/ca.pem --token-file /data/certificates/token)
  tls_is_complete() {
    isoscope info "${with_token[@]}" --json | tr -d ' \n' | grep '"missing_shards":\[\]' >/dev/null
  }
  fails() { ! "$@"; }
  check "compose up with compose.tls.yaml" run_compose up --detach --no-build
  check "all shards are found" eventually 60 tls_is_complete
  check "all health checks pass" eventually 60 are_healthy
  check "render with TLS and a token" \
    isoscope render "${with_token[@]}" --isovalue "$isovalue" --output /data/tls.png
  check "the picture is that of the embedded run" cmp "$work/tls.png" "$work/embedded.png"
  check "no picture without a token" fails isoscope render --server "$server" \
    --tls-ca /data/certificates/ca.pem --isovalue "$isovalue" --output /data/no.png
  check "no picture in plaintext" fails isoscope render --server "$server" --isovalue "$isovalue" \
    --output /data/no.png
fi

echo "== demo"
run_demo() {
  "${compose[@]}" --project-name "$project-demo" --file deploy/demo.yaml "$@"
}
run_compose down --volumes >/dev/null 2>&1 || true
check "the demo starts with nothing prepared" run_demo up --detach --build
check "its shards are found" eventually 120 is_complete
check "its page answers" eventually 60 curl -fsS "http://127.0.0.1:$((port + 1))/healthz"
check "its gateway draws" \
  curl -fsS -o "$work/demo.png" "http://127.0.0.1:$((port + 1))/v1/datasets/head/render?isovalue=60"
run_demo down --volumes >/dev/null 2>&1 || true

if [ "$failed" -gt 0 ]; then
  echo "container_test.sh: FAILED: $failed of $((passed + failed)) checks"
  exit 1
fi
echo "container_test.sh: passed: $passed checks in $SECONDS s"
