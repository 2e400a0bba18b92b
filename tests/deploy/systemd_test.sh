#!/usr/bin/env bash
# Runs the units of deploy/systemd for real: a systemd of its own, as process 1 of namespaces of its own, on a copy of
# this machine's root that is thrown away (overlayfs). It installs them as deploy/README.md says, starts four agents, a
# coordinator and the gateway under all their restrictions, and checks that the picture has the bytes of the
# local one, that a killed agent comes back, and that all end by themselves.
#
#   tests/deploy/systemd_test.sh PROGRAMS [VOLUME [ISOVALUE]]
#
# Exits with 77, and says why, where that can't be done. Needs root and systemd 250.
# shellcheck disable=SC2016,SC2317  # an inner shell expands; `check` calls
set -euo pipefail

# Inside: a unit of the inner systemd runs this part; its output is the test's.
inside() {
  local failed=0 checks=0 isovalue="$1"
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
  # As soon as the coordinator has seen all agents; it looks every two seconds.
  render() {
    local tries
    for ((tries = 0; tries < 60; tries++)); do
      if isoscope render --server 127.0.0.1:50051 --isovalue "$isovalue" --output "/test/$1" >/dev/null 2>/test/error; then
        cmp "/test/$1" /test/local.png
        return
      fi
      sleep 0.5
    done
    cat /test/error
    return 1
  }
  is_active() { [ "$(systemctl is-active "$1")" = active ]; }
  local units=(isoscope-agent@{0,1,2,3} isoscope-coordinator isoscope-gateway) unit
  check "all units start" systemctl start "${units[@]}"
  for unit in "${units[@]}"; do
    check "$unit is active" is_active "$unit"
  done
  check "the picture has the bytes of the local one" render a.png
  if [ "$failed" -gt 0 ]; then
    systemctl status --no-pager --lines 5 'isoscope-*' || true
    echo "systemd_test.sh: FAILED: $failed of $checks checks"
    echo "$failed" >/test/code
    return
  fi
  local pid
  pid="$(systemctl show --property MainPID --value isoscope-agent@2)"
  check "an agent is not root" [ "$(stat -c %U "/proc/$pid")" = isoscope ]
  check "and has no capability" grep -q '^CapEff:.*0000000000000000$' "/proc/$pid/status"
  check "and may call few of the kernel's functions" grep -q '^Seccomp:.*2$' "/proc/$pid/status"
  kill -KILL "$pid"
  check "a killed agent comes back" bash -c 'for i in $(seq 200); do
    [ "$(systemctl show --property NRestarts --value isoscope-agent@2)" = 1 ] &&
      [ "$(systemctl is-active isoscope-agent@2)" = active ] && exit 0; sleep 0.2; done; exit 1'
  check "and the picture is the same" render b.png
  check "all units stop" systemctl stop "${units[@]}"
  for unit in "${units[@]}"; do
    check "$unit ended by itself" [ "$(systemctl show --property Result --value "$unit")" = success ]
  done
  if [ "$failed" -gt 0 ]; then
    systemctl status --no-pager --lines 5 'isoscope-*' || true
    echo "systemd_test.sh: FAILED: $failed of $checks checks"
  else
    echo "systemd_test.sh: passed: $checks checks"
  fi
  echo "$failed" >/test/code
}
if [ "${1:-}" = --inside ]; then
  inside "$2"
  exit 0
fi

[ "$#" -ge 1 ] || {
  echo "Usage: systemd_test.sh PROGRAMS [VOLUME [ISOVALUE]]" >&2
  exit 2
}
bin="$(realpath "$1")"
volume="${2:-/usr/share/mricron/templates/ch2.nii.gz}"
isovalue="${3:-60}"
script="$(realpath "${BASH_SOURCE[0]}")"
root="$(realpath "$(dirname "$script")/../..")"

skip() {
  local code=0
  python3 "$root/tests/support/skips.py" systemd "$*" || code=$?
  exit "$code"
}
[ "$(id -u)" -eq 0 ] || skip "only root can start another systemd"
[ -x /lib/systemd/systemd ] || skip "no systemd"
[ -r "$volume" ] || skip "no volume '$volume' (Debian: mricron-data)"
[[ "$("$bin/isoscope-agent" --help)" == *--probe* ]] || skip "these programs have no --probe"
unshare --mount --pid --fork --net --ipc --uts true 2>/dev/null || skip "no namespaces can be made here"

# A control group of its own, so that the inner systemd sees none of this machine's.
if [ -e /sys/fs/cgroup/cgroup.controllers ]; then
  group="/sys/fs/cgroup$(sed -n 's/^0:://p' /proc/self/cgroup)"
else
  group="/sys/fs/cgroup/systemd$(sed -n 's/^[0-9]*:name=systemd://p' /proc/self/cgroup)"
fi
group="${group%/}/isoscope-test-$$"
mkdir "$group" 2>/dev/null || skip "no control group can be made: $group"

work="$(mktemp -d)"
init=""
finish() {
  local code=$?
  trap - EXIT
  # The end of its process 1 ends the namespaces, with all processes and mounts in them.
  [ -z "$init" ] || { kill -KILL "$init" && wait "$init"; } 2>/dev/null || true
  local tries
  for ((tries = 0; tries < 50; tries++)); do
    find "$group" -depth -type d -exec rmdir {} + 2>/dev/null || true
    [ -d "$group" ] || break
    sleep 0.1
  done
  rm -rf "$work"
  exit "$code"
}
trap finish EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

mkdir "$work/test" "$work/programs"
"$bin/isoscope" partition "$volume" --output "$work/test/head" --shards 4 >/dev/null
"$bin/isoscope" render "$work/test/head" --renderer cpu --isovalue "$isovalue" --output "$work/test/local.png" >/dev/null
cp "$bin"/isoscope* "$work/programs/"

# start WORK ROOT SCRIPT ISOVALUE: in the new namespaces.
start='
set -euo pipefail
work="$1" source="$2" script="$3" isovalue="$4"
mount --make-rprivate /
mkdir "$work/layer" && mount -t tmpfs tmpfs "$work/layer"
mkdir "$work/layer/upper" "$work/layer/work" "$work/layer/root"
new="$work/layer/root"
mount -t overlay overlay -o "lowerdir=/,upperdir=$work/layer/upper,workdir=$work/layer/work" "$new"
mount -t proc proc "$new/proc"
mount -t sysfs sysfs "$new/sys"
if [ -e /sys/fs/cgroup/cgroup.controllers ]; then
  mount -t cgroup2 cgroup2 "$new/sys/fs/cgroup"
else
  mount -t tmpfs tmpfs "$new/sys/fs/cgroup"
  mkdir "$new/sys/fs/cgroup/systemd"
  mount -t cgroup -o none,name=systemd cgroup "$new/sys/fs/cgroup/systemd"
fi
mount --rbind /dev "$new/dev"
mount -t tmpfs tmpfs "$new/run"
mount -t tmpfs tmpfs "$new/tmp"
mkdir -p "$new/test" "$new/etc/systemd/system" "$new/etc/sysusers.d" "$new/etc/tmpfiles.d" "$new/usr/local/bin"
mount --bind "$work/test" "$new/test"
# As deploy/README.md says.
cp "$work"/programs/* "$new/usr/local/bin/"
cp "$source/deploy/systemd/isoscope.sysusers" "$new/etc/sysusers.d/isoscope.conf"
cp "$source/deploy/systemd/isoscope.tmpfiles" "$new/etc/tmpfiles.d/isoscope.conf"
cp "$source"/deploy/systemd/*.service "$new/etc/systemd/system/"
chroot "$new" systemd-sysusers isoscope.conf 2>/dev/null
chroot "$new" systemd-tmpfiles --create isoscope.conf
install -m 640 "$source"/deploy/systemd/env/*.env "$new/etc/isoscope/"
# One machine, plaintext on its loopback address; the keys are for others.
sed -i -E "/^ISOSCOPE_(TLS|TOKENS|USER_TOKENS)/d" "$new"/etc/isoscope/*.env
for shard in 0 1 2 3; do
  printf "ISOSCOPE_SHARD=/test/head/shard-0000%d-of-00004\nISOSCOPE_LISTEN=127.0.0.1:5006%d\n" "$shard" "$shard" \
    >"$new/etc/isoscope/agent-$shard.env"
done
sed -i "s/^ISOSCOPE_AGENT=.*/ISOSCOPE_AGENT=\"$(echo 127.0.0.1:5006{0,1,2,3})\"/
  s/^ISOSCOPE_LISTEN=.*/ISOSCOPE_LISTEN=127.0.0.1:50051/" "$new/etc/isoscope/coordinator.env"
chgrp -R isoscope "$new/etc/isoscope" 2>/dev/null || chroot "$new" chgrp -R isoscope /etc/isoscope
cp "$script" "$new/test.sh"
# Nothing else of this machine is started.
printf "[Unit]\nDefaultDependencies=no\nRequires=isoscope-test.service\nAllowIsolate=yes\n" \
  >"$new/etc/systemd/system/isoscope-test.target"
printf "[Unit]\nDefaultDependencies=no\nWants=dbus.socket systemd-journald.service\nAfter=dbus.socket systemd-journald.service\n[Service]\nType=oneshot\nExecStart=/bin/bash /test.sh --inside %s\nExecStopPost=/bin/systemctl --force exit 0\nStandardOutput=file:/test/output\nStandardError=file:/test/output\n" \
  "$isovalue" >"$new/etc/systemd/system/isoscope-test.service"
# A limit that only a machine can raise, if this one may not.
if ! prlimit --nofile=65536:65536 true 2>/dev/null; then
  for unit in isoscope-agent@ isoscope-coordinator isoscope-gateway; do
    mkdir -p "$new/etc/systemd/system/$unit.service.d"
    printf "[Service]\nLimitNOFILE=\n" >"$new/etc/systemd/system/$unit.service.d/limit.conf"
  done
fi
ip link set lo up
# A root that units can have views of, which a chroot is not.
cd "$new"
mkdir old-root
pivot_root . old-root
umount --lazy /old-root
exec env -i PATH=/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin container=other \
  /lib/systemd/systemd --unit=isoscope-test.target --log-target=console --show-status=no
'
bash -c 'echo $$ >"$0/cgroup.procs" && exec "$@"' "$group" \
  unshare --mount --pid --fork --net --ipc --uts --cgroup --kill-child bash -c "$start" start \
  "$work" "$root" "$script" "$isovalue" >"$work/init.log" 2>&1 &
init=$!
for ((tries = 0; tries < 1200; tries++)); do
  if [ -e "$work/test/code" ] || ! kill -0 "$init" 2>/dev/null; then
    break
  fi
  sleep 0.2
done
if [ ! -e "$work/test/output" ]; then
  skip "systemd does not start here: $(grep -v '^$' "$work/init.log" | tail -n 1)"
fi
cat "$work/test/output"
if [ ! -e "$work/test/code" ]; then
  echo "systemd_test.sh: FAILED: it did not end"
  tail -n 20 "$work/init.log"
  exit 1
fi
[ "$(cat "$work/test/code")" -eq 0 ]
