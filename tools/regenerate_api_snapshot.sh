#!/bin/sh
# Writes the snapshot of the public protos (isoscope.v1) that api_snapshot_test compares with, for a
# change that adds to them.
#
#   tools/regenerate_api_snapshot.sh
#
# Run the test before: a change that it calls incompatible breaks clients, and must be undone or `reserved`.
# Then commit the snapshot with the protos.
set -eu
cd "$(dirname "$0")/.."
mkdir -p tests/golden/api
"${PROTOC:-protoc}" --proto_path=proto \
  --descriptor_set_out=tests/golden/api/isoscope_v1.binpb \
  $(cd proto && ls isoscope/v1/*.proto | LC_ALL=C sort)
git status --short -- tests/golden/api
