#!/bin/sh
# Draws the golden pictures again, for a change that is meant to change them.
#
#   tools/regenerate_golden.sh [BUILD_DIR]      default: build/release
#
# Then look at every picture, before and after (git difftool, or any viewer), and commit them with the
# change that made them and the reason.
set -eu
cd "$(dirname "$0")/.."
build="${1:-build/release}"
cmake --build "$build" --target golden_test
# It fails on purpose, because it compares nothing. The second run compares.
ISOSCOPE_REGENERATE_GOLDEN=1 "$build/tests/golden_test" --gtest_brief=1 >/dev/null || true
"$build/tests/golden_test" --gtest_brief=1
git status --short -- tests/golden
