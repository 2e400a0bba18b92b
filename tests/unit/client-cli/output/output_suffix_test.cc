#include "client-cli/output/output_suffix.h"

#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

TEST(OutputSuffixTest, OnlyTheSuffixOfTheFormatIsTaken) {
  for (const char* path : {"a.png", "A.PNG", "f.old/a", "a", ".png", "f/.a", "/dev/null"}) {
    ISOSCOPE_EXPECT_OK(CheckSuffix(path, ".png", "PNG"));
  }
  for (const char* path : {"a.jpg", "a.png.jpeg", "f.png/a.gif", "v1.5", "a."}) {
    EXPECT_TRUE(IsUsageError(CheckSuffix(path, ".png", "PNG"))) << path;
  }
  EXPECT_EQ(CheckSuffix("f/head.obj", ".ply", "PLY").message(),
            "--output 'f/head.obj': the suffix '.obj' is not that of the format written, PLY; "
            "expected 'head.ply'");
}

}  // namespace
}  // namespace isoscope::cli
