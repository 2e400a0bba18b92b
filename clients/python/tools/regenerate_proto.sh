#!/bin/sh
# Writes src/isoscope/_proto: the messages of isoscope.v1, for a change of the protos.
#
#   clients/python/tools/regenerate_proto.sh [FOLDER]
#
# Takes protoc 3.21 of Debian 12 (protobuf-compiler): code of an old protoc runs with an old runtime and with newer
# ones, never the other way round. Calls need no stubs: src/isoscope/_core.py has their paths.
set -eu
here="$(cd "$(dirname "$0")/.." && pwd)"
protos="$here/../../proto"
folder="${1:-$here/src/isoscope/_proto}"

scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT
(cd "$protos" && "${PROTOC:-protoc}" --proto_path=. \
  --python_out="$scratch" --pyi_out="$scratch" isoscope/v1/*.proto)

mkdir -p "$folder"
rm -f "$folder"/*_pb2.py "$folder"/*_pb2.pyi
# The protos' package is isoscope.v1; the modules are private ones of the package isoscope. Newer runtimes have no
# RegisterExtension: they need no call.
for file in "$scratch"/isoscope/v1/*; do
  sed -e 's/^from isoscope\.v1 import /from isoscope._proto import /' \
    -e 's/^  \(.*\)\.RegisterExtension(/  getattr(\1, "RegisterExtension", id)(/' "$file" >"$folder/${file##*/}"
done
