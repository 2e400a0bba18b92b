#include "core/source/grid/one_grid.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(OneGridTest, SaysBothGrids) {
  const volume::GridGeometry first{
      .sample_dims = {4, 3, 2}, .spacing = {1, 1, 2}, .origin = {0, 0, 5}, .direction = {}};
  ISOSCOPE_EXPECT_OK(CheckOneGrid("b.vti", first, "a.vti", first));
  volume::GridGeometry other = first;
  other.sample_dims.x = 5;
  EXPECT_THAT(CheckOneGrid("b.vti", other, "a.vti", first),
              StatusIs(kInvalid,
                       "b.vti: 5 x 3 x 2 samples, 1 x 1 x 2 apart, from (0, 0, 5); the "
                       "first step, a.vti, has 4 x 3 x 2 samples, 1 x 1 x 2 apart, from "
                       "(0, 0, 5): all steps must lie on one grid"));
}

TEST(OneGridTest, SaysDifferencesThatSixDigitsDoNotShow) {
  const volume::GridGeometry first{
      .sample_dims = {4, 3, 2}, .spacing = {1, 1, 1}, .origin = {0, 0, 0}, .direction = {}};
  volume::GridGeometry other = first;
  other.origin.y = 0.1234567891;
  volume::GridGeometry near = other;
  near.origin.y = 0.1234567892;
  EXPECT_THAT(CheckOneGrid("b", other, "a", near),
              StatusIs(kInvalid, AllOf(HasSubstr("0.1234567891"), HasSubstr("0.1234567892"))));
  other = first;
  other.direction.columns[0] = {0, 1, 0};
  EXPECT_THAT(CheckOneGrid("b", other, "a", first),
              StatusIs(kInvalid, HasSubstr(", along other directions; the first step")));
}

}  // namespace
}  // namespace isoscope::source
