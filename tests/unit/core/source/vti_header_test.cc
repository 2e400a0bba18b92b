#include "core/source/vti_header.h"

#include <memory>
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
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

std::string Array(const std::string& name, const std::string& type = "Float32",
                  const std::string& more = "", const std::string& text = "") {
  return absl::StrCat("<DataArray Name=\"", name, "\" type=\"", type, "\" ",
                      text.empty() ? "format=\"appended\" offset=\"0\" " : "format=\"binary\" ",
                      more, ">", text, "</DataArray>\n");
}
constexpr char kThree[] = "NumberOfComponents=\"3\"";

std::string File(const std::string& points, const std::string& cells = "",
                 const std::string& point_attributes = "",
                 const std::string& cell_attributes = "") {
  return absl::StrCat(
      "<VTKFile type=\"ImageData\" byte_order=\"BigEndian\" header_type=\"UInt64\">\n"
      "<ImageData WholeExtent=\"2 5 -1 3 0 2\" Origin=\"10 20 30\" Spacing=\"0.5 2 4\" "
      "Direction=\"0 -1 0 1 0 0 0 0 1\">\n<Piece Extent=\"2 5 -1 3 0 2\">\n<PointData ",
      point_attributes, ">", points, "</PointData>\n<CellData ", cell_attributes, ">", cells,
      "</CellData></Piece></ImageData>\n<AppendedData encoding=\"raw\">\n_\1\2<&");
}

class VtiHeaderTest : public ::testing::Test {
 protected:
  absl::StatusOr<VtiHeader> Read(const std::string& bytes, const std::string& part = "") {
    WriteFile(dir_.Sub("v.vti"), bytes);
    const auto file = io::OpenRandomAccessFile(dir_.Sub("v.vti"));
    return file.ok() ? ReadVtiHeader(**file, part) : file.status();
  }
  absl::StatusOr<VtiChoice> Choose(const std::string& bytes, const std::string& part = "") {
    const auto header = Read(bytes, part);
    return header.ok() ? ChooseVtiArray(*header, part, "v.vti") : header.status();
  }
  // "p:name:component" or "c:name:component".
  std::string Chosen(const std::string& bytes, const std::string& part = "") {
    const auto choice = Choose(bytes, part);
    return choice.ok() ? absl::StrCat(choice->array.is_of_cells ? "c:" : "p:", choice->array.name,
                                      ":", choice->component)
                       : choice.status().ToString();
  }
  TempDir dir_;
};

TEST_F(VtiHeaderTest, AllThatTheTagsSayIsKept) {
  const std::string bytes = File(Array("v", "Int16", kThree, "AAAA") + Array("p"),
                                 Array("c", "UInt8"), "Scalars=\"s\"", "Scalars=\"t\"");
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

TEST_F(VtiHeaderTest, DefaultIsOneComponentPointsBeforeCellsScalarsBeforeOthers) {
  const std::string v3 = Array("v3", "Float32", kThree);
  EXPECT_EQ(Chosen(File(Array("a") + Array("b"))), "p:a:0");
  EXPECT_EQ(Chosen(File(Array("a") + Array("b"), "", "Scalars=\"b\"")), "p:b:0");
  EXPECT_EQ(Chosen(File(v3 + Array("b"), "", "Scalars=\"v3\"")), "p:b:0");
  EXPECT_EQ(Chosen(File("", Array("c") + Array("d"))), "c:c:0");
  EXPECT_EQ(Chosen(File("", Array("c") + Array("d"), "", "Scalars=\"d\"")), "c:d:0");
  EXPECT_EQ(Chosen(File(Array("a"), Array("c"))), "p:a:0");
  EXPECT_EQ(Chosen(File(v3, Array("c"), "Vectors=\"v3\"")), "c:c:0");
  EXPECT_EQ(Chosen(File(Array("vtkGhostType", "UInt8") + Array("ids", "Int64") + Array("b"))),
            "p:b:0");
  EXPECT_EQ(Chosen(File(Array("ids", "Int64"))), "p:ids:0") << "refused by its type later";
}

TEST_F(VtiHeaderTest, NameChoosesAnArrayAndANumberAComponent) {
  const std::string bytes = File(Array("a") + Array("v", "Float32", kThree) + Array("v:1"),
                                 Array("a") + Array("c") + Array("w", "Float32", kThree));
  EXPECT_EQ(Chosen(bytes, "a"), "p:a:0");
  EXPECT_EQ(Chosen(bytes, "a:0"), "p:a:0");
  EXPECT_EQ(Chosen(bytes, "c"), "c:c:0");
  EXPECT_EQ(Chosen(bytes, "v:0"), "p:v:0");
  EXPECT_EQ(Chosen(bytes, "v:2"), "p:v:2");
  EXPECT_EQ(Chosen(bytes, "v:1"), "p:v:1:0") << "an array of that very name";
  EXPECT_EQ(Chosen(bytes, "w:1"), "c:w:1");
}

TEST_F(VtiHeaderTest, ErrorsListTheArraysAndTheArgumentToGive) {
  const std::string vectors =
      File(Array("v", "Float32", kThree), Array("t", "Float32", "NumberOfComponents=\"9\""));
  const auto names_both = AllOf(HasSubstr("point array \"v\" of 3 components"),
                                HasSubstr("cell array \"t\" of 9 components"));
  EXPECT_THAT(Choose(vectors).status(),
              StatusIs(kInvalid, AllOf(HasSubstr("v.vti:v:0"), names_both)));
  EXPECT_THAT(Choose(vectors, "t").status(),
              StatusIs(kInvalid, AllOf(HasSubstr("0 to 8, as in v.vti:t:0"), names_both)));
  for (const char* part : {"v:3", "v:-1"}) {
    EXPECT_THAT(Choose(vectors, part).status(),
                StatusIs(kInvalid, AllOf(HasSubstr("0 to 2, as in v.vti:v:0"), names_both)));
  }
  for (const char* part : {"x", "x:0", "v:", "v:x", ":0"}) {
    EXPECT_THAT(Choose(vectors, part).status(),
                StatusIs(absl::StatusCode::kNotFound,
                         AllOf(HasSubstr(absl::StrCat("no array \"", part, "\"")), names_both)));
  }
  EXPECT_THAT(Choose(File("")).status(), StatusIs(kInvalid, HasSubstr("PointData or CellData")));
}

TEST_F(VtiHeaderTest, CellsLieHalfASpacingFurtherAndAreOneLess) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VtiHeader header, Read(File(Array("a"))));
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

TEST_F(VtiHeaderTest, FlatGridHasNoVolumeOfCells) {
  std::string bytes = File(Array("a"));
  for (std::size_t at = 0; (at = bytes.find("0 2\"", at)) != std::string::npos; ++at) {
    bytes.replace(at, 4, "0 1\"");
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const VtiHeader header, Read(bytes));
  ISOSCOPE_EXPECT_OK(VtiGeometry(header, false, "v.vti").status());
  EXPECT_THAT(VtiGeometry(header, true, "v.vti").status(),
              StatusIs(kInvalid, HasSubstr("centres of its cells")));
}

TEST_F(VtiHeaderTest, LongTextIsPassedAndLongTagsAreNot) {
  // 3 MiB of inline data in one line, before the requested array.
  const std::string text(3 << 20, 'A');
  const std::string bytes = File(Array("a", "Float32", kThree, text) + Array("b"));
  EXPECT_EQ(Chosen(bytes), "p:b:0");
  // Reading ends at the array that is certain to be chosen; the rest is not read.
  EXPECT_EQ(Chosen(File(Array("a", "Float32", "", "AAAA") + text + "<no XML"), "a"), "p:a:0");
  EXPECT_THAT(Read("<VTKFile a=\"" + text + "\">").status(),
              StatusIs(kInvalid, HasSubstr("a tag of more than")));
  EXPECT_THAT(Read(File(Array(std::string(5000, 'n')))).status(),
              StatusIs(kInvalid, HasSubstr("name of more than")));
  std::string many;
  for (int i = 0; i < 5000; ++i) {
    many += Array("v", "Float32", kThree);
  }
  EXPECT_THAT(Read(File(many)).status(), StatusIs(kInvalid, HasSubstr("more than 4096 arrays")));
  for (const char* count : {"0", "-1", "x", "99999999999999999999", "5000"}) {
    EXPECT_THAT(
        Read(File(Array("v", "Int8", absl::StrCat("NumberOfComponents=\"", count, "\"")))).status(),
        StatusIs(kInvalid, HasSubstr(absl::StrCat("array \"v\" of ", count, " components"))));
  }
}

TEST_F(VtiHeaderTest, TypesAreVtksNames) {
  VtiArray array;
  array.name = "a";
  array.type = "UInt16";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::ScalarType type, VtiTypeOf(array, "v.vti"));
  EXPECT_EQ(type, volume::ScalarType::kUint16);
  array.type = "Int64";
  EXPECT_THAT(VtiTypeOf(array, "v.vti").status(), StatusIs(kInvalid, HasSubstr("\"Int64\"")));
}

}  // namespace
}  // namespace isoscope::source
