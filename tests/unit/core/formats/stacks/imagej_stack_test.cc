#include "core/formats/stacks/imagej_stack.h"

#include <cmath>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
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

TEST(ImageJStackTest, SizesOfPixelsAreWholeOrNone) {
  struct Case {
    const char* lines;
    PixelDensity density;
    const char* distances;  // why there are none; "" if there are
    math::Vec3d spacing{1, 1, 1};
  };
  const double nan = std::nan("");
  for (const Case& c : std::vector<Case>{
           {"unit=micron\nspacing=3", {.x = 4, .y = 2}, "", {0.25, 0.5, 3}},
           {"unit=micron", {.x = 4, .y = 4}, "", {0.25, 0.25, 1}},  // ImageJ writes no 1
           {"unit=micron", {}, ""},
           {"", {}, ""},
           {"unit=micron\nspacing=3", {}, "spacing=3"},
           {"spacing=3", {.x = nan, .y = nan}, "XResolution of nan"},
           {"unit=micron\nspacing=3", {.x = 4}, "YResolution of 0"},
           {"unit=micron\nspacing=3", {.y = 4}, "XResolution of 0"},
           {"unit=micron\nspacing=0", {.x = 4, .y = 4}, "spacing=0"},
           {"unit=micron\nspacing=nan", {.x = 4, .y = 4}, "spacing=nan"},
           {"unit=micron\nspacing=thick", {.x = 4, .y = 4}, "spacing=thick"},
           // Of a print; with a distance of slices, ImageJ takes it for a size.
           {"", {.x = 72, .y = 72, .unit = "in"}, ""},
           {"", {.x = 300, .y = 300, .unit = "in"}, ""},
           {"spacing=2", {.x = 72, .y = 72, .unit = "in"}, "", {1, 1, 2}},
           {"spacing=2", {.x = 4, .y = 4, .unit = "cm"}, "", {0.25, 0.25, 2}},
           {"unit=mm\nyunit=mm\nzunit=cm\nspacing=2", {.x = 4, .y = 4}, "", {0.25, 0.25, 20}}}) {
    SCOPED_TRACE(absl::StrCat(c.lines, " ", c.density.x, " ", c.density.y, c.density.unit));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const StackLayout layout,
        ParseImageJ(absl::StrCat("ImageJ=1\nimages=7\n", c.lines), c.density));
    EXPECT_THAT(layout.distances, HasSubstr(c.distances));
    EXPECT_EQ(layout.distances.empty(), std::string(c.distances).empty());
    if (layout.distances.empty()) {
      EXPECT_EQ(layout.spacing, c.spacing);
    }
  }
  EXPECT_THAT(ParseImageJ("ImageJ=1\nimages=7\nunit=mm\nzunit=sec\n", {.x = 4, .y = 4}).status(),
              StatusIs(kInvalid, HasSubstr("zunit=sec")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const StackLayout moved,
      ParseImageJ("ImageJ=1\nimages=7\nunit=mm\nspacing=2\nxorigin=8\nzorigin=-1\n",
                  {.x = 4, .y = 4}));
  EXPECT_EQ(moved.origin, (math::Vec3d{-2, 0, 2}));
}

// One below 0 had lost its sign.
TEST(ImageJStackTest, IntervalsThatAreNoneAreRefused) {
  const auto parse = [](const char* frames, const char* interval) {
    return ParseImageJ(absl::StrCat("ImageJ=1\nimages=6\n", frames, "\nfinterval=", interval), {});
  };
  for (const char* interval : {"-3", "nan", "inf", "1e999", "soon"}) {
    EXPECT_THAT(parse("slices=3\nframes=2", interval).status(),
                StatusIs(kInvalid, HasSubstr(absl::StrCat("has finterval=", interval, ";"))));
    ISOSCOPE_EXPECT_OK(parse("slices=6", interval).status()) << "there are no steps";
  }
  for (const char* interval : {"0", ""}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const StackLayout layout, parse("slices=3\nframes=2", interval));
    EXPECT_TRUE(layout.times.empty());
  }
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
