#include "core/source/grid/rectilinear_grid.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

TEST(RectilinearGridTest, EvenAxesAreAGrid) {
  const RectilinearAxes axes{.points = {{{-1, 1, 3}, {5, 4, 3, 2}, {10, 10.5}}}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, RectilinearGridOf(axes, false, {}));
  EXPECT_EQ(grid.geometry.sample_dims, (math::Index3{3, 4, 2}));
  EXPECT_EQ(grid.geometry.origin, (math::Vec3d{-1, 5, 10}));
  EXPECT_EQ(grid.geometry.spacing, (math::Vec3d{2, 1, 0.5}));
  EXPECT_EQ(grid.geometry.direction.columns[1], (math::Vec3d{0, -1, 0}));
  EXPECT_THAT(grid.distances, ElementsAre(IsEmpty(), IsEmpty(), IsEmpty()));
}

TEST(RectilinearGridTest, UnevenAxesNeedResampling) {
  const RectilinearAxes axes{.points = {{{0, 2, 4, 8}, {0, 1, 2}, {0, 1, 2}}}};
  EXPECT_THAT(RectilinearGridOf(axes, false, {}),
              StatusIs(kInvalid, HasSubstr("axis \"x\" is not even")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto points,
                                RectilinearGridOf(axes, false, {.resamples = true}));
  EXPECT_THAT(points.distances[0], ElementsAre(0, 2, 4, 8));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cells,
                                RectilinearGridOf(axes, true, {.resamples = true}));
  EXPECT_THAT(cells.distances[0], ElementsAre(0, 2, 5));  // centres at 1, 3 and 6
  EXPECT_EQ(cells.geometry.origin, (math::Vec3d{1, 0.5, 0.5}));
}

TEST(RectilinearGridTest, FoldedAxisIsRefusedWithoutAdviceToResample) {
  const RectilinearAxes axes{.points = {{{0, 1}, {0, 1, 2, 1, 2, 3}, {0, 1}}}};
  for (const bool resamples : {false, true}) {
    EXPECT_THAT(
        RectilinearGridOf(axes, false, {.resamples = resamples}),
        StatusIs(kInvalid, ::testing::AllOf(HasSubstr("\"y\" has the coordinate 1 behind 2"),
                                            ::testing::Not(HasSubstr("--resample")))));
  }
}

TEST(RectilinearGridTest, CoordinatesOf32BitsMayBeRounded) {
  RectilinearAxes axes{.points = {{{1e6, 1000000.0625, 1000000.1875}, {0, 1}, {0, 1}}}};
  EXPECT_THAT(RectilinearGridOf(axes, false, {}), StatusIs(kInvalid));
  axes.is_single = true;
  EXPECT_TRUE(RectilinearGridOf(axes, false, {}).ok());
}

TEST(RectilinearGridTest, OneSampleOnAnAxisIsNoVolume) {
  const RectilinearAxes axes{.points = {{{0, 1}, {0, 1}, {0, 1, 2}}}};
  EXPECT_TRUE(RectilinearGridOf(axes, false, {}).ok());
  EXPECT_THAT(RectilinearGridOf(axes, true, {}),
              StatusIs(kInvalid, HasSubstr("2 points along y: an isosurface needs 2 samples")));
  EXPECT_THAT(RectilinearGridOf({}, true, {}), StatusIs(kInvalid, HasSubstr("0 points along z")));
}

}  // namespace
}  // namespace isoscope::source
