// VTK RectilinearGrid files: arrays of points and of cells in each format, their world positions,
// uneven axes, and what is refused.

#include "core/formats/vtk/vtr_image.h"

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
enum class Format { kAscii, kBinary, kAppended };

std::vector<double> Counted(int count, double first) {
  std::vector<double> values;
  for (int i = 0; i < count; ++i) {
    values.push_back(first + i);
  }
  return values;
}

struct Vtr {
  Format format = Format::kAscii;
  std::vector<double> x{1, 1.5, 2, 2.5};
  std::vector<double> y{10, 8, 6};
  std::vector<double> z{0, 3};
  std::string more_points{};  // tags
  bool has_points = true;
};

// 4 x 3 x 2 points from the index (2, 0, 5) on: "p" counts from 0, "v" has three components; cells
// have "c".
std::string VtrBytes(const Vtr& vtr) {
  std::string appended;
  const auto array = [&](const char* name, const std::vector<double>& values,
                         const char* more = "") {
    const std::string numbers = BytesOf(values);
    std::string bytes;
    base::AppendLittleEndian(static_cast<std::uint32_t>(numbers.size()), &bytes);
    bytes += numbers;
    const std::size_t offset = appended.size();
    if (vtr.format == Format::kAppended) {
      appended += bytes;
    }
    return absl::StrCat("<DataArray type=\"Float64\" Name=\"", name, "\" ", more, " format=\"",
                        vtr.format == Format::kAscii ? "ascii\">"
                        : vtr.format == Format::kBinary
                            ? "binary\">\n  "
                            : absl::StrCat("appended\" offset=\"", offset, "\">"),
                        vtr.format == Format::kAscii    ? absl::StrJoin(values, " ")
                        : vtr.format == Format::kBinary ? absl::Base64Escape(bytes)
                                                        : "",
                        "</DataArray>\n");
  };
  const std::string points =
      vtr.has_points
          ? array("p", Counted(24, 0)) + array("v", Counted(72, 100), "NumberOfComponents=\"3\"")
          : "";
  const std::string cells = array("c", Counted(6, 50));
  const std::string coordinates = array("x", vtr.x) + array("y", vtr.y) + array("z", vtr.z);
  return absl::StrCat(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"RectilinearGrid\" byte_order=\"LittleEndian\">\n"
      "<RectilinearGrid WholeExtent=\"2 5 0 2 5 6\">\n<FieldData><DataArray type=\"Float64\" "
      "Name=\"TimeValue\" NumberOfTuples=\"1\" format=\"ascii\">2.5</DataArray></FieldData>\n"
      "<Piece Extent=\"2 5 0 2 5 6\">\n<PointData>\n",
      points, vtr.more_points, "</PointData>\n<CellData>", cells, "</CellData>\n<Coordinates>",
      coordinates, "</Coordinates>\n</Piece>\n</RectilinearGrid>\n",
      appended.empty()
          ? ""
          : absl::StrCat("<AppendedData encoding=\"raw\">_", appended, "</AppendedData>"),
      "</VTKFile>\n");
}

class VtrImageTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("a.vtr"), bytes);
    return dir_.Sub("a.vtr");
  }
  static std::vector<double> Values(VolumeSource& source) {
    const auto bytes = ReadAll(source, 1);
    EXPECT_TRUE(bytes.ok()) << bytes.status();
    return bytes.ok() ? ValuesOf<double>(*bytes) : std::vector<double>();
  }
  testing::TempDir dir_;
};

TEST_F(VtrImageTest, PointsLieAtTheirCoordinatesInEachFormat) {
  for (const Format format : {Format::kAscii, Format::kBinary, Format::kAppended}) {
    SCOPED_TRACE(static_cast<int>(format));
    const std::string path = Write(VtrBytes({.format = format}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
    ASSERT_EQ(series->info().fields.size(), 2u);
    EXPECT_EQ(series->info().fields[0].name, "p");
    EXPECT_EQ(series->info().fields[1].components, (std::vector<std::string>{"x", "y", "z"}));
    EXPECT_THAT(series->info().times, ElementsAre(2.5));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto p, series->Open(0, 0, 0));
    EXPECT_EQ(p->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
    const math::Mat4d to_world = p->info().geometry.world_from_index();
    EXPECT_EQ(math::TransformPoint(to_world, {0, 0, 0}), (math::Vec3d{1, 10, 0}));
    EXPECT_EQ(math::TransformPoint(to_world, {3, 2, 1}), (math::Vec3d{2.5, 6, 3}));
    EXPECT_EQ(Values(*p), Counted(24, 0));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto v, OpenVolumeFile(path + ":v:z"));
    EXPECT_EQ(Values(*v)[1], 105);
    EXPECT_EQ(Values(*v)[23], 171);
  }
}

// VTK 9 writes such keys of vectors behind the samples, others before.
TEST_F(VtrImageTest, KeysMayStandBehindTheSamplesOrBefore) {
  const std::string key =
      "<InformationKey name=\"L2_NORM_RANGE\" location=\"vtkDataArray\" length=\"1\"><Value "
      "index=\"0\">2.5</Value></InformationKey>\n";
  for (const Format format : {Format::kAscii, Format::kBinary}) {
    const std::string whole = VtrBytes({.format = format});
    for (const std::string& bytes :
         {absl::StrReplaceAll(whole, {{"</DataArray>", "\n" + key + key + "</DataArray>"}}),
          absl::StrReplaceAll(whole, {{"format=\"ascii\">", "format=\"ascii\">\n" + key},
                                      {"format=\"binary\">", "format=\"binary\">\n" + key}})}) {
      const std::string path = Write(bytes);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto p, OpenVolumeFile(path + ":p"));
      EXPECT_EQ(p->info().geometry.origin, (math::Vec3d{1, 10, 0}));
      EXPECT_EQ(Values(*p), Counted(24, 0));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto v, OpenVolumeFile(path + ":v:0"));
      EXPECT_EQ(Values(*v)[23], 169);
    }
  }
}

TEST_F(VtrImageTest, CellsLieBetweenThePoints) {
  const std::string path =
      Write(VtrBytes({.x = {1, 1.5, 2, 2.5}, .z = {0, 1, 2}, .has_points = false}));
  // One layer more of cells than the extent has.
  EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, HasSubstr("needs 2 samples")));
  std::string bytes =
      absl::StrReplaceAll(VtrBytes({.z = {0, 1, 2}, .has_points = false}),
                          {{"2 5 0 2 5 6", "2 5 0 2 5 7"},
                           {"50 51 52 53 54 55", "50 51 52 53 54 55 56 57 58 59 60 61"}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto cells, OpenVolumeFile(Write(bytes)));
  EXPECT_EQ(cells->info().geometry.sample_dims, (math::Index3{3, 2, 2}));
  EXPECT_EQ(cells->info().geometry.origin, (math::Vec3d{1.25, 9, 0.5}));
  EXPECT_EQ(Values(*cells), Counted(12, 50));
}

TEST_F(VtrImageTest, UnevenAxesAreRefusedOrResampled) {
  const std::string path = Write(VtrBytes({.x = {0, 1, 2, 4}}));
  EXPECT_THAT(OpenVolumeFile(path + ":p"), StatusIs(kInvalid, HasSubstr("axis \"x\" is not even")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto p, OpenVolumeFile(path + ":p", "", {.resamples = true}));
  EXPECT_EQ(p->info().geometry.sample_dims, (math::Index3{5, 3, 2}));
  const std::vector<double> values = Values(*p);
  EXPECT_THAT(std::vector<double>(values.begin(), values.begin() + 5),
              ElementsAre(0, 1, 2, 2.5, 3));
}

TEST_F(VtrImageTest, WhatIsNoGridIsRefusedWithASentence) {
  const std::string whole = VtrBytes({});
  const auto expect = [&](const std::string& from, const std::string& to, const char* what) {
    std::string bytes = whole;
    const std::size_t at = bytes.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    bytes.replace(at, from.size(), to);
    EXPECT_THAT(OpenVolumeSeries(Write(bytes)), StatusIs(kInvalid, HasSubstr(what))) << from;
  };
  expect("1 1.5 2 2.5", "1 1.5 2", "3 numbers; expected 4");
  expect("1 1.5 2 2.5", "1 1.5 b 2.5", "number 2 is \"b\"");
  expect("10 8 6", "10 12 6", "axis \"y\" has the coordinate 6 behind 12");
  expect("<Piece Extent=\"2 5", "<Piece Extent=\"2 4", "expected all of it in one piece");
  expect("Name=\"z\" ", "/><DataArray type=\"Float64\" ", "more than three arrays");
  expect("<Coordinates>", "<Coordinate>", "line");
  expect("format=\"ascii\">0 3", "format=\"hex\">0 3", "data format \"hex\"");
  const std::string image =
      testing::VtiBytes({.extent = "0 1 0 1 0 1", .fields = {{"p", "UInt8", std::string(8, 'a')}}});
  EXPECT_THAT(OpenVolumeFile(Write(image)), StatusIs(kInvalid, HasSubstr("end in .vti")));
  testing::WriteFile(dir_.Sub("b.vti"), whole);
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("b.vti") + ":p"),
              StatusIs(kInvalid, HasSubstr("end in .vtr")));
  for (std::size_t size = 0; size < whole.size(); size += 37) {
    EXPECT_FALSE(OpenVolumeSeries(Write(whole.substr(0, size))).ok()) << size;
  }
}

}  // namespace
}  // namespace isoscope::source
