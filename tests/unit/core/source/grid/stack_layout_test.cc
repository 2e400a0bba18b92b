#include "core/source/grid/stack_layout.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(StackLayoutTest, LettersSayWhichPlaneIsWhere) {
  const auto index_of = [](const char* letters, int step, int channel, int slice) {
    StackLayout layout{.slices = 5, .channels = 3, .steps = 2};
    LayPlanes(letters, &layout);
    EXPECT_EQ(layout.planes.size(), 30u);
    return layout.PlaneOf(step, channel, slice).index;
  };
  EXPECT_EQ(index_of("TCZ", 1, 2, 3), (1 * 3 + 2) * 5 + 3);
  EXPECT_EQ(index_of("TZC", 1, 2, 3), (1 * 5 + 3) * 3 + 2);
  EXPECT_EQ(index_of("CZT", 1, 2, 3), (2 * 5 + 3) * 2 + 1);
  EXPECT_EQ(index_of("ZTC", 1, 2, 3), (3 * 2 + 1) * 3 + 2);
}

TEST(StackLayoutTest, PageAxesTakeOneCountFromTheNumberOfPlanes) {
  StackLayout layout;
  ISOSCOPE_ASSERT_OK(ApplyPageAxes("TC3Z5", 30, false, &layout));
  EXPECT_EQ(layout.steps, 2);
  EXPECT_EQ(layout.channels, 3);
  EXPECT_EQ(layout.slices, 5);
  EXPECT_EQ(layout.PlaneOf(1, 2, 3).index, 28);
  ISOSCOPE_ASSERT_OK(ApplyPageAxes("zc2yx", 8, false, &layout));
  EXPECT_EQ(layout.slices, 4);
  EXPECT_EQ(layout.steps, 1);
  EXPECT_EQ(layout.PlaneOf(0, 1, 3).index, 7);
  ISOSCOPE_ASSERT_OK(ApplyPageAxes("T2Z3", 6, false, &layout));
  EXPECT_EQ(layout.slices, 3);
}

TEST(StackLayoutTest, PageAxesKeepTheCountsThatTheFileSays) {
  StackLayout layout{.slices = 5, .channels = 3, .steps = 2};
  layout.times = {0, 7};
  layout.time_unit = "s";
  layout.channel_names = {"a", "b", "c"};
  layout.files = {"other.tif"};
  ISOSCOPE_ASSERT_OK(ApplyPageAxes("CZT", 30, true, &layout));
  EXPECT_EQ(layout.PlaneOf(1, 2, 3).index, (2 * 5 + 3) * 2 + 1);
  EXPECT_THAT(layout.times, ElementsAre(0, 7));
  EXPECT_TRUE(layout.files.empty());
  ISOSCOPE_ASSERT_OK(ApplyPageAxes("Z", 30, true, &layout));
  EXPECT_EQ(layout.slices, 30);
  EXPECT_TRUE(layout.times.empty());
  EXPECT_TRUE(layout.channel_names.empty());
}

TEST(StackLayoutTest, PageAxesThatMakeNoSenseSayWhy) {
  StackLayout layout;
  for (const char* axes :
       {"", "YX", "Q", "ZZ", "TCZ", "Z0", "Z-1", "Z99999999999999999999", "3Z"}) {
    EXPECT_THAT(ApplyPageAxes(axes, 30, false, &layout),
                StatusIs(kInvalid, HasSubstr("what its 30 planes are")))
        << axes;
  }
  for (const char* axes : {"T7Z", "TC3Z7", "Z31", "Z29", "T1000000C1000000Z"}) {
    EXPECT_THAT(ApplyPageAxes(axes, 30, false, &layout),
                StatusIs(kInvalid, HasSubstr("30 planes can't be so many")))
        << axes;
  }
}

TEST(StackLayoutTest, UnitsHaveOneNameHoweverTheyAreSpelled) {
  for (const char* text : {"um", "micron", "\xc2\xb5m", "\xce\xbcm", "\\u00B5m"}) {
    ASSERT_TRUE(LengthUnitOf(text).has_value()) << text;
    EXPECT_EQ(LengthUnitOf(text)->name, "um");
    EXPECT_EQ(LengthUnitOf(text)->metres, 1e-6);
  }
  EXPECT_EQ(LengthUnitOf("nm")->metres, 1e-9);
  EXPECT_FALSE(LengthUnitOf("pixel").has_value());
  EXPECT_FALSE(LengthUnitOf("").has_value());
}

TEST(StackLayoutTest, NamesOfChannelsAreUnique) {
  StackLayout layout;
  EXPECT_THAT(NamesOfChannels(layout, "file"), ElementsAre("file"));
  layout.channels = 4;
  EXPECT_THAT(NamesOfChannels(layout, "file"),
              ElementsAre("channel 0", "channel 1", "channel 2", "channel 3"));
  layout.channel_names = {"GFP", "", "GFP", "GFP #2"};
  EXPECT_THAT(NamesOfChannels(layout, "file"), ElementsAre("GFP", "channel 1", "GFP #2", "GFP #3"));
}

}  // namespace
}  // namespace isoscope::source
