#!/usr/bin/env bash
# Prints the version of this tree, which all packages, images and programs bear.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/version.sh

  0.1.0                       the tag v0.1.0
  0.1.0+git12.gabcdef0        12 commits after that tag; with no tag at all, after the beginning, with CMake's version
  0.1.0+git12.gabcdef0.dirty  and something is changed that is not committed
  0.1.0                       no Git here, as in a tarball: CMake's version

All of them are versions to Debian and to Python (PEP 440), and 0.1.0 < 0.1.0+git12.gabcdef0 < 0.1.1. So the first tag
must be above CMake's version, which commits before it bear. Tags of other forms, such as v0.2.0-rc1, do not count.

ISOSCOPE_VERSION  the version to print instead
USAGE
}

case "${1:-}" in
  '') ;;
  -h | --help)
    usage
    exit 0
    ;;
  *)
    echo "version.sh: unknown argument '$1'; see --help" >&2
    exit 2
    ;;
esac

cd "$(dirname "${BASH_SOURCE[0]}")/.."

of_cmake() {
  sed -n 's/^  VERSION \([0-9.]*\)$/\1/p' CMakeLists.txt
}

of_git() {
  local described count tag
  # A build may run beside a commit, and takes no lock of the index.
  export GIT_OPTIONAL_LOCKS=0
  # 0.1.0-12-gabcdef0, maybe with -dirty.
  if described="$(git describe --tags --long --dirty --abbrev=7 --match 'v[0-9]*' --exclude 'v*[!0-9.]*' \
    2>/dev/null)"; then
    described="${described#v}"
  else
    # A repository without a commit has no version of its own.
    count="$(git rev-list --count HEAD 2>/dev/null)" || return
    described="$(of_cmake)-$count-g$(git describe --always --dirty --abbrev=7 --exclude '*')"
  fi
  local dirty=""
  case "$described" in
    *-dirty)
      dirty=dirty
      described="${described%-dirty}"
      ;;
  esac
  local hash="${described##*-}"
  described="${described%-*}"
  count="${described##*-}"
  tag="${described%-*}"
  if [ "$count" -gt 0 ]; then
    echo "$tag+git$count.$hash${dirty:+.$dirty}"
  else
    echo "$tag${dirty:++$dirty}"
  fi
}

version="${ISOSCOPE_VERSION:-}"
# A tarball may lie in another project's repository.
if [ -z "$version" ] && [ -e .git ] && command -v git >/dev/null; then
  version="$(of_git)" || version=""
fi
version="${version:-$(of_cmake)}"
# It becomes part of file names, C++ and control files.
if ! [[ "$version" =~ ^[0-9]+(\.[0-9]+)+(\+[a-z0-9]+(\.[a-z0-9]+)*)?$ ]]; then
  echo "version.sh: '$version' is no version such as 0.1.0 or 0.1.0+git12.gabcdef0" >&2
  exit 1
fi
echo "$version"
