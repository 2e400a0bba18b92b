#include "core/formats/vtk/vtk_image.h"

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::ValuesOf;
using ::isoscope::testing::VtiBytes;
using ::isoscope::testing::VtiField;
using ::isoscope::testing::VtiImageFile;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

std::vector<float> Ramp(std::size_t count, float first = 0) {
  std::vector<float> values(count);
  for (std::size_t i = 0; i < count; ++i) {
    values[i] = first + static_cast<float>(i);
  }
  return values;
}

class VtkImageTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& bytes) {
    WriteFile(dir_.Sub(name), bytes);
    return dir_.Sub(name);
  }
  std::vector<double> Read(VtkImage& image, std::size_t array, std::int64_t component) {
    auto source = image.Open(array, component);
    EXPECT_TRUE(source.ok()) << source.status();
    if (!source.ok()) {
      return {};
    }
    auto bytes = ReadAll(**source, 1);
    EXPECT_TRUE(bytes.ok()) << bytes.status();
    std::vector<double> values;
    if (bytes.ok()) {
      volume::VisitScalarType((*source)->info().type, [&]<typename T>() {
        const std::vector<T> read = ValuesOf<T>(*bytes);
        values.assign(read.begin(), read.end());
      });
    }
    return values;
  }
  TempDir dir_;
};

// 4 x 3 x 2 points.
VtiImageFile Points() {
  std::vector<float> velocity;
  for (int i = 0; i < 24; ++i) {
    for (int c = 0; c < 3; ++c) {
      velocity.push_back(static_cast<float>(100 * c + i));
    }
  }
  std::vector<std::int64_t> ids(24, 5);
  ids[7] = -3;
  return {
      .extent = "0 3 0 2 0 1",
      .fields = {
          {.name = "p", .type = "Float32", .samples = BytesOf(Ramp(24))},
          {.name = "vtkGhostType", .type = "UInt8", .samples = std::string(24, '\0')},
          {.name = "velocity",
           .type = "Float32",
           .samples = BytesOf(velocity),
           .components = 3,
           .children = "<InformationKey name=\"UNITS_LABEL\" location=\"vtkDataArray\">"
                       " m/s </InformationKey>"},
          {.name = "ids", .type = "Int64", .samples = BytesOf(ids)},
          {.name = "tail", .type = "UInt8", .samples = std::string(6, 'c'), .is_of_cells = true}}};
}

TEST_F(VtkImageTest, AllPointArraysAreFieldsWithComponentsAndUnits) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto image, OpenVtkImage(Write("a.vti", VtiBytes(Points()))));
  ASSERT_EQ(image->arrays().size(), 3u);
  EXPECT_EQ(image->geometry().sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_EQ(image->geometry().origin, (math::Vec3d{10, 20, 30}));
  EXPECT_FALSE(image->time().has_value());
  EXPECT_FALSE(image->component().has_value());
  const SourceField velocity = FieldOfVtiArray(image->arrays()[1]);
  EXPECT_EQ(velocity.name, "velocity");
  EXPECT_EQ(velocity.unit, "m/s");
  EXPECT_EQ(velocity.long_name, "");
  EXPECT_THAT(velocity.components, ElementsAre("x", "y", "z"));
  EXPECT_THAT(FieldOfVtiArray(image->arrays()[0]).components, ElementsAre(""));
  EXPECT_EQ(Read(*image, 0, 0)[23], 23);
  EXPECT_EQ(Read(*image, 1, 0)[5], 5);
  EXPECT_EQ(Read(*image, 1, 2)[23], 223);
  EXPECT_EQ(Read(*image, 2, 0)[7], -3);
}

TEST_F(VtkImageTest, CellArraysAreFieldsIfNoPointArrayIs) {
  VtiImageFile file = Points();
  file.fields.erase(file.fields.begin(), file.fields.end() - 1);
  file.extent = "0 2 0 3 0 2";
  file.fields[0].samples = "abcdefghijkl";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto image, OpenVtkImage(Write("a.vti", VtiBytes(file))));
  EXPECT_EQ(image->geometry().sample_dims, (math::Index3{2, 3, 2}));
  EXPECT_EQ(image->geometry().origin, (math::Vec3d{10.25, 21, 32}));
  EXPECT_EQ(FieldOfVtiArray(image->arrays()[0]).long_name, "tail (of cells, at their centres)");
  EXPECT_EQ(Read(*image, 0, 0)[11], 'l');
}

TEST_F(VtkImageTest, PathMayNameAnArrayOrAComponent) {
  const std::string path = Write("a.vti", VtiBytes(Points()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto array, OpenVtkImage(path, "velocity"));
  ASSERT_EQ(array->arrays().size(), 1u);
  EXPECT_FALSE(array->component().has_value());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto component, OpenVtkImage(path, "velocity:1"));
  ASSERT_EQ(component->arrays().size(), 1u);
  EXPECT_EQ(component->component(), 1);
  EXPECT_THAT(OpenVtkImage(path, "tail"), StatusIs(kInvalid, HasSubstr("centres of its cells")))
      << "one layer of them";
  EXPECT_THAT(OpenVtkImage(path, "velocity:3"), StatusIs(kInvalid, HasSubstr("0 to 2")));
  EXPECT_THAT(OpenVtkImage(path, "q"), StatusIs(absl::StatusCode::kNotFound, HasSubstr("\"p\"")));
}

// The id of a dataset of version 1 holds the name.
TEST_F(VtkImageTest, ANameSaysNoMoreThanThePathWhereThatNamesOneScalar) {
  VtiImageFile one = Points();
  one.fields.erase(one.fields.begin() + 2, one.fields.end());
  Write("one.vti", VtiBytes(one));
  Write("all.vti", VtiBytes(Points()));
  const struct {
    const char* file;
    const char* part;
    std::size_t array;
    std::int64_t component;
    const char* name;
  } cases[] = {{"one.vti", "", 0, 0, "one.vti"},
               {"one.vti", "p", 0, 0, "one.vti:p"},
               {"one.vti", "p:0", 0, 0, "one.vti:p:0"},
               {"all.vti", "", 0, 0, "all.vti:p"},
               {"all.vti", "", 1, 2, "all.vti:velocity:2"},
               {"all.vti", "velocity", 0, 2, "all.vti:velocity:2"},
               {"all.vti", "velocity:2", 0, 2, "all.vti:velocity:2"}};
  for (const auto& c : cases) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto image, OpenVtkImage(dir_.Sub(c.file), c.part));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, image->Open(c.array, c.component));
    EXPECT_EQ(source->info().name, dir_.Sub(c.name)) << c.file << " " << c.part;
  }
}

TEST_F(VtkImageTest, NamesOfComponentsAreTheFilesIfTheyDiffer) {
  VtiArray array{.name = "v", .type = "Int8", .components = 2};
  EXPECT_THAT(FieldOfVtiArray(array).components, ElementsAre("0", "1"));
  array.component_names = {"u", "w"};
  EXPECT_THAT(FieldOfVtiArray(array).components, ElementsAre("u", "w"));
  array.component_names = {"u", "u"};
  EXPECT_THAT(FieldOfVtiArray(array).components, ElementsAre("0", "1"));
  array.component_names = {"u", "magnitude"};
  EXPECT_THAT(FieldOfVtiArray(array).components, ElementsAre("0", "1"));
  array.components = 9;
  array.component_names = {};
  EXPECT_EQ(FieldOfVtiArray(array).components.back(), "8");
}

TEST_F(VtkImageTest, TimeStandsInTheHeaderOrIsAnArray) {
  VtiImageFile file = Points();
  const auto time_of = [&](const std::string& array) -> absl::StatusOr<std::optional<double>> {
    file.field_data = "<FieldData>" + array + "</FieldData>";
    auto image = OpenVtkImage(Write("a.vti", VtiBytes(file)));
    return image.ok() ? absl::StatusOr<std::optional<double>>((*image)->time()) : image.status();
  };
  const std::string head = "<DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" ";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto time,
                                time_of(head + "format=\"ascii\">\n 0.25\n</DataArray>"));
  EXPECT_EQ(time, 0.25);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      time, time_of(head + "format=\"binary\">CAAAAAAAAAAAAAAAAADwPw==</DataArray>"));
  EXPECT_EQ(time, 1.0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      time, time_of("<DataArray type=\"Float64\" Name=\"t\" format=\"ascii\">7</DataArray>"));
  EXPECT_FALSE(time.has_value());
  for (const char* text : {"", "x", "nan", "inf", "1 2"}) {
    EXPECT_THAT(time_of(absl::StrCat(head, "format=\"ascii\">", text, "</DataArray>")),
                StatusIs(kInvalid, HasSubstr("a.vti: its TimeValue is")));
  }
  EXPECT_THAT(time_of(head + "format=\"appended\" offset=\"0\"/>"),
              StatusIs(kInvalid, HasSubstr("TimeValue")));
}

TEST_F(VtkImageTest, InlineArraysBehindOthersAndBehindUnitsAreFound) {
  const std::string text = "BgAAAGFiY2RlZg==";  // 6 bytes: abcdef
  const std::string unit = "<InformationKey name=\"UNITS_LABEL\">K</InformationKey>\n";
  const auto array = [&](const char* name) {
    return absl::StrCat("<DataArray type=\"UInt8\" Name=\"", name, "\" format=\"binary\">\n", unit,
                        text, "\n</DataArray>");
  };
  const std::string path = Write(
      "a.vti", absl::StrCat("<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\">"
                            "<ImageData WholeExtent=\"0 1 0 2 0 1\"><Piece Extent=\"0 1 0 2 0 1\">"
                            "<PointData Scalars=\"a\">",
                            array("a"), array("b"), "</PointData></Piece></ImageData></VTKFile>"));
  EXPECT_THAT(OpenVtkImage(path, "b").value()->Open(0, 0),
              StatusIs(kInvalid, HasSubstr("need 12 bytes, the array says 6")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto image, OpenVtkImage(path));
  ASSERT_EQ(image->arrays().size(), 2u);
  EXPECT_EQ(image->arrays()[1].unit, "K");
}

TEST_F(VtkImageTest, FilesWithoutFieldsAreRefused) {
  VtiImageFile file = Points();
  file.fields = {file.fields[1]};
  EXPECT_THAT(OpenVtkImage(Write("a.vti", VtiBytes(file))), StatusIs(kInvalid, HasSubstr("a.vti")));
  file.fields = {};
  EXPECT_THAT(OpenVtkImage(Write("a.vti", VtiBytes(file))),
              StatusIs(kInvalid, HasSubstr("no ImageData with an array")));
  file = Points();
  file.fields.push_back(file.fields[0]);
  EXPECT_THAT(OpenVtkImage(Write("a.vti", VtiBytes(file))),
              StatusIs(kInvalid, HasSubstr("two arrays are called \"p\"")));
  file = Points();
  file.fields[0].name = "";
  EXPECT_THAT(OpenVtkImage(Write("a.vti", VtiBytes(file))),
              StatusIs(kInvalid, HasSubstr("without a name")));
  EXPECT_THAT(OpenVtkImage(dir_.Sub("none.vti")),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.vti")));
}

// ---- Pieces. ------------------------------------------------------------------------------------

struct PieceOf {
  std::string extent;
  std::string source;
};

std::string PvtiBytes(const std::string& extent, const std::vector<PieceOf>& pieces,
                      bool is_of_cells = false) {
  std::string text =
      absl::StrCat("<VTKFile type=\"PImageData\"><PImageData WholeExtent=\"", extent,
                   "\" GhostLevel=\"0\" Origin=\"10 20 30\" Spacing=\"0.5 2 4\">\n",
                   is_of_cells ? "<PCellData>" : "<PPointData>",
                   "<PDataArray type=\"Float32\" Name=\"p\"/>"
                   "<PDataArray type=\"Int16\" Name=\"v\" NumberOfComponents=\"2\"/>",
                   is_of_cells ? "</PCellData>" : "</PPointData>");
  for (const PieceOf& piece : pieces) {
    absl::StrAppend(&text, "<Piece Extent=\"", piece.extent, "\" Source=\"", piece.source,
                    "\"/>\n");
  }
  return text + "</PImageData></VTKFile>";
}

// p = x + 10 y + 100 z, v = (x, -y), by the index in the whole.
std::string PieceBytes(const std::array<int, 6>& extent, bool is_of_cells = false) {
  const int less = is_of_cells ? 1 : 0;
  std::vector<float> p;
  std::vector<std::int16_t> v;
  for (int z = extent[4]; z <= extent[5] - less; ++z) {
    for (int y = extent[2]; y <= extent[3] - less; ++y) {
      for (int x = extent[0]; x <= extent[1] - less; ++x) {
        p.push_back(static_cast<float>(x + 10 * y + 100 * z));
        v.push_back(static_cast<std::int16_t>(x));
        v.push_back(static_cast<std::int16_t>(-y));
      }
    }
  }
  return VtiBytes(
      {.extent = absl::StrJoin(extent, " "),
       .fields =
           {{.name = "p", .type = "Float32", .samples = BytesOf(p), .is_of_cells = is_of_cells},
            {.name = "v",
             .type = "Int16",
             .samples = BytesOf(v),
             .components = 2,
             .is_of_cells = is_of_cells,
             .more = "ComponentName0=\"east\" ComponentName1=\"south\""}},
       .field_data = "<FieldData><DataArray type=\"Float64\" Name=\"TimeValue\" "
                     "format=\"ascii\">2.5</DataArray></FieldData>"});
}

TEST_F(VtkImageTest, PiecesMakeOneImage) {
  Write("a.vti", PieceBytes({-2, 1, 0, 4, 0, 3}));
  Write("b.vti", PieceBytes({0, 5, 0, 3, 0, 3}));  // one layer more than its piece
  Write("c.vti", PieceBytes({1, 5, 2, 4, 0, 3}));
  const std::string path =
      Write("r.pvti", PvtiBytes("-2 5 0 4 0 3", {{"-2 1 0 4 0 3", "a.vti"},
                                                 {"1 5 0 2 0 3", "b.vti"},
                                                 {"0 -1 0 -1 0 -1", "none.vti"},
                                                 {"1 5 2 4 0 3", "c.vti"}}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto image, OpenVtkImage(path));
  EXPECT_EQ(image->time(), 2.5);
  EXPECT_EQ(image->geometry().sample_dims, (math::Index3{8, 5, 4}));
  EXPECT_EQ(image->geometry().origin, (math::Vec3d{9, 20, 30}));
  EXPECT_THAT(FieldOfVtiArray(image->arrays()[1]).components, ElementsAre("east", "south"));
  std::vector<double> p;
  std::vector<double> south;
  for (int z = 0; z < 4; ++z) {
    for (int y = 0; y < 5; ++y) {
      for (int x = -2; x <= 5; ++x) {
        p.push_back(x + 10 * y + 100 * z);
        south.push_back(-y);
      }
    }
  }
  EXPECT_EQ(Read(*image, 0, 0), p);
  EXPECT_EQ(Read(*image, 1, 1), south);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto component, OpenVtkImage(path, "v:1"));
  EXPECT_EQ(component->component(), 1);
}

TEST_F(VtkImageTest, PiecesOfCells) {
  Write("a.vti", PieceBytes({0, 2, 0, 3, 0, 3}, true));
  Write("b.vti", PieceBytes({2, 3, 0, 3, 0, 3}, true));  // one cell thin
  const std::string path =
      Write("r.pvti",
            PvtiBytes("0 3 0 3 0 3", {{"0 2 0 3 0 3", "a.vti"}, {"2 3 0 3 0 3", "b.vti"}}, true));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto image, OpenVtkImage(path));
  EXPECT_EQ(image->geometry().sample_dims, (math::Index3{3, 3, 3}));
  const std::vector<double> p = Read(*image, 0, 0);
  EXPECT_EQ(p[26], 222);
  EXPECT_EQ(p[2], 2);
}

TEST_F(VtkImageTest, PiecesThatDoNotFitAreNamed) {
  Write("a.vti", PieceBytes({0, 2, 0, 3, 0, 3}));
  Write("b.vti", PieceBytes({2, 4, 0, 3, 0, 3}));
  const auto open = [&](const std::string& extent, const std::vector<PieceOf>& pieces) {
    return OpenVtkImage(Write("r.pvti", PvtiBytes(extent, pieces))).status();
  };
  const PieceOf a{"0 2 0 3 0 3", "a.vti"};
  const PieceOf b{"2 4 0 3 0 3", "b.vti"};
  ISOSCOPE_EXPECT_OK(open("0 4 0 3 0 3", {a, b}));
  EXPECT_THAT(open("0 4 0 3 0 3", {a}),
              StatusIs(kInvalid, AllOf(HasSubstr("r.pvti: none of its 1 pieces has the point"),
                                       HasSubstr("(3, 0, 0)"))));
  EXPECT_THAT(open("0 4 0 3 0 3", {}), StatusIs(kInvalid, HasSubstr("r.pvti")));
  EXPECT_THAT(open("0 3 0 3 0 3", {a, b}), StatusIs(kInvalid, HasSubstr("b.vti")));
  EXPECT_THAT(open("0 4 0 3 0 3", {a, {"1 4 0 3 0 3", "b.vti"}}),
              StatusIs(kInvalid, HasSubstr("piece")));
  EXPECT_THAT(open("0 4 0 3 0 3", {a, {"2 4 0 3 0 3", "none.vti"}}),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.vti")));
  EXPECT_THAT(open("0 4 0 3 0 3", {a, {"2 4", "b.vti"}}), StatusIs(kInvalid, HasSubstr("line")));
  VtiImageFile other = Points();
  other.extent = "2 4 0 3 0 3";
  Write("b.vti", VtiBytes(other));
  EXPECT_THAT(open("0 4 0 3 0 3", {a, b}),
              StatusIs(kInvalid, AllOf(HasSubstr("b.vti: expected a point array \"v\""),
                                       HasSubstr("none of that name"))));
  other.image = "Origin=\"10 20 31\" Spacing=\"0.5 2 4\"";
  Write("b.vti", VtiBytes(other));
  EXPECT_THAT(open("0 4 0 3 0 3", {a, b}), StatusIs(kInvalid, HasSubstr("b.vti: its Origin")));
}

}  // namespace
}  // namespace isoscope::source
