#include "core/formats/stacks/lsm_stack.h"

#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/stacks/lsm_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::LsmBytes;
using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(LsmStackTest, VoxelsAreInMicrometresAndChannelsAreTheFastest) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const StackLayout layout,
      ParseLsm(LsmBytes({.slices = 5, .channels = 3, .steps = 2, .scan = 6, .interval = 1.5})));
  EXPECT_EQ(layout.slices, 5);
  EXPECT_EQ(layout.channels, 3);
  EXPECT_EQ(layout.steps, 2);
  EXPECT_NEAR(layout.spacing.x, 0.1, 1e-15);
  EXPECT_NEAR(layout.spacing.y, 0.2, 1e-15);
  EXPECT_NEAR(layout.spacing.z, 0.5, 1e-15);
  EXPECT_EQ(layout.length_unit, "um");
  EXPECT_THAT(layout.times, ElementsAre(0, 1.5));
  EXPECT_EQ(layout.PlaneOf(1, 2, 3).index, (1 * 5 + 3) * 3 + 2);
}

TEST(LsmStackTest, TagsThatMakeNoStackAreRefused) {
  EXPECT_THAT(ParseLsm("").status(), StatusIs(kInvalid, HasSubstr("CZ_LSMINFO")));
  EXPECT_THAT(ParseLsm(LsmBytes({}).substr(0, 119)).status(), StatusIs(kInvalid, HasSubstr("119")));
  EXPECT_THAT(ParseLsm(LsmBytes({.slices = 0})).status(),
              StatusIs(kInvalid, HasSubstr("0 slices")));
  EXPECT_THAT(ParseLsm(LsmBytes({.slices = 2000000000, .channels = 2000000000})).status(),
              StatusIs(kInvalid, HasSubstr("at most")));
  EXPECT_THAT(ParseLsm(LsmBytes({.scan = 1})).status(),
              StatusIs(kInvalid, HasSubstr("scan type 1")));
}

TEST(LsmStackTest, VoxelsWithoutASizeAreNamed) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(StackLayout layout, ParseLsm(LsmBytes({})));
  EXPECT_EQ(layout.distances, "");
  for (const double bad : {0.0, -1e-7, std::nan(""), HUGE_VAL}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(layout, ParseLsm(LsmBytes({.voxel_metres = {1e-7, bad, 1e-7}})));
    EXPECT_THAT(layout.distances, HasSubstr("um along y"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(layout, ParseLsm(LsmBytes({.voxel_metres = {1e-7, 1e-7, bad}})));
    EXPECT_THAT(layout.distances, HasSubstr("um along z"));
  }
}

}  // namespace
}  // namespace isoscope::source
