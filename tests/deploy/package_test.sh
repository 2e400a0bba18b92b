#!/usr/bin/env bash
# Makes the Debian packages of a build, and installs, tries, upgrades, removes and purges them in an empty Debian that
# is thrown away: programs, units as systemd would start them, the C++ example against isoscope-dev, the Python client.
#
#   tests/deploy/package_test.sh BUILD
#
# Exits with 77, and says why, where that can't be done. Needs root, mmdebstrap, lintian and a mirror of Debian.
# shellcheck disable=SC2016,SC2317  # an inner shell expands; `check` calls
set -euo pipefail

isovalue=127.5
failed="${failed:-0}"
checks="${checks:-0}"

# check TEXT COMMAND...
check() {
  local text="$1" output
  shift
  checks=$((checks + 1))
  if output="$("$@" 2>&1)"; then
    echo "pass  $text"
  else
    failed=$((failed + 1))
    echo "FAIL  $text: $(tail -c 2000 <<<"$output")"
  fi
}

fails() { ! "$@"; }

equal() {
  [ "$1" = "$2" ] || {
    echo "got '$1', expected '$2'"
    return 1
  }
}

# Inside: mounts and processes of this part end with it.
inside() {
  local root="$1" version="$2" old_packages="$3" new_packages="$4" program="$5"
  mount -t proc proc "$root/proc"
  mount --rbind /dev "$root/dev"
  mount -t tmpfs tmpfs "$root/run"
  in_root() {
    chroot "$root" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root \
      LANG=C.UTF-8 DEBIAN_FRONTEND=noninteractive ${http_proxy:+http_proxy="$http_proxy"} "$@"
  }
  install_in_root() { in_root apt-get install -y --no-install-recommends "$@"; }
  version_in_root() { in_root dpkg-query --show --showformat='${Version}' "$1"; }
  # Records the maintainer scripts' calls of systemd. apt gives them its own PATH.
  local asked="$root/asked" systemctl="$root/usr/bin/systemctl"
  printf '#!/bin/sh\necho "$*" >>/asked\n' >"$systemctl"
  chmod 755 "$systemctl"
  has_asked() { grep -qxF -- "$1" "$asked"; }
  install -d "$root/packages"
  mount --bind "$(dirname "$old_packages")" "$root/packages"
  old_packages="/packages/$(basename "$old_packages")" new_packages="/packages/$(basename "$new_packages")"
  old() { echo "$old_packages/$(cd "$root$old_packages" && echo "$1"_*.deb)"; }
  new() { echo "$new_packages/$(cd "$root$new_packages" && echo "$1"_*.deb)"; }

  echo "== isoscope"
  check "the package lists are there" in_root apt-get update
  check "isoscope installs where nothing is" install_in_root "$(old isoscope)"
  local name
  for name in isoscope isoscope-agent isoscope-bench isoscope-coordinator isoscope-gateway; do
    check "$name has the version of its package" equal "$(in_root "$name" --version)" "$name $version"
    check "$name is stripped" equal "$(nm "$root/usr/bin/$name" 2>&1 | sed 's/.*: //')" "no symbols"
    check "$name has a man page and completions" test -f "$root/usr/share/man/man1/$name.1.gz" \
      -a -f "$root/usr/share/bash-completion/completions/$name"
  done
  modules_are_whole() {
    local said
    said="$(in_root sh -c 'ldd /usr/lib/isoscope/*.so')" && ! grep -F 'not found' <<<"$said"
  }
  check "the programs' modules find their libraries" modules_are_whole
  check "the units have a user" equal "$(in_root getent passwd isoscope | cut -d: -f6,7)" \
    /var/lib/isoscope:/usr/sbin/nologin
  check "which alone reads keys" equal "$(in_root stat -c '%U %G %a' /etc/isoscope/tls)" "root isoscope 750"
  no_unit_is_enabled() { [ -z "$(find "$root/etc/systemd" -name 'isoscope*' 2>/dev/null)" ]; }
  check "no unit is enabled" no_unit_is_enabled
  check "without systemd nobody asks it anything" fails test -e "$asked"
  in_root install -d -o nobody /tmp/work
  as_nobody() {
    in_root setpriv --reuid nobody --regid nogroup --clear-groups env -C /tmp/work HOME=/tmp/work "$@"
  }
  check "a volume is made" as_nobody isoscope generate shells --dims 64,64,64 --type uint8 --output s.nrrd
  check "and cut" as_nobody isoscope partition s.nrrd --output s --shards 2
  check "and drawn" as_nobody isoscope render s --renderer cpu --isovalue "$isovalue" --output local.png
  local work="$root/tmp/work"
  "$program" render "$work/s" --renderer cpu --isovalue "$isovalue" --output "$work/expected.png" >/dev/null
  check "with the bytes of the build's program" cmp "$work/local.png" "$work/expected.png"

  echo "== python3-isoscope and isoscope-dev"
  check "python3-isoscope installs" install_in_root "$(old python3-isoscope)"
  check "Python imports it" as_nobody python3 -c 'import isoscope, isoscope.aio'
  local said
  said="$(as_nobody python3 -c 'import isoscope; print(isoscope.__version__)')"
  check "in its version" equal "$said" "${version%-*}"
  check "isoscope-dev installs, with a compiler and CMake" install_in_root "$(old isoscope-dev)" g++ cmake make
  check "the example compiles against it" as_nobody bash -c '
    cmake -S /usr/share/doc/isoscope-dev/examples -B example && cmake --build example'

  echo "== units"
  in_root cp -R /tmp/work/s /var/lib/isoscope/
  in_root sh -c 'install -m 640 -g isoscope /usr/share/isoscope/env/*.env /etc/isoscope/'
  # One machine, plaintext on its loopback address, in a network of its own.
  sed -i -E '/^ISOSCOPE_(TLS|TOKENS|USER_TOKENS)/d' "$root"/etc/isoscope/*.env
  printf 'ISOSCOPE_SHARD=/var/lib/isoscope/s\nISOSCOPE_LISTEN=127.0.0.1:50052\n' >"$root/etc/isoscope/agent-0.env"
  sed -i 's/^ISOSCOPE_AGENT=.*/ISOSCOPE_AGENT=127.0.0.1:50052/
    s/^ISOSCOPE_LISTEN=.*/ISOSCOPE_LISTEN=127.0.0.1:50051/' "$root/etc/isoscope/coordinator.env"
  check "the units' programs start as the units say, and draw" \
    unshare --net --pid --fork --kill-child "${BASH_SOURCE[0]}" --units "$root"
  check "the picture has the bytes of the local one" cmp "$work/units.png" "$work/expected.png"
  check "and Python's those of the service" cmp "$work/python.png" "$work/plain.png"

  echo "== upgrade"
  install -d "$root/run/systemd/system" "$root/etc/systemd/system/multi-user.target.wants"
  ln -s /usr/lib/systemd/system/isoscope-coordinator.service "$root/etc/systemd/system/multi-user.target.wants/"
  for name in isoscope isoscope-dev python3-isoscope; do
    check "$name is upgraded" install_in_root "$(new "$name")"
    check "to the new version" equal "$(version_in_root "$name")" "$version-2"
  done
  check "units that run are restarted" has_asked \
    "try-restart isoscope-agent@*.service isoscope-coordinator.service isoscope-gateway.service"
  check "and systemd reads them anew" has_asked daemon-reload
  check "no other is started or enabled" fails grep -qE '(^| )(start|restart|enable)( |$)' "$asked"
  check "settings are as they were" grep -q 127.0.0.1:50052 "$root/etc/isoscope/agent-0.env"
  check "the program works" as_nobody isoscope render s --renderer cpu --isovalue "$isovalue" --output again.png
  check "and draws the same" cmp "$work/again.png" "$work/expected.png"

  echo "== remove and purge"
  check "all are removed" in_root apt-get remove -y isoscope isoscope-dev python3-isoscope
  check "units are stopped before" has_asked \
    "stop isoscope-gateway.service isoscope-coordinator.service isoscope-agent@*.service"
  check "no program is left" fails test -e "$root/usr/bin/isoscope" -o -e "$root/usr/lib/isoscope"
  check "nor a module" fails test -e "$root/usr/lib/python3/dist-packages/isoscope"
  check "settings are left" test -f "$root/etc/isoscope/agent-0.env"
  check "isoscope is purged" in_root apt-get purge -y isoscope
  check "no settings are left" fails test -e "$root/etc/isoscope"
  check "shards are" test -d "$root/var/lib/isoscope/s"
  check "the user is gone" fails in_root getent passwd isoscope
  check "and the group" fails in_root getent group isoscope
  rm -rf "$root/var/lib/isoscope" "$work"

  echo "== with systemd"
  rm "$systemctl"
  rmdir "$root/run/systemd/system"
  check "systemd installs" install_in_root systemd
  check "isoscope installs beside it" install_in_root "$(old isoscope)"
  check "the units have a user" in_root getent passwd isoscope
  check "which alone reads keys" equal "$(in_root stat -c '%U %G %a' /etc/isoscope/tls)" "root isoscope 750"
  check "no unit is enabled" no_unit_is_enabled
  verify() {
    local output
    output="$(in_root systemd-analyze verify isoscope-agent@0.service isoscope-coordinator.service \
      isoscope-gateway.service 2>&1)" && equal "$output" ""
  }
  check "systemd-analyze finds nothing in the units" verify
  check "isoscope is purged at once" in_root apt-get purge -y isoscope
  check "and nothing of it is left" equal \
    "$(find "$root" -xdev -iname '*isoscope*' -not -path "$root/packages/*" -not -path "$root/packages")" ""
  if [ "$failed" -gt 0 ]; then
    echo "package_test.sh: FAILED: $failed of $checks checks"
    exit 1
  fi
  echo "package_test.sh: passed: $checks checks in $SECONDS s"
}

# Agent and coordinator by their units' ExecStart and user; systemd does not run in this root.
units() {
  local root="$1" user environment
  ip link set lo up
  start_unit() {
    local file="$root/usr/lib/systemd/system/$1" name="$2"
    user="$(sed -n 's/^User=//p' "$file")"
    environment="$(sed -n "s/^EnvironmentFile=//p" "$file" | sed "s/%i/$name/")"
    chroot "$root" setpriv --reuid "$user" --regid "$user" --clear-groups --no-new-privs --bounding-set=-all \
      env -i bash -c "set -a; for file in $(echo "$environment" | tr '\n' ' '); do . \$file; done
        $(sed -n 's/^ExecStart=//p' "$file") &
        timeout 60 $(sed -n "s/^ExecStartPost=//p" "$file"); wait" &
  }
  start_unit isoscope-agent@.service 0
  start_unit isoscope-coordinator.service ""
  local in_work=(chroot "$root" env -i -C /tmp/work HOME=/tmp/work PATH=/usr/bin:/bin)
  local render=("${in_work[@]}" isoscope render --server 127.0.0.1:50051 --isovalue "$isovalue")
  # As soon as the coordinator has seen the agent; it looks every two seconds.
  for ((tries = 0; tries < 100; tries++)); do
    if "${render[@]}" --output units.png; then
      break
    fi
    sleep 0.3
  done
  "${render[@]}" --no-metadata --output plain.png
  "${in_work[@]}" python3 -c "
import isoscope
isoscope.connect('127.0.0.1:50051')['s'].render(isovalue=$isovalue).save('python.png')"
  "${in_work[@]}" example/isoscope-example 127.0.0.1:50051 "$isovalue" 60 "" ""
  cmp -n 8 "$root/tmp/work/head.png" "$root/tmp/work/units.png"
}

case "${1:-}" in
  --inside)
    inside "${@:2}"
    exit
    ;;
  --units)
    units "$2"
    exit
    ;;
  '' | -*)
    echo "Usage: package_test.sh BUILD" >&2
    exit 2
    ;;
esac

build="$(realpath "$1")"
script="$(realpath "${BASH_SOURCE[0]}")"
source="$(realpath "$(dirname "$script")/../..")"
cd "$source"

skip() {
  local code=0
  python3 tests/support/skips.py packages "$*" || code=$?
  exit "$code"
}
[ "$(id -u)" -eq 0 ] || skip "only root can install packages in another root"
for tool in lintian dpkg-shlibdeps ip; do
  command -v "$tool" >/dev/null || skip "no $tool (Debian: lintian dpkg-dev iproute2)"
done
/usr/bin/python3 -c 'import setuptools, wheel, pip' 2>/dev/null ||
  skip "no pip for Debian's Python (python3-pip python3-setuptools python3-wheel)"
unshare --mount --pid --net --fork true 2>/dev/null || skip "no namespaces can be made here"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
trap 'exit 130' INT
trap 'exit 143' TERM
echo "== packages"
scripts/package.sh --build "$build" --output "$work/packages/old"
scripts/package.sh --build "$build" --output "$work/packages/new" --revision 2 >/dev/null
check "lintian finds no error" lintian --allow-root --fail-on error "$work"/packages/old/*.deb
if ! tests/deploy/empty_root.sh "$work/root" >"$work/log" 2>&1; then
  skip "no root can be made: $(tail -n 1 "$work/log")"
fi
version="$("$build/bin/isoscope" --version)"
export failed checks
unshare --mount --pid --fork --kill-child "$script" --inside "$work/root" "${version#isoscope }" "$work/packages/old" \
  "$work/packages/new" "$build/bin/isoscope"
