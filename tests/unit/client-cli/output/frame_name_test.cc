#include "client-cli/output/frame_name.h"

#include <set>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/cli/usage.h"
#include "tests/support/status_matchers.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;

TEST(FrameNameTest, NumbersHaveTheirLeadingZeros) {
  EXPECT_EQ(FrameFileName("a-%d.png", 12), "a-12.png");
  EXPECT_EQ(FrameFileName("a-%03d.png", 7), "a-007.png");
  EXPECT_EQ(FrameFileName("a-%3d.png", 7), "a-007.png") << "as in ffmpeg";
  EXPECT_EQ(FrameFileName("a-%03d.png", 1234), "a-1234.png");
  EXPECT_EQ(FrameFileName("a-%00d.png", 1), "a-1.png");
  EXPECT_EQ(FrameFileName("a-%09d.png", 1), "a-000000001.png");
  EXPECT_EQ(FrameFileName("%d", 0), "0");
}

TEST(FrameNameTest, TwoPercentSignsAreOneBesideANumber) {
  EXPECT_EQ(FrameFileName("50%%-%d.png", 3), "50%-3.png");
  EXPECT_EQ(FrameFileName("%%%02d%%d.png", 3), "%03%d.png");
  EXPECT_EQ(FrameFileName("%5%%d.png", 3), "%5%%d.png") << "no number: as it is";
}

TEST(FrameNameTest, NamesOfOnePictureStayAsTheyAre) {
  for (const char* name : {"a.png", "100%.png", "100%%.png", "%s%n.png", "%", "a%", "%3", "%%",
                           "my%20dog.png", "a%10000000000000000000d.png", "a-{}.png", ""}) {
    EXPECT_EQ(FrameFileName(name, 1), name);
    EXPECT_FALSE(HasFrameNumber(name)) << name;
    ISOSCOPE_EXPECT_OK(CheckFrameName(name, 1));
  }
}

TEST(FrameNameTest, EachFrameHasAFileOfItsOwn) {
  for (const char* pattern : {"a-%d", "a-%02d", "a-%3d-%%", "%d-{}"}) {
    ISOSCOPE_EXPECT_OK(CheckFrameName(pattern, 1200));
    EXPECT_TRUE(HasFrameNumber(pattern)) << pattern;
    std::set<std::string> names;
    for (int i = 0; i < 1200; ++i) {
      names.insert(FrameFileName(pattern, i));
    }
    EXPECT_EQ(names.size(), 1200U) << pattern;
  }
}

void ExpectRefused(absl::string_view pattern, int frame_count, const std::string& words) {
  const absl::Status status = CheckFrameName(pattern, frame_count);
  EXPECT_TRUE(IsUsageError(status)) << pattern;
  EXPECT_THAT(std::string(status.message()), HasSubstr(words)) << pattern;
}

TEST(FrameNameTest, FramesThatWouldOverwriteEachOtherAreRefused) {
  const std::string kOverwrite = "36 frames would overwrite each other; write %d, or %03d";
  for (const char* pattern : {"turn-%3x.png", "turn-%i.png", "100%.png", "turn-%%.png", "turn-%",
                              "turn-%-3d.png", "turn-%20d.png"}) {
    ExpectRefused(pattern, 36, kOverwrite);
  }
  ExpectRefused("turn-%03i.png", 36, "'%03i' is no number of a frame, so that");
  ISOSCOPE_EXPECT_OK(CheckFrameName("last.png", 36)) << "the last frame stays: documented";
}

TEST(FrameNameTest, AnotherPercentSignBesideANumberIsRefused) {
  for (const int frame_count : {1, 36}) {
    ExpectRefused("%s-%d.png", frame_count, "'%s' is no number of a frame; write %d");
    ExpectRefused("%d-50%.png", frame_count, "and %% for a percent sign");
    ExpectRefused("%d-%5%.png", frame_count, "'%5' is no number");
    ExpectRefused("%d-%03d.png", frame_count, "numbers the frames twice");
  }
}

}  // namespace
}  // namespace isoscope::cli
