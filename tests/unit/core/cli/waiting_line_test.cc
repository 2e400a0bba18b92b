#include "core/cli/waiting_line.h"

#include <sstream>

#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;

TEST(WaitingLineTest, ShortWorkAndFilesGetNoByte) {
  std::ostringstream err;
  { const WaitingLine line(&err, /*is_terminal=*/true, "rendering", absl::Hours(1)); }
  {
    const WaitingLine line(&err, /*is_terminal=*/false, "rendering", absl::ZeroDuration());
    absl::SleepFor(absl::Milliseconds(20));
  }
  EXPECT_EQ(err.str(), "");
}

TEST(WaitingLineTest, LongWorkIsNamedAndTheLineClearedAtTheEnd) {
  std::ostringstream err;
  {
    const WaitingLine line(&err, /*is_terminal=*/true, "rendering", absl::ZeroDuration());
    absl::SleepFor(absl::Milliseconds(200));
  }
  EXPECT_THAT(err.str(), HasSubstr("rendering   0 s"));
  EXPECT_EQ(err.str().substr(err.str().size() - 3), "\x1B[K") << "the line is cleared";
}

}  // namespace
}  // namespace isoscope::cli
