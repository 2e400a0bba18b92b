#include "client-cli/output/output_suffix.h"

#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

TEST(OutputSuffixTest, OnlyTheSuffixOfTheFormatIsTaken) {
  for (const char* path : {"a.png", "A.PNG", "f.old/a", "a", ".png", "f/.a", "/dev/null"}) {
    ISOSCOPE_EXPECT_OK(CheckSuffix(path, ".png", ".png"));
  }
  for (const char* path : {"a.jpg", "a.png.jpeg", "f.png/a.gif", "v1.5", "a."}) {
    EXPECT_TRUE(IsUsageError(CheckSuffix(path, ".png", ".png"))) << path;
  }
  EXPECT_EQ(CheckSuffix("f/head.gif", ".png", ".png and .jpg").message(),
            "--output 'f/head.gif': the suffix '.gif' is of no format that is written: .png and "
            ".jpg; expected 'head.png'");
}

}  // namespace
}  // namespace isoscope::cli
