#!/usr/bin/env bash
# Makes the pictures of docs/gallery.md again, with the commands on that page.
set -euo pipefail

usage() {
  cat <<'USAGE'
Usage: tools/render_gallery.sh VOLUMES [PROGRAM]

  VOLUMES  folder with the volumes that docs/gallery.md names
  PROGRAM  isoscope (default: build/release/bin/isoscope)

The pictures go to docs/gallery/. Those of volumes of 3.6 and 16.8 GB are made only with
ISOSCOPE_GALLERY_LARGE=1; they need 60 GB in the folder for temporary files.
USAGE
}

case "${1:-}" in
  -h | --help)
    usage
    exit 0
    ;;
  '')
    usage >&2
    exit 2
    ;;
esac
repository="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
volumes="$(cd "$1" && pwd)"
program="$(realpath "${2:-$repository/build/release/bin/isoscope}")"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
ln -s "$volumes"/* "$work/"
mkdir "$work/bin"
ln -s "$program" "$work/bin/isoscope"
cd "$work"
# A command ends with its line; a backslash continues it.
sed -e ':next' -e '/\\$/{N;s/\\\n *//;b next' -e '}' "$repository/docs/gallery.md" |
  sed -n 's/^    *\(isoscope .*\|draw_shards.py .*\)$/\1/p' |
  while IFS= read -r command; do
    if [[ "$command" == *" big"* && -z "${ISOSCOPE_GALLERY_LARGE:-}" ]]; then
      continue
    fi
    echo "$command"
    ISOSCOPE_BIN="$(dirname "$program")" PATH="$work/bin:$repository/tools:$PATH" bash -c "$command" </dev/null >/dev/null
  done
mv ./*.jpg ./*.png "$repository/docs/gallery/"
