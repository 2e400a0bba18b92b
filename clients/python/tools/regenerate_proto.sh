#!/bin/sh
# Writes src/isoscope/_proto: the messages and stubs of isoscope.v1, for a change of the protos.
#
#   clients/python/tools/regenerate_proto.sh [FOLDER]
#
# Takes protoc 3.21 and grpc_python_plugin 1.51 of Debian 12 (protobuf-compiler, protobuf-compiler-grpc):
# code of an old protoc runs with an old runtime and with newer ones, never the other way round.
set -eu
here="$(cd "$(dirname "$0")/.." && pwd)"
protos="$here/../../proto"
folder="${1:-$here/src/isoscope/_proto}"

scratch="$(mktemp -d)"
trap 'rm -rf "$scratch"' EXIT
(cd "$protos" && "${PROTOC:-protoc}" --proto_path=. \
  --python_out="$scratch" --pyi_out="$scratch" --grpc_out="$scratch" \
  --plugin=protoc-gen-grpc="${GRPC_PYTHON_PLUGIN:-$(command -v grpc_python_plugin)}" \
  isoscope/v1/*.proto)

mkdir -p "$folder"
rm -f "$folder"/*_pb2.py "$folder"/*_pb2.pyi "$folder"/*_pb2_grpc.py
# The protos' package is isoscope.v1; the modules are private ones of the package isoscope.
for file in "$scratch"/isoscope/v1/*; do
  case "$file" in
    *_pb2_grpc.py) grep -q '^class ' "$file" || continue ;;
  esac
  sed 's/^from isoscope\.v1 import /from isoscope._proto import /' "$file" >"$folder/${file##*/}"
done
