#include "core/source/imagej_stack.h"

#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/math/vec.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(ImageJStackTest, CountsUnitsAndIntervalComeFromTheLines) {
  EXPECT_TRUE(IsImageJDescription("ImageJ=1.53t\nimages=2\n"));
  EXPECT_FALSE(IsImageJDescription("a picture by ImageJ=1.53t"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const StackLayout layout,
      ParseImageJ("ImageJ=1.53t\nimages=30\nchannels=3\nslices=5\nframes=2\nhyperstack=true\n"
                  "unit=micron\nspacing=-0.75\nfinterval=2.5\nloop=false\n",
                  {.x = 4, .y = 2}));
  EXPECT_EQ(layout.slices, 5);
  EXPECT_EQ(layout.channels, 3);
  EXPECT_EQ(layout.steps, 2);
  EXPECT_EQ(layout.spacing, (math::Vec3d{0.25, 0.5, 0.75}));
  EXPECT_EQ(layout.length_unit, "um");
  EXPECT_THAT(layout.times, ElementsAre(0, 2.5));
  EXPECT_EQ(layout.time_unit, "s");
  EXPECT_EQ(layout.PlaneOf(1, 2, 3).index, (1 * 5 + 3) * 3 + 2);  // channels are the fastest
}

TEST(ImageJStackTest, ImagesAloneAreSlices) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const StackLayout layout,
                                ParseImageJ("ImageJ=1.11a\r\nimages=7\r\nunit=pixel", {}));
  EXPECT_EQ(layout.slices, 7);
  EXPECT_EQ(layout.spacing, (math::Vec3d{1, 1, 1}));
  EXPECT_EQ(layout.length_unit, "");
  EXPECT_TRUE(layout.times.empty());
}

TEST(ImageJStackTest, CountsThatContradictEachOtherAreRefused) {
  for (const char* lines : {"images=7\nslices=2\nframes=3", "slices=6",
                            "images=1000000\nchannels=1000000\nslices=9", "images=5\nchannels=2"}) {
    EXPECT_THAT(ParseImageJ(std::string("ImageJ=1\n") + lines, {}).status(),
                StatusIs(kInvalid, HasSubstr("expected their product")))
        << lines;
  }
  for (const char* lines :
       {"images=0", "images=-3", "images=many", "images=99999999999999999999", "frames=2000000"}) {
    EXPECT_THAT(ParseImageJ(std::string("ImageJ=1\n") + lines, {}).status(),
                StatusIs(kInvalid, HasSubstr("expected 1 to 1000000")))
        << lines;
  }
}

}  // namespace
}  // namespace isoscope::source
