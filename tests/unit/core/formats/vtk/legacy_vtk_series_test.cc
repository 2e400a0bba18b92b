#include "core/formats/vtk/legacy_vtk_series.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/open_volume.h"
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
using ::isoscope::testing::Swapped;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr int kPoints = 24;  // 4 x 3 x 2
constexpr char kGrid[] =
    "DATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 2\nORIGIN 10 20 30\nSPACING 0.5 2 4\n";

std::string Head(bool is_binary, const std::string& grid = kGrid,
                 const std::string& version = "3.0") {
  return absl::StrCat("# vtk DataFile Version ", version, "\na title\n",
                      is_binary ? "BINARY\n" : "ASCII\n", grid);
}

// Sample i, component c: 3 i + 100 c - 20.
template <typename T>
std::vector<T> Values(int count, int components = 1) {
  std::vector<T> values;
  for (int i = 0; i < count; ++i) {
    for (int c = 0; c < components; ++c) {
      values.push_back(static_cast<T>(3 * i + 100 * c - 20));
    }
  }
  return values;
}

// An array's numbers as the file has them.
template <typename T>
std::string Stored(bool is_binary, const std::vector<T>& values) {
  return is_binary
             ? Swapped(BytesOf(values), sizeof(T)) + "\n"
             : absl::StrCat(
                   absl::StrJoin(values, " ",
                                 [](std::string* out, T value) { absl::StrAppend(out, +value); }),
                   "\n");
}

class LegacyVtkSeriesTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& bytes, const std::string& name = "a.vtk") {
    testing::WriteFile(dir_.Sub(name), bytes);
    return dir_.Sub(name);
  }
  absl::Status Error(const std::string& bytes) {
    const auto series = OpenVolumeSeries(Write(bytes, "bad.vtk"));
    if (!series.ok()) {
      return series.status();
    }
    const auto volume = (*series)->Open(0, 0, 0);
    return volume.ok() ? ReadAll(**volume, 1).status() : volume.status();
  }
  testing::TempDir dir_;
};

void ExpectCorner(const VolumeSource& volume, const math::Vec3d& index, const math::Vec3d& world) {
  const math::Vec3d at = math::TransformPoint(volume.info().geometry.world_from_index(), index);
  EXPECT_EQ(at, world) << at.x << " " << at.y << " " << at.z;
}

template <typename T>
void ExpectTypeIsRead(const std::string& path, const char* name, ScalarType type, bool is_binary) {
  SCOPED_TRACE(absl::StrCat(name, is_binary ? " binary" : " text"));
  testing::WriteFile(
      path, absl::StrCat(Head(is_binary), "POINT_DATA 24\nSCALARS p ", name,
                         "\nLOOKUP_TABLE default\n", Stored(is_binary, Values<T>(kPoints))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenVolumeFile(path));
  EXPECT_EQ(volume->info().type, type);
  ExpectCorner(*volume, {0, 0, 0}, {10, 20, 30});
  ExpectCorner(*volume, {3, 2, 1}, {11.5, 24, 34});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
  if (type == ScalarType::kFloat64) {
    EXPECT_EQ(ValuesOf<double>(read), Values<double>(kPoints));
  } else {
    EXPECT_EQ(read, BytesOf(Values<T>(kPoints)));
  }
}

TEST_F(LegacyVtkSeriesTest, EveryTypeAsBytesAndAsText) {
  const std::string path = dir_.Sub("a.vtk");
  for (const bool is_binary : {true, false}) {
    ExpectTypeIsRead<std::int8_t>(path, "char", ScalarType::kInt8, is_binary);
    ExpectTypeIsRead<std::int16_t>(path, "short", ScalarType::kInt16, is_binary);
    ExpectTypeIsRead<std::int32_t>(path, "int", ScalarType::kInt32, is_binary);
    ExpectTypeIsRead<std::int32_t>(path, "vtkIdType", ScalarType::kInt32, is_binary);
    ExpectTypeIsRead<std::int64_t>(path, "long", ScalarType::kFloat64, is_binary);
    ExpectTypeIsRead<std::int64_t>(path, "vtktypeint64", ScalarType::kFloat64, is_binary);
    ExpectTypeIsRead<float>(path, "float", ScalarType::kFloat32, is_binary);
    ExpectTypeIsRead<double>(path, "double", ScalarType::kFloat64, is_binary);
  }
  for (const bool is_binary : {true, false}) {
    const std::vector<std::uint16_t> large(kPoints, 65'000);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto volume, OpenVolumeFile(Write(absl::StrCat(Head(is_binary),
                                                             "POINT_DATA 24\nSCALARS p "
                                                             "unsigned_short\nLOOKUP_TABLE t\n",
                                                             Stored(is_binary, large)))));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
    EXPECT_EQ(ValuesOf<std::uint16_t>(read), large);
  }
}

TEST_F(LegacyVtkSeriesTest, ArraysAreFieldsWithComponents) {
  for (const bool is_binary : {true, false}) {
    SCOPED_TRACE(is_binary);
    const std::string bytes = absl::StrCat(
        Head(is_binary,
             absl::StrCat("DATASET STRUCTURED_POINTS\nFIELD FieldData 2\nTIME 1 1 double\n",
                          Stored(is_binary, std::vector<double>{4.5}), "label 1 1 string\n",
                          is_binary ? "\xc4text\n" : "text\n",
                          "DIMENSIONS 4 3 2\nSPACING 0.5 2 4\nORIGIN 10 20 30\n"),
             "5.1"),
        "CELL_DATA 6\nSCALARS c int 1\nLOOKUP_TABLE default\n",
        Stored(is_binary, Values<std::int32_t>(6)), "POINT_DATA 24\nSCALARS rho%20m short 1\n",
        "LOOKUP_TABLE default\n", Stored(is_binary, Values<std::int16_t>(kPoints)),
        "METADATA\nINFORMATION 1\nNAME UNITS_LABEL LOCATION vtkDataArray\nDATA kg/m^3\n\n",
        "LOOKUP_TABLE table 2\n",
        is_binary ? std::string("\1\2\3\4\5\6\7\x8\n") : "0 0 0 1 1 1 1 1\n", "VECTORS v float\n",
        Stored(is_binary, Values<float>(kPoints, 3)), "FIELD FieldData 2\n", "pair 2 24 double\n",
        Stored(is_binary, Values<double>(kPoints, 2)),
        "METADATA\nCOMPONENT_NAMES\nre\nim%20part\n\nbits 1 24 bit\n",
        is_binary ? "abc\n" : absl::StrJoin(std::vector<int>(24, 1), " "), "\n");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(Write(bytes)));
    EXPECT_THAT(series->info().times, ElementsAre(4.5));
    const std::vector<SourceField>& fields = series->info().fields;
    ASSERT_EQ(fields.size(), 3u);
    EXPECT_EQ(fields[0].name, "rho m");
    EXPECT_EQ(fields[0].unit, "kg/m^3");
    EXPECT_EQ(fields[1].name, "v");
    EXPECT_THAT(fields[1].components, ElementsAre("x", "y", "z"));
    EXPECT_THAT(fields[2].components, ElementsAre("re", "im part"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto v_y, series->Open(1, 1, 0));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*v_y, 1));
    for (int i = 0; i < kPoints; ++i) {
      EXPECT_EQ(ValuesOf<float>(read)[static_cast<std::size_t>(i)], static_cast<float>(3 * i + 80));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pair, OpenVolumeFile(dir_.Sub("a.vtk") + ":pair:1"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string imaginary, ReadAll(*pair, 2));
    EXPECT_EQ(ValuesOf<double>(imaginary)[0], 80);
    EXPECT_THAT(OpenVolumeFile(dir_.Sub("a.vtk")),
                StatusIs(kInvalid, HasSubstr("rho m [kg/m^3], v (x, y, z), pair (re, im part)")));
  }
}

TEST_F(LegacyVtkSeriesTest, CellsAreAtTheirCentres) {
  for (const bool is_binary : {true, false}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto volume,
        OpenVolumeFile(Write(
            absl::StrCat(Head(is_binary,
                              "DATASET STRUCTURED_POINTS\nDIMENSIONS 4 3 3\nASPECT_RATIO 0.5 2 4\n"
                              "ORIGIN 10 20 30\n",
                              "1.0"),
                         "CELL_DATA 12\nSCALARS c int 1\nLOOKUP_TABLE default\n",
                         Stored(is_binary, Values<std::int32_t>(12))),
            "nameless")));
    EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{3, 2, 2}));
    ExpectCorner(*volume, {0, 0, 0}, {10.25, 21, 32});
    ExpectCorner(*volume, {2, 1, 1}, {11.25, 23, 36});
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
    EXPECT_EQ(ValuesOf<std::int32_t>(read), Values<std::int32_t>(12));
  }
}

TEST_F(LegacyVtkSeriesTest, RectilinearGridsAreReadIfTheyAreEvenAndElseResampled) {
  for (const bool is_binary : {true, false}) {
    SCOPED_TRACE(is_binary);
    const auto grid = [&](const std::vector<float>& x) {
      return absl::StrCat(Head(is_binary, "DATASET RECTILINEAR_GRID\nDIMENSIONS 4 3 2\n"),
                          "X_COORDINATES 4 float\n", Stored(is_binary, x),
                          "Y_COORDINATES 3 double\n",
                          Stored(is_binary, std::vector<double>{20, 22, 24}),
                          "Z_COORDINATES 2 float\n", Stored(is_binary, std::vector<float>{30, 34}));
    };
    const std::string points =
        absl::StrCat("POINT_DATA 24\nSCALARS p short 1\n", "LOOKUP_TABLE default\n",
                     Stored(is_binary, Values<std::int16_t>(kPoints)));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto even,
                                  OpenVolumeFile(Write(grid({10, 10.5, 11, 11.5}) + points)));
    ExpectCorner(*even, {0, 0, 0}, {10, 20, 30});
    ExpectCorner(*even, {3, 2, 1}, {11.5, 24, 34});
    EXPECT_EQ(ValuesOf<std::int16_t>(ReadAll(*even, 1).value()), Values<std::int16_t>(kPoints));

    const std::string path = Write(grid({10, 11, 13, 14}) + points);
    EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, AllOf(HasSubstr("axis \"x\" is not even"),
                                                               HasSubstr("--resample"))));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto uneven,
                                  OpenVolumeFile(path, "", {.resamples = true, .fill = -20}));
    EXPECT_EQ(uneven->info().geometry.sample_dims, (math::Index3{5, 3, 2}));
    ExpectCorner(*uneven, {4, 2, 1}, {14, 24, 34});
    const auto read = ValuesOf<float>(ReadAll(*uneven, 2).value());
    EXPECT_TRUE(std::isnan(read[0]));  // the fill value
    EXPECT_EQ(read[1], -17);
    EXPECT_EQ(read[2], -15.5F);
    EXPECT_EQ(read[3], -14);
    EXPECT_EQ(read[4], -11);

    const std::string cells = absl::StrCat("CELL_DATA 6\nSCALARS c int 1\nLOOKUP_TABLE default\n",
                                           Stored(is_binary, Values<std::int32_t>(6)));
    EXPECT_THAT(OpenVolumeFile(Write(grid({10, 11, 13, 14}) + cells)),
                StatusIs(kInvalid, HasSubstr("2 points along z")));
  }
}

TEST_F(LegacyVtkSeriesTest, RefusesInASentence) {
  const std::string points = Head(false) + "POINT_DATA 24\n";
  const std::string scalars =
      "SCALARS p int\nLOOKUP_TABLE default\n" + Stored(false, Values<std::int32_t>(kPoints));
  struct Case {
    std::string bytes;
    std::string sentence;
  };
  for (const Case& c :
       {Case{"text", "no legacy VTK file"},
        Case{"# vtk DataFile Version 3.0\nt\nHEX\n", "HEX"},
        Case{Head(false, "DATASET POLYDATA\n"), "kind POLYDATA; expected STRUCTURED_POINTS"},
        Case{Head(false, "DATASET STRUCTURED_GRID\n"), "Resample To Image"},
        Case{Head(false, "FIELD a 1\n"), "kind FIELD"},
        Case{Head(false, "GRID\n"), "expected DATASET"},
        Case{Head(false), "no array of numbers"},
        Case{Head(false, "DATASET STRUCTURED_POINTS\nPOINT_DATA 24\n"), "no DIMENSIONS"},
        Case{Head(false, "DATASET STRUCTURED_POINTS\nDIMENSIONS 4 3\nORIGIN 0 0 0\n"),
             "DIMENSIONS has \"ORIGIN\""},
        Case{Head(false, "DATASET STRUCTURED_POINTS\nDIMENSIONS 9999999 9999999 9999999\n") +
                 "POINT_DATA 24\n",
             "are more samples than"},
        Case{Head(false) + "POINT_DATA 23\n", "23 points; DIMENSIONS 4 3 2 have 24"},
        Case{Head(false) + "SCALARS p int\n", "expected DIMENSIONS, ORIGIN"},
        Case{points + "SCALARS p quaternion\nLOOKUP_TABLE default\n", "type \"quaternion\""},
        Case{points + "SCALARS p int 9999\nLOOKUP_TABLE default\n", "\"9999\" components"},
        Case{points + "NONSENSE p int\n", "\"NONSENSE\""},
        Case{points + "SCALARS p int\nLOOKUP_TABLE default\n1 2 3\n", "is cut"},
        Case{points + "FIELD f 1\np 1 23 int\n" + Stored(false, Values<std::int32_t>(kPoints)),
             "has 23 tuples; expected 24"},
        Case{points + scalars + scalars, "two arrays are called \"p\""},
        Case{Head(true) + "POINT_DATA 24\nSCALARS p double\nLOOKUP_TABLE default\nab", "is cut"},
        Case{Head(false, "DATASET STRUCTURED_POINTS\nDIMENSIONS 6 4 1\n") + "POINT_DATA 24\n" +
                 scalars,
             "bad.vtk"},
        Case{points + "SCALARS p int\nLOOKUP_TABLE default\n" +
                 Stored(false, std::vector<double>(kPoints, 1.5)),
             "\"1.5\""}}) {
    SCOPED_TRACE(c.sentence);
    EXPECT_THAT(Error(c.bytes),
                StatusIs(kInvalid, AllOf(HasSubstr("bad.vtk"), HasSubstr(c.sentence))));
  }
  const std::string whole = absl::StrCat(Head(true), "POINT_DATA 24\nVECTORS v double\n",
                                         Stored(true, Values<double>(kPoints, 3)));
  for (std::size_t size = 0; size + 1 < whole.size(); size += 3) {
    EXPECT_FALSE(Error(whole.substr(0, size)).ok()) << size;
  }
}

}  // namespace
}  // namespace isoscope::source
