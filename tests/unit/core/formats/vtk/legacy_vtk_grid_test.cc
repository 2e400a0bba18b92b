#include "core/formats/vtk/legacy_vtk_grid.h"

#include <memory>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class LegacyGridTest : public ::testing::Test {
 protected:
  // Reads the lines of a grid as text.
  absl::Status Read(const std::string& text, bool is_rectilinear) {
    testing::WriteFile(dir_.Sub("grid"), text);
    const auto file = io::OpenRandomAccessFile(dir_.Sub("grid")).value();
    LegacyWords words(file.get());
    grid_ = LegacyGrid();
    if (is_rectilinear) {
      grid_.SetRectilinear();
    }
    while (true) {
      const auto keyword = words.NextKeyword();
      if (!keyword.ok() || keyword->empty()) {
        return keyword.status();
      }
      const auto taken = grid_.Take(*keyword, false, &words);
      if (!taken.ok() || !*taken) {
        return taken.ok() ? absl::NotFoundError(*keyword) : taken.status();
      }
    }
  }
  testing::TempDir dir_;
  LegacyGrid grid_;
};

TEST_F(LegacyGridTest, CellsOfARectilinearGridLieBetweenItsPoints) {
  ASSERT_TRUE(Read("DIMENSIONS 4 3 3\nX_COORDINATES 4 float\n0 2 4 8\n"
                   "Y_COORDINATES 3 float\n5 4 3\nZ_COORDINATES 3 double\n1 2 3\n",
                   true)
                  .ok());
  EXPECT_THAT(grid_.Locate(true, {}), StatusIs(kInvalid, HasSubstr("axis \"x\" is not even")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cells, grid_.Locate(true, {.resamples = true}));
  EXPECT_EQ(cells.geometry.sample_dims, (math::Index3{3, 2, 2}));
  EXPECT_THAT(cells.distances[0], ElementsAre(0, 2, 5));  // centres at 1, 3 and 6
  EXPECT_THAT(cells.distances[1], ElementsAre());
  EXPECT_EQ(cells.geometry.origin, (math::Vec3d{1, 4.5, 1.5}));
  EXPECT_EQ(cells.geometry.direction.columns[1], (math::Vec3d{0, -1, 0}));
  EXPECT_THAT(grid_.Locate(false, {}), StatusIs(kInvalid, HasSubstr("axis \"x\"")));
}

TEST_F(LegacyGridTest, WordsThatAreNoGridAreRefused) {
  EXPECT_THAT(Read("DIMENSIONS 4 3 3\nX_COORDINATES 4 float\n", false),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("X_COORDINATES")));
  EXPECT_THAT(Read("ORIGIN 1 2 3\n", true), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(Read("X_COORDINATES 3 float\n1 2\n", true), StatusIs(kInvalid, HasSubstr("cut")));
  EXPECT_THAT(Read("X_COORDINATES 3 float\n1 2 c\n", true), StatusIs(kInvalid, HasSubstr("\"c\"")));
  EXPECT_THAT(Read("X_COORDINATES 3 int\n1 2 3\n", true), StatusIs(kInvalid, HasSubstr("\"int\"")));
  ASSERT_TRUE(Read("DIMENSIONS 4 3 3\nX_COORDINATES 3 float\n1 2 3\n", true).ok());
  EXPECT_THAT(grid_.Locate(false, {.resamples = true}),
              StatusIs(kInvalid, HasSubstr("0 Z_COORDINATES; DIMENSIONS 4 3 3 have 3")));
}

TEST_F(LegacyGridTest, StructuredPointsHaveOriginAndSpacing) {
  ASSERT_TRUE(Read("DIMENSIONS 4 3 3\nORIGIN 1 2 3\nASPECT_RATIO 2 2 4\n", false).ok());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cells, grid_.Locate(true, {}));
  EXPECT_EQ(cells.geometry.origin, (math::Vec3d{2, 3, 5}));
  EXPECT_EQ(cells.geometry.sample_dims, (math::Index3{3, 2, 2}));
}

}  // namespace
}  // namespace isoscope::source
