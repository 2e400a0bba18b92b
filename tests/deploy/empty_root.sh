#!/usr/bin/env bash
# Makes an empty Debian of this machine's release, from the mirrors of its apt, in a new folder. As root.
#
#   tests/deploy/empty_root.sh FOLDER [OPTION-OF-MMDEBSTRAP...]
#
# Exits with 1 where that can't be done: the last line says why.
set -euo pipefail
folder="$1"
shift
command -v mmdebstrap >/dev/null || {
  echo "no mmdebstrap (Debian: mmdebstrap)" >&2
  exit 1
}
# shellcheck source=/dev/null
release="$(. /etc/os-release && echo "${VERSION_CODENAME:-}")"
# Files that name the release itself: those of others have suites of their own, such as PROJECT-bookworm.
mapfile -t mirrors < <(grep -lsE "^(Suites:|deb .*) ${release}[a-z-]*( |\$)" \
  /etc/apt/sources.list /etc/apt/sources.list.d/*.list /etc/apt/sources.list.d/*.sources |
  xargs -r grep -LE "^(Suites:|deb ).*-$release" || true)
[ "${#mirrors[@]}" -gt 0 ] || {
  echo "apt has no mirror of Debian's $release" >&2
  exit 1
}
# As images are made: with /bin in /usr from the start, so without the program that moves it there, and its Perl.
mmdebstrap --variant=minbase --hook-dir=/usr/share/mmdebstrap/hooks/merged-usr --include=usr-is-merged "$@" \
  "$release" "$folder" "${mirrors[@]}" >/dev/null
# Installations in it use the same package servers.
cp /etc/resolv.conf "$folder/etc/resolv.conf"
