#!/usr/bin/env bash
# Runs deploy/swarm/stack.yaml on this machine and checks its promises. The picture equals that of an embedded run, bit
# for bit. Health checks pass, and two agents serve each shard. An update under load leaves every picture right, and a
# lost agent is replaced. Exits with 77 and the reason if no engine can run it. Not part of scripts/test.sh.
#
# It uses a running engine that is a manager of a swarm. Otherwise, as root and with dockerd (Debian: docker.io), it
# starts its own engine, in a temporary folder and in its own namespaces for network and mounts. So this machine stays
# unchanged.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/swarm_test.sh [--own-engine] [--root DIR --programs DIR] [VOLUME [ISOVALUE]]

  --own-engine    start an engine even if one answers
  --root DIR      make the images from this folder, a Debian 12 with the packages of scripts/packages.sh that
  --programs DIR  the programs run with, and these programs; for machines that reach no registry. A folder:
                  debootstrap --variant=minbase --include=PACKAGE,... bookworm DIR
                  (default: images that the engine has, else `docker build`)
  -h, --help      this text

VOLUME defaults to the MRI head of Debian's mricron-data, ISOVALUE to 60.

CERTIFICATES  a folder that scripts/make_certificates.sh made (default: made anew)
BASE_IMAGE    what the images are built on (default: debian:bookworm-slim)
USAGE
}

own_engine=false
root=""
programs=""
positional=()
while [ "$#" -gt 0 ]; do
  case "$1" in
    --own-engine) own_engine=true ;;
    --root | --programs)
      [ "$#" -ge 2 ] || { usage >&2; exit 2; }
      if [ "$1" = --root ]; then root="$2"; else programs="$2"; fi
      shift
      ;;
    -h | --help)
      usage
      exit 0
      ;;
    -*)
      echo "swarm_test.sh: unknown argument '$1'; see --help" >&2
      exit 2
      ;;
    *) positional+=("$1") ;;
  esac
  shift
done
volume="${positional[0]:-/usr/share/mricron/templates/ch2.nii.gz}"
isovalue="${positional[1]:-60}"
cd "$(dirname "${BASH_SOURCE[0]}")/.."

skip() {
  echo "swarm_test.sh: skipped: $*"
  exit 77
}
command -v docker >/dev/null || skip "no docker (Debian: docker.io)"
[ -r "$volume" ] || skip "no volume '$volume' (Debian: mricron-data)"
volume="$(realpath "$volume")"

work="$(mktemp -d)"
chmod 755 "$work"
stack="isoscope_test_$$"
engine=""
labelled=false
finish() {
  local code=$?
  trap - EXIT
  if [ "$code" -ne 0 ] && [ "$code" -ne 77 ]; then
    docker stack ps --no-trunc "$stack" 2>/dev/null | head -n 20 || true
    local service
    for service in coordinator agent-0 gateway; do
      docker service logs --tail 5 "${stack}_$service" 2>/dev/null || true
    done
  fi
  docker stack rm "$stack" >/dev/null 2>&1 || true
  if [ "$labelled" = true ]; then
    local shard
    for shard in 0 1 2 3; do
      docker node update --label-rm "isoscope.shard-$shard" "$node" >/dev/null 2>&1 || true
    done
  fi
  if [ -n "$engine" ]; then
    docker ps --quiet | xargs --no-run-if-empty docker rm --force >/dev/null 2>&1 || true
    kill "$(cat "$work/engine.pid" 2>/dev/null || echo "$engine")" 2>/dev/null || true
    wait "$engine" 2>/dev/null || true
  fi
  # The engine's mounts are gone with its namespace.
  rm -rf "$work" 2>/dev/null || true
  exit "$code"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

failed=0
checks=0
check() {
  local text="$1"
  shift
  checks=$((checks + 1))
  if "$@"; then
    echo "pass  $text"
  else
    failed=$((failed + 1))
    echo "FAIL  $text"
  fi
}

# eventually SECONDS COMMAND...
eventually() {
  local deadline=$((SECONDS + $1))
  shift
  until "$@"; do
    [ "$SECONDS" -lt "$deadline" ] || return 1
    sleep 1
  done
}

engine_answers() { docker info >/dev/null 2>&1; }

start_engine() {
  [ "$(id -u)" -eq 0 ] || skip "no engine answers, and only root can start one"
  for program in dockerd unshare ip; do
    command -v "$program" >/dev/null || skip "no engine answers, and there is no $program (Debian: docker.io iproute2)"
  done
  export DOCKER_HOST="unix://$work/engine.sock"
  # shellcheck disable=SC2016  # the inner shell expands it
  unshare --net --mount bash -c 'ip link set lo up; exec dockerd --data-root "$0/data" --exec-root "$0/exec" \
    --host "unix://$0/engine.sock" --pidfile "$0/engine.pid" --log-level warn' "$work" >"$work/engine.log" 2>&1 &
  engine=$!
  eventually 60 engine_answers || skip "dockerd does not start here: $(tail -n 1 "$work/engine.log")"
  # The address of its bridge, the only one in its network.
  local address
  address="$(nsenter --net --target "$(cat "$work/engine.pid")" ip -4 -oneline address show docker0 |
    sed 's/.* inet \([0-9.]*\).*/\1/')"
  docker swarm init --advertise-addr "$address" --listen-addr "$address" >/dev/null 2>"$work/swarm.log" ||
    skip "no swarm can be made here: $(tail -n 1 "$work/swarm.log")"
}

is_manager() { [ "$(docker info --format '{{.Swarm.ControlAvailable}}' 2>/dev/null)" = true ]; }
if [ "$own_engine" = true ] || ! is_manager; then
  start_engine
fi
node="$(docker node ls --quiet | head -n 1)"

# image_from_root TARGET: the last stage of TARGET in the Dockerfile, on the folder instead of `runtime`.
image_from_root() {
  local program="isoscope-$1"
  [ "$1" = cli ] && program=isoscope
  cp "$programs/$program" "$work/context/"
  {
    echo "FROM isoscope-test-root"
    sed -n "/^FROM .* AS $1\$/,/^\$/p" Dockerfile | grep -E '^(ENV|EXPOSE|USER|ENTRYPOINT|CMD|WORKDIR)'
    echo "COPY $program /usr/local/bin/"
  } >"$work/context/Dockerfile"
  DOCKER_BUILDKIT=0 docker build --quiet --tag "$program" "$work/context"
}

make_images() {
  local target image
  if [ -n "$root" ]; then
    [ -n "$programs" ] || { usage >&2; exit 2; }
    mkdir -p "$work/context"
    grep -q '^isoscope:' "$root/etc/passwd" || chroot "$root" useradd --create-home --uid 10001 isoscope
    tar -C "$root" -c . | docker import - isoscope-test-root
  fi
  for target in coordinator agent gateway cli; do
    image="isoscope-$target"
    [ "$target" = cli ] && image=isoscope
    if [ -n "$root" ]; then
      image_from_root "$target"
    elif ! docker image inspect "$image" >/dev/null 2>&1; then
      docker build --build-arg BASE_IMAGE="${BASE_IMAGE:-debian:bookworm-slim}" --target "$target" --tag "$image" .
    fi
  done
}
echo "== images"
make_images >"$work/build.log" 2>&1 ||
  skip "the images can't be made here: $(grep -v '^$' "$work/build.log" | tail -n 1)"

echo "== dataset and keys"
local_isoscope() {
  docker run --rm --network none --user "$(id -u):$(id -g)" --volume "$work:/data" \
    --volume "$(dirname "$volume"):/source:ro" isoscope "$@"
}
check "partition in the isoscope image" \
  local_isoscope partition "/source/$(basename "$volume")" --output /data/head --shards 4 >/dev/null
local_isoscope render /data/head --renderer cpu --isovalue "$isovalue" --output /data/local.png >/dev/null
if [ -z "${CERTIFICATES:-}" ]; then
  CERTIFICATES="$work/certificates"
  bash scripts/make_certificates.sh "$CERTIFICATES" --agent agents --coordinator coordinator --gateway gateway \
    >"$work/certificates.log" 2>&1 || {
    cat "$work/certificates.log" >&2
    exit 1
  }
fi
export ISOSCOPE_CERTIFICATES="$CERTIFICATES" ISOSCOPE_DATASET="$work/head" ISOSCOPE_REPLICAS=2 ISOSCOPE_RENDERER=cpu
export ISOSCOPE_AGENT_MEMORY=1g ISOSCOPE_KEYS="test_$$" ISOSCOPE_THREADS=1
for shard in 0 1 2 3; do
  docker node update --label-add "isoscope.shard-$shard=true" "$node" >/dev/null
done
labelled=true

# The command line in the network of clients. It reads the authority's certificate if the programs know TLS.
client_options=()
if [[ "$(docker run --rm isoscope render --help)" == *--tls-ca* ]]; then
  client_options=(--tls-ca /certificates/ca.pem --token-file /certificates/token)
fi
through_stack() {
  docker run --rm --network "${stack}_clients" --user "$(id -u):$(id -g)" --volume "$work:/data" \
    --volume "$CERTIFICATES:/certificates:ro" isoscope "$1" --server coordinator:50051 \
    "${client_options[@]}" "${@:2}"
}
# The picture, with the bytes of the local one.
draws() {
  rm -f "$work/stack.png"
  through_stack render --isovalue "$isovalue" --output /data/stack.png >/dev/null 2>"$work/render.log" &&
    cmp "$work/stack.png" "$work/local.png"
}
replicas_of() { docker service ls --filter "name=${stack}_$1" --format '{{.Replicas}}' | cut -d' ' -f1; }
# all_run N: every agent service has N tasks that are healthy (Swarm counts no others).
all_run() {
  local shard
  for shard in 0 1 2 3; do
    [ "$(replicas_of "agent-$shard")" = "$1/$1" ] || return
  done
  [ "$(replicas_of coordinator)" = 1/1 ] && [ "$(replicas_of gateway)" = 1/1 ]
}
agents_seen() { through_stack info --json 2>/dev/null | grep -c '"address"'; }

echo "== stack"
docker stack deploy --compose-file deploy/swarm/stack.yaml "$stack" >"$work/deploy.log" 2>&1 || {
  cat "$work/deploy.log" >&2
  exit 1
}
check "all tasks run and are healthy" eventually 180 all_run 2
check "the first picture is that of the embedded run" eventually 30 draws
check_eight() { [ "$(agents_seen)" -ge 8 ]; }
check "the coordinator sees eight agents behind one name" eventually 30 check_eight
task="$(docker ps --quiet --filter "label=com.docker.swarm.service.name=${stack}_agent-0" | head -n 1)"
inspect() { docker inspect --format "$1" "$task"; }
check "an agent has no capability" test "$(inspect '{{.HostConfig.CapDrop}}')" = "[ALL]"
check "and a read-only root" test "$(inspect '{{.HostConfig.ReadonlyRootfs}}')" = true
check "and sees its own shard alone" test "$(docker exec "$task" ls /shard | sort | tr '\n' ' ')" = \
  "$(find "$work/head/shard-00000-of-00004" -type f -printf '%f\n' | sort | tr '\n' ' ')"
check "and its key is its own to read" test "$(docker exec "$task" stat -c '%u %a' /run/secrets/tls.key)" = "10001 400"

echo "== an update of the agents of shard 0, under load"
frames=0
errors=0
wrong=0
docker service update --detach=false --quiet --force "${stack}_agent-0" >"$work/update.log" 2>&1 &
update=$!
while kill -0 "$update" 2>/dev/null; do
  frames=$((frames + 1))
  if ! draws; then
    if [ -e "$work/stack.png" ]; then wrong=$((wrong + 1)); else errors=$((errors + 1)); fi
  fi
done
check "the update ends well" wait "$update"
echo "      $frames frames, $errors ended with an error, $wrong were wrong"
check "no picture was wrong" test "$wrong" -eq 0
check "at most one frame in twenty ended with an error" test $((errors * 20)) -le $((frames + 19))
check "all tasks run" eventually 60 all_run 2

echo "== loss of an agent"
docker kill "$(docker ps --quiet --filter "label=com.docker.swarm.service.name=${stack}_agent-2" | head -n 1)" >/dev/null
check "the other agent of its shard draws" eventually 30 draws
check "the lost one is replaced" eventually 90 all_run 2

echo "== end"
docker stack rm "$stack" >/dev/null
none_left() { [ -z "$(docker ps --quiet --filter "label=com.docker.stack.namespace=$stack")" ]; }
check "all tasks end" eventually 60 none_left

if [ "$failed" -gt 0 ]; then
  echo "swarm_test.sh: FAILED: $failed of $checks checks"
  exit 1
fi
echo "swarm_test.sh: passed: $checks checks in $SECONDS s"
