#include "core/formats/vtk/legacy_vtk_parser.h"

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// 2 x 3 x 2 points, 2 cells.
std::string Head(bool is_binary) {
  return absl::StrCat("# vtk DataFile Version 3.0\na title\n", is_binary ? "BINARY" : "ASCII",
                      "\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 3 2\n");
}
constexpr char kTwelve[] = "0 1 2 3 4 5 6 7 8 9 10 11\n";

class LegacyVtkParserTest : public ::testing::Test {
 protected:
  absl::StatusOr<LegacyVtkFile> Parse(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("a.vtk"), bytes);
    const auto file = io::OpenRandomAccessFile(dir_.Sub("a.vtk"));
    return file.ok() ? ParseLegacyVtk(**file) : file.status();
  }
  testing::TempDir dir_;
};

TEST_F(LegacyVtkParserTest, FilesBeginWithTheMark) {
  EXPECT_TRUE(IsLegacyVtk("# vtk DataFile Version 5.1\n"));
  EXPECT_FALSE(IsLegacyVtk("# vtk DataFile"));
  EXPECT_FALSE(IsLegacyVtk(" # vtk DataFile Version 5.1\n"));
}

TEST_F(LegacyVtkParserTest, ArraysOfTextBeginWhereTheirNumbersDo) {
  const std::string bytes = absl::StrCat(
      Head(false), "POINT_DATA 12\nSCALARS rho%20m unsigned_short 1\nLOOKUP_TABLE default\n",
      kTwelve, "CELL_DATA 2\nVECTORS v long\n-1 -2 -3 -4 -5 -6\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const LegacyVtkFile file, Parse(bytes));
  EXPECT_FALSE(file.is_binary);
  EXPECT_FALSE(file.time.has_value());
  EXPECT_EQ(file.grid.dims(), (math::Index3{2, 3, 2}));
  ASSERT_EQ(file.arrays.size(), 2U);
  const LegacyVtkArray& points = file.arrays[0];
  EXPECT_EQ(points.name, "rho m");
  EXPECT_EQ(points.type, ScalarType::kUint16);
  EXPECT_FALSE(points.wide.has_value());
  EXPECT_EQ(points.components, 1);
  EXPECT_EQ(points.tuples, 12);
  EXPECT_FALSE(points.is_of_cells);
  EXPECT_EQ(bytes.substr(static_cast<std::size_t>(points.offset), 5), "0 1 2");
  const LegacyVtkArray& cells = file.arrays[1];
  EXPECT_EQ(cells.type, ScalarType::kFloat64);
  EXPECT_EQ(cells.wide, WideType::kInt64);
  EXPECT_EQ(cells.components, 3);
  EXPECT_EQ(cells.tuples, 2);
  EXPECT_TRUE(cells.is_of_cells);
  EXPECT_EQ(bytes.substr(static_cast<std::size_t>(cells.offset), 5), "-1 -2");
}

TEST_F(LegacyVtkParserTest, BinaryArraysArePassedByTheirSizeWhateverTheyHold) {
  const std::string numbers = "CELL_DATA 1\nCELL_DATA 1\n";  // 24 bytes
  const std::string bytes =
      absl::StrCat(Head(true), "FIELD f 1\nTIME 1 1 double\n", std::string("@\x12\0\0\0\0\0\0", 8),
                   "\nPOINT_DATA 12\nSCALARS a short\nLOOKUP_TABLE default\n", numbers,
                   "\nFIELD f 3\nbits 1 12 bit\nab\ntexts 1 12 string\n", std::string(12, '\xc0'),
                   "\nb 2 12 char\n", numbers, "\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const LegacyVtkFile file, Parse(bytes));
  EXPECT_TRUE(file.is_binary);
  EXPECT_EQ(file.time, 4.5);
  ASSERT_EQ(file.arrays.size(), 2U) << "bits and texts are passed over";
  EXPECT_EQ(file.arrays[0].offset, static_cast<std::int64_t>(bytes.find(numbers)));
  EXPECT_EQ(file.arrays[1].name, "b");
  EXPECT_EQ(file.arrays[1].type, ScalarType::kInt8);
  EXPECT_EQ(file.arrays[1].components, 2);
  EXPECT_EQ(file.arrays[1].offset, static_cast<std::int64_t>(bytes.size() - 25));
}

TEST_F(LegacyVtkParserTest, MetadataBelongsToTheArrayBefore) {
  const std::string bytes = absl::StrCat(
      Head(false), "POINT_DATA 12\nSCALARS a int\nLOOKUP_TABLE default\n", kTwelve,
      "METADATA\nINFORMATION 1\nNAME UNITS_LABEL LOCATION vtkDataArray\nDATA kg/m^3\n\n",
      "CELL_DATA 2\nFIELD f 2\npair 2 2 float\n1 2 3 4\n",
      "METADATA\nCOMPONENT_NAMES\nre\nim%20part\n\nlast 1 2 float\n5 6\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const LegacyVtkFile file, Parse(bytes));
  ASSERT_EQ(file.arrays.size(), 3U);
  EXPECT_EQ(file.arrays[0].unit, "kg/m^3");
  EXPECT_THAT(file.arrays[0].component_names, IsEmpty());
  EXPECT_EQ(file.arrays[1].unit, "");
  EXPECT_THAT(file.arrays[1].component_names, ElementsAre("re", "im part"));
  EXPECT_THAT(file.arrays[2].component_names, IsEmpty());
}

TEST_F(LegacyVtkParserTest, ArraysThatDoNotFitAreRefusedAndNamesMayRepeat) {
  const std::string points = Head(false) + "POINT_DATA 12\n";
  const std::string array = absl::StrCat("SCALARS p int\nLOOKUP_TABLE default\n", kTwelve);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const LegacyVtkFile twice, Parse(points + array + array));
  EXPECT_EQ(twice.arrays.size(), 2U);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const LegacyVtkFile none, Parse(Head(false)));
  EXPECT_THAT(none.arrays, IsEmpty());
  EXPECT_THAT(Parse("text").status(), StatusIs(kInvalid, HasSubstr("no legacy VTK file")));
  EXPECT_THAT(Parse(Head(false) + "POINT_DATA 11\n").status(),
              StatusIs(kInvalid, "arrays of 11 points; DIMENSIONS 2 3 2 have 12"));
  EXPECT_THAT(Parse(absl::StrCat(points, "FIELD f 1\np 1 11 int\n", kTwelve)).status(),
              StatusIs(kInvalid, "array \"p\" has 11 tuples; expected 12, one a sample"));
  EXPECT_THAT(Parse(Head(false) + "FIELD f 1\nTIME 1 1 double\ninf\n").status(),
              StatusIs(kInvalid, "its TIME is no finite number"));
  EXPECT_THAT(Parse(absl::StrCat(points, "SCALARS p real\nLOOKUP_TABLE t\n", kTwelve)).status(),
              StatusIs(kInvalid, HasSubstr("array \"p\" is of type \"real\"")));
}

}  // namespace
}  // namespace isoscope::source
