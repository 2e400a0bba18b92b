#!/usr/bin/env bash
# Makes the Debian packages isoscope, isoscope-dev and python3-isoscope, all of the version of scripts/version.sh.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: scripts/package.sh [--output FOLDER] [--revision N] [--build FOLDER]

  --output FOLDER  where the packages go (default: build/packages)
  --revision N     Debian's revision of this version (default: 1)
  --build FOLDER   take the programs of this build as they are (default: build with scripts/build.sh)
  -h, --help       this text

ISOSCOPE_VERSION  the version to build instead of that of scripts/version.sh
DEBFULLNAME, DEBEMAIL  whom the packages name as their maintainer
SOURCE_DATE_EPOCH      their date (default: that of the commit)

Install them with `apt install ./build/packages/*.deb`.
USAGE
}

output=build/packages
revision=1
build=""
while [ "$#" -gt 0 ]; do
  case "$1" in
    -h | --help)
      usage
      exit 0
      ;;
    --output | --revision | --build)
      if [ -z "${2:-}" ]; then
        echo "package.sh: $1 needs a value" >&2
        exit 2
      fi
      declare "${1#--}=$2"
      shift
      ;;
    *)
      echo "package.sh: unknown argument '$1'; see --help" >&2
      exit 2
      ;;
  esac
  shift
done
if ! [[ "$revision" =~ ^[0-9][0-9a-z.~]*$ ]]; then
  echo "package.sh: '$revision' is no revision such as 1" >&2
  exit 2
fi
output="$(realpath -m "$output")"
[ -z "$build" ] || build="$(realpath "$build")"

cd "$(dirname "${BASH_SOURCE[0]}")/.."
export HOME="${HOME:-/tmp}"
# shellcheck source=/dev/null
. scripts/packages.sh
install_packages "${ISOSCOPE_PACKAGE_PACKAGES[@]}"
if [ -z "$build" ]; then
  ISOSCOPE_VERSION="$(bash scripts/version.sh)"
  export ISOSCOPE_VERSION
  build="$PWD/build/release"
  bash scripts/build.sh
else
  # The version that the programs report.
  ISOSCOPE_VERSION="$("$build/bin/isoscope" --version)"
  export ISOSCOPE_VERSION="${ISOSCOPE_VERSION#isoscope }"
fi
export ISOSCOPE_PACKAGE_REVISION="$revision"
export ISOSCOPE_PACKAGE_MAINTAINER="${DEBFULLNAME:-Isoscope maintainers} <${DEBEMAIL:-isoscope@example.org}>"
SOURCE_DATE_EPOCH="${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s -r CHANGELOG.md)}"
export SOURCE_DATE_EPOCH
# The modes of files must not depend on the packager's umask.
umask 022

# Further files that CMake installs: cmake/IsoscopePackages.cmake.
stage="$build/package"
rm -rf "$stage"/{python,wheel,isoscope,isoscope-dev,python3-isoscope} "$stage/cpack"
for package in isoscope isoscope-dev python3-isoscope; do
  mkdir -p "$stage/$package"
  {
    echo "$package ($ISOSCOPE_VERSION-$revision) unstable; urgency=medium"
    echo
    echo "  * Version $ISOSCOPE_VERSION; changelog.gz has its changes."
    echo
    echo " -- $ISOSCOPE_PACKAGE_MAINTAINER  $(date --utc --rfc-email --date "@$SOURCE_DATE_EPOCH")"
  } | gzip -9n >"$stage/$package/changelog.Debian.gz"
done
gzip -9nc CHANGELOG.md >"$stage/changelog.gz"
# Debian's Python, and a copy, because setuptools writes beside its sources.
mkdir -p "$stage/wheel/clients"
cp -R clients/python clients/web "$stage/wheel/clients/"
/usr/bin/python3 -m pip wheel --quiet --no-deps --no-build-isolation --no-index --wheel-dir "$stage/wheel" \
  "$stage/wheel/clients/python"
/usr/bin/python3 -m zipfile --extract "$stage"/wheel/isoscope-*.whl "$stage/python"
# This file is for pip, not for Debian.
rm -f "$stage"/python/isoscope-*.dist-info/RECORD

mkdir -p "$output"
rm -f "$output"/{isoscope,isoscope-dev,python3-isoscope}_*.deb
cpack --config "$build/CPackConfig.cmake" -B "$stage/cpack" >"$stage/cpack.log" 2>&1 || {
  cat "$stage/cpack.log" >&2
  exit 1
}
mv "$stage"/cpack/*.deb "$output/"
ls -l "$output"/*.deb
