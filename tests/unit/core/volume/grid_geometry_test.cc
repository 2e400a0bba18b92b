#include "core/volume/grid_geometry.h"

#include <cmath>
#include <limits>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;

GridGeometry MakeOblique() {
  GridGeometry geometry;
  geometry.sample_dims = {5, 6, 7};
  geometry.spacing = {0.5, 2, 3};
  geometry.origin = {10, -20, 30};
  geometry.direction = {
      {math::Vec3d{0.6, 0.8, 0}, math::Vec3d{-0.8, 0.6, 0}, math::Vec3d{0, 0, -1}}};
  return geometry;
}

void ExpectNear(const math::Vec3d& a, const math::Vec3d& b) {
  EXPECT_NEAR(a.x, b.x, 1e-12);
  EXPECT_NEAR(a.y, b.y, 1e-12);
  EXPECT_NEAR(a.z, b.z, 1e-12);
}

TEST(GridGeometryTest, WorldIsOriginPlusDirectionTimesSpacedIndex) {
  const math::Mat4d to_world = MakeOblique().world_from_index();
  ExpectNear(math::TransformPoint(to_world, {0, 0, 0}), {10, -20, 30});
  ExpectNear(math::TransformPoint(to_world, {2, 0, 0}), {10.6, -19.2, 30});
  ExpectNear(math::TransformPoint(to_world, {0, 1, 1}), {8.4, -18.8, 27});
}

TEST(GridGeometryTest, IndexFromWorldUndoesWorldFromIndex) {
  const GridGeometry geometry = MakeOblique();
  const math::Vec3d index{1.25, 3.5, 0.75};
  ExpectNear(math::TransformPoint(geometry.index_from_world(),
                                  math::TransformPoint(geometry.world_from_index(), index)),
             index);
}

TEST(GridGeometryTest, GradientsStayPerpendicularToTheirLevelSets) {
  const GridGeometry geometry = MakeOblique();
  // f = 2 i + 3 j - k; (3, -2, 0) and (1, 0, 2) lie in its level sets.
  const math::Vec3d gradient = geometry.world_gradient_from_index() * math::Vec3d{2, 3, -1};
  const math::Mat4d to_world = geometry.world_from_index();
  EXPECT_NEAR(math::Dot(gradient, math::TransformVector(to_world, {3, -2, 0})), 0, 1e-12);
  EXPECT_NEAR(math::Dot(gradient, math::TransformVector(to_world, {1, 0, 2})), 0, 1e-12);
  EXPECT_NEAR(math::Dot(gradient, math::TransformVector(to_world, {1, 0, 0})), 2, 1e-12);
}

TEST(GridGeometryTest, BoundsHoldTheFirstAndLastSamples) {
  GridGeometry geometry;
  geometry.sample_dims = {3, 4, 5};
  geometry.spacing = {1, 2, 3};
  geometry.origin = {-1, 0, 1};
  EXPECT_EQ(geometry.Bounds().min, (math::Vec3d{-1, 0, 1}));
  EXPECT_EQ(geometry.Bounds().max, (math::Vec3d{1, 6, 13}));
}

TEST(GridGeometryTest, ValidateNamesWhatIsWrong) {
  EXPECT_THAT(Validate(MakeOblique()), IsOk());
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  GridGeometry geometry = MakeOblique();
  geometry.sample_dims.y = 1;
  EXPECT_THAT(Validate(geometry), StatusIs(kInvalid, ::testing::HasSubstr("5 x 1 x 7")));
  geometry = MakeOblique();
  geometry.sample_dims = {std::int64_t{1} << 24, std::int64_t{1} << 24, std::int64_t{1} << 15};
  EXPECT_THAT(Validate(geometry), StatusIs(kInvalid, ::testing::HasSubstr("2^62")));
  geometry = MakeOblique();
  geometry.spacing.z = 0;
  EXPECT_THAT(Validate(geometry), StatusIs(kInvalid, ::testing::HasSubstr("spacing")));
  geometry = MakeOblique();
  geometry.origin.x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(Validate(geometry), StatusIs(kInvalid, ::testing::HasSubstr("origin")));
  geometry = MakeOblique();
  geometry.direction.columns[2] = geometry.direction.columns[0];
  EXPECT_THAT(Validate(geometry), StatusIs(kInvalid, ::testing::HasSubstr("direction")));
}

// A float holds every whole number up to 2^24: beyond, a vertex would leave its cell.
TEST(GridGeometryTest, AxesBeyondWhatFloatPositionsTellApartAreRefusedWithTheLimit) {
  for (int axis = 0; axis < 3; ++axis) {
    GridGeometry geometry;
    geometry.sample_dims = {2, 2, 2};
    geometry.sample_dims[axis] = std::int64_t{1} << 24;
    EXPECT_THAT(Validate(geometry), IsOk());
    geometry.sample_dims[axis] += 1;
    EXPECT_THAT(Validate(geometry),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         ::testing::AllOf(::testing::HasSubstr("16777217"),
                                          ::testing::HasSubstr("2^24 (16777216)"))));
  }
}

TEST(GridGeometryTest, SpacingBeyondWhatFloatPositionsCarryIsRefusedWithTheLimit) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const double spacing : {1e-24, 1e-9, 1e24}) {
      GridGeometry geometry = MakeOblique();
      geometry.spacing[axis] = spacing;
      EXPECT_THAT(Validate(geometry), IsOk()) << spacing;
    }
    for (const double spacing : {5e-324, 0.99e-24, 1.01e24, 1e308}) {
      GridGeometry geometry = MakeOblique();
      geometry.spacing[axis] = spacing;
      EXPECT_THAT(Validate(geometry), StatusIs(absl::StatusCode::kInvalidArgument,
                                               ::testing::HasSubstr("1e-24 to 1e+24")))
          << spacing;
    }
    GridGeometry geometry = MakeOblique();
    geometry.origin[axis] = -0.9e30;
    EXPECT_THAT(Validate(geometry), IsOk());
    geometry.origin[axis] = -1.1e30;
    EXPECT_THAT(Validate(geometry),
                StatusIs(absl::StatusCode::kInvalidArgument, ::testing::HasSubstr("1e+30")));
    // Directions are unit vectors by custom only.
    geometry = MakeOblique();
    auto& column = geometry.direction.columns[static_cast<std::size_t>(axis)];
    column = column * 1e30;
    EXPECT_THAT(Validate(geometry), StatusIs(absl::StatusCode::kInvalidArgument,
                                             ::testing::HasSubstr("1e-24 to 1e+24")));
  }
}

}  // namespace
}  // namespace isoscope::volume
