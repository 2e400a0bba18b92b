#include "core/formats/vtk/vti_grid.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/vtk/vti_tags.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::VtiArrayTag;
using ::isoscope::testing::VtiTags;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class VtiGridTest : public testing::VtiTagsTest {};

TEST_F(VtiGridTest, CellsLieHalfASpacingFurtherAndAreOneLess) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VtiHeader header, Read(VtiTags(VtiArrayTag("a"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto points, VtiGeometry(header, false, "v.vti"));
  EXPECT_EQ(points.sample_dims, (math::Index3{4, 5, 3}));
  EXPECT_EQ(points.spacing, (math::Vec3d{0.5, 2, 4}));
  EXPECT_EQ(points.direction.columns[0], (math::Vec3d{0, 1, 0}));
  EXPECT_EQ(points.direction.columns[1], (math::Vec3d{-1, 0, 0}));
  // Index (2, -1, 0): 2 * 0.5 along y, -1 * 2 along -x.
  EXPECT_EQ(points.origin, (math::Vec3d{12, 21, 30}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cells, VtiGeometry(header, true, "v.vti"));
  EXPECT_EQ(cells.sample_dims, (math::Index3{3, 4, 2}));
  EXPECT_EQ(cells.spacing, points.spacing);
  // Index (2.5, -0.5, 0.5).
  EXPECT_EQ(cells.origin, (math::Vec3d{11, 21.25, 32}));
}

TEST_F(VtiGridTest, FlatGridHasNoVolumeOfCells) {
  std::string bytes = VtiTags(VtiArrayTag("a"));
  for (std::size_t at = 0; (at = bytes.find("0 2\"", at)) != std::string::npos; ++at) {
    bytes.replace(at, 4, "0 1\"");
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VtiHeader header, Read(bytes));
  ISOSCOPE_EXPECT_OK(VtiGeometry(header, false, "v.vti").status());
  EXPECT_THAT(VtiGeometry(header, true, "v.vti").status(),
              StatusIs(kInvalid, HasSubstr("centres of its cells")));
}

TEST_F(VtiGridTest, ExtentsAreSixNumbersOf32Bits) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VtkExtent extent,
                                ParseVtkExtent(" -3 63\t0 2147483647\n0 92 ", "Extent", "v.vti"));
  EXPECT_EQ(extent, (VtkExtent{-3, 63, 0, 2147483647, 0, 92}));
  for (const char* text : {"", "0 1 0 1 0", "0 1 0 1 0 1 0", "0 1 0 1 0 1.5", "0 1 0 1 0 x"}) {
    EXPECT_THAT(
        ParseVtkExtent(text, "Extent", "v.vti").status(),
        StatusIs(kInvalid, absl::StrCat("v.vti: Extent=\"", text, "\"; expected 6 numbers")));
  }
  for (const char* text : {"0 1 0 1 0 2147483648", "-2147483648 1 0 1 0 1"}) {
    EXPECT_THAT(ParseVtkExtent(text, "WholeExtent", "v.vti").status(),
                StatusIs(kInvalid, HasSubstr("WholeExtent")));
    EXPECT_THAT(ParseVtkExtent(text, "WholeExtent", "v.vti").status(),
                StatusIs(kInvalid, HasSubstr("expected 32-bit numbers")));
  }
}

TEST_F(VtiGridTest, GridWithoutAttributesHasUnitSpacingAtTheOriginAndMayBeEmpty) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, VtkGridOf({}, {1, 4, 0, 0, 0, 2}, true, "v.vti"));
  EXPECT_EQ(grid.sample_dims, (math::Index3{3, 0, 2}));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1, 1, 1}));
  EXPECT_EQ(grid.origin, (math::Vec3d{1.5, 0.5, 0.5}));
  EXPECT_EQ(grid.direction.columns[1], (math::Vec3d{0, 1, 0}));
  EXPECT_THAT(VtkGridOf({{"Spacing", "1 1"}}, {}, false, "v.vti").status(),
              StatusIs(kInvalid, "v.vti: Spacing=\"1 1\"; expected 3 numbers"));
}

TEST_F(VtiGridTest, ImageInSeveralPiecesIsRefused) {
  std::string bytes = VtiTags(VtiArrayTag("a"));
  const std::string piece = "<Piece Extent=\"2 5";
  bytes.replace(bytes.find(piece), piece.size(), "<Piece Extent=\"2 3");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VtiHeader header, Read(bytes));
  EXPECT_THAT(VtiGeometry(header, false, "v.vti").status(),
              StatusIs(kInvalid,
                       "v.vti: its first piece is 2 3 -1 3 0 2 of 2 5 -1 3 0 2; expected "
                       "all of it in one piece"));
}

}  // namespace
}  // namespace isoscope::source
