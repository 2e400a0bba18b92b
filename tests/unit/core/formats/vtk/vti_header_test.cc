#include "core/formats/vtk/vti_header.h"

#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/vtk/vti_tags.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::kThreeComponents;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::VtiArrayTag;
using ::isoscope::testing::VtiTags;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class VtiHeaderTest : public testing::VtiTagsTest {};

TEST_F(VtiHeaderTest, AllThatTheTagsSayIsKept) {
  const std::string bytes =
      VtiTags(VtiArrayTag("v", "Int16", kThreeComponents, "AAAA") + VtiArrayTag("p"),
              VtiArrayTag("c", "UInt8"), "Scalars=\"s\"", "Scalars=\"t\"");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VtiHeader header, Read(bytes));
  EXPECT_TRUE(header.is_image);
  EXPECT_TRUE(header.is_big_endian);
  EXPECT_TRUE(header.has_long_sizes);
  EXPECT_EQ(header.compressor, "");
  EXPECT_EQ(header.piece_count, 1);
  EXPECT_EQ(header.point_scalars, "s");
  EXPECT_EQ(header.cell_scalars, "t");
  EXPECT_EQ(header.appended_encoding, "raw");
  EXPECT_EQ(bytes.substr(static_cast<std::size_t>(header.appended_start), 2), "\n_");
  ASSERT_EQ(header.arrays.size(), 3u);
  const VtiArray& v = header.arrays[0];
  EXPECT_EQ(v.name, "v");
  EXPECT_EQ(v.type, "Int16");
  EXPECT_EQ(v.components, 3);
  EXPECT_EQ(v.format, "binary");
  EXPECT_EQ(bytes.substr(static_cast<std::size_t>(v.inline_start), 4), "AAAA");
  EXPECT_FALSE(header.arrays[1].is_of_cells);
  EXPECT_EQ(header.arrays[1].components, 1);
  EXPECT_TRUE(header.arrays[2].is_of_cells);
}

TEST_F(VtiHeaderTest, CoordinatesOfARectilinearGridAreNoFields) {
  const std::string bytes =
      "<VTKFile type=\"RectilinearGrid\"><RectilinearGrid WholeExtent=\"0 1 0 1 0 1\">"
      "<Piece Extent=\"0 1 0 1 0 1\"><PointData>" +
      VtiArrayTag("p") + "</PointData><Coordinates>" + VtiArrayTag("x", "Float64", "", "AAAA") +
      VtiArrayTag("y") + VtiArrayTag("z") + "</Coordinates></Piece></RectilinearGrid></VTKFile>";
  testing::WriteFile(dir_.Sub("v.vtr"), bytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto file, io::OpenRandomAccessFile(dir_.Sub("v.vtr")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VtiHeader header, ReadWholeVtiHeader(*file));
  EXPECT_FALSE(header.is_image);
  EXPECT_TRUE(header.is_rectilinear);
  EXPECT_EQ(header.image.at("WholeExtent"), "0 1 0 1 0 1");
  ASSERT_EQ(header.arrays.size(), 1u);
  ASSERT_EQ(header.coordinates.size(), 3u);
  EXPECT_EQ(header.coordinates[0].name, "x");
  EXPECT_EQ(header.coordinates[0].type, "Float64");
  EXPECT_EQ(bytes.substr(static_cast<std::size_t>(header.coordinates[0].inline_start), 4), "AAAA");
  EXPECT_EQ(header.coordinates[2].format, "appended");
}

TEST_F(VtiHeaderTest, LongTextIsPassedAndLongTagsAreNot) {
  // 3 MiB of inline data in one line, before the array that is chosen.
  const std::string text(3 << 20, 'A');
  const std::string bytes =
      VtiTags(VtiArrayTag("a", "Float32", kThreeComponents, text) + VtiArrayTag("b"));
  EXPECT_EQ(Chosen(bytes), "p:b:0");
  EXPECT_THAT(Read("<VTKFile a=\"" + text + "\">").status(),
              StatusIs(kInvalid, HasSubstr("a tag of more than")));
  EXPECT_THAT(Read(VtiTags(VtiArrayTag(std::string(5000, 'n')))).status(),
              StatusIs(kInvalid, HasSubstr("name of more than")));
  std::string many;
  for (int i = 0; i < 5000; ++i) {
    many += VtiArrayTag("v", "Float32", kThreeComponents);
  }
  EXPECT_THAT(Read(VtiTags(many)).status(), StatusIs(kInvalid, HasSubstr("more than 4096 arrays")));
  for (const char* count : {"0", "-1", "x", "99999999999999999999", "5000"}) {
    EXPECT_THAT(
        Read(VtiTags(VtiArrayTag("v", "Int8", absl::StrCat("NumberOfComponents=\"", count, "\""))))
            .status(),
        StatusIs(kInvalid, HasSubstr(absl::StrCat("array \"v\" of ", count, " components"))));
  }
}

}  // namespace
}  // namespace isoscope::source
