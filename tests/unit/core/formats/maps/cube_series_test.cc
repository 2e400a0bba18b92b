#include "core/formats/maps/cube_series.h"

#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
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

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr char kAtoms[] = " 8 8.0 0.1 0.2 0.3\n 1 1.0 1.1 1.2 1.3\n";

// A grid of 4 x 3 x 2 voxels; `sign` "-" for angstroms.
std::string Head(const std::string& atoms, const std::string& sign = "") {
  return absl::StrCat("title\ncomment\n", atoms, "\n ", sign, "4 0.5 0 0\n ", sign, "3 0 2 0\n ",
                      sign, "2 0 0 4\n");
}

// Value i, of `count` a voxel: i / 8, some with Fortran's exponents.
std::string Numbers(int count) {
  std::string text;
  for (int i = 0; i < 24 * count; ++i) {
    absl::StrAppend(&text, " ", i * 125, i % 2 == 0 ? "E-3" : "D-03", i % 6 == 5 ? "\n" : "");
  }
  return text;
}

class CubeSeriesTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& bytes) {
    testing::WriteFile(dir_.Sub("water.cube"), bytes);
    return dir_.Sub("water.cube");
  }
  testing::TempDir dir_;
};

TEST_F(CubeSeriesTest, SamplesLieWhereTheVectorsPutThem) {
  for (const char* sign : {"", "-"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto series,
        OpenVolumeSeries(Write(absl::StrCat(Head("2 10 20 30", sign), kAtoms, Numbers(1)))));
    EXPECT_EQ(series->info().length_unit, sign[0] == '-' ? "angstrom" : "bohr");
    EXPECT_EQ(series->info().fields[0].name, "water");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
    EXPECT_EQ(volume->info().type, volume::ScalarType::kFloat32);
    EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{2, 3, 4}));
    const auto world = volume->info().geometry.world_from_index();
    EXPECT_EQ(math::TransformPoint(world, {0, 0, 0}), (math::Vec3d{10, 20, 30}));
    EXPECT_EQ(math::TransformPoint(world, {1, 0, 0}), (math::Vec3d{10, 20, 34}));
    EXPECT_EQ(math::TransformPoint(world, {1, 2, 3}), (math::Vec3d{11.5, 24, 34}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
    for (int i = 0; i < 24; ++i) {
      EXPECT_EQ(ValuesOf<float>(read)[static_cast<std::size_t>(i)], static_cast<float>(i) / 8);
    }
  }
}

TEST_F(CubeSeriesTest, OrbitalsAreComponents) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                OpenVolumeSeries(Write(absl::StrCat(Head("-2 10 20 30 1"), kAtoms,
                                                                    " 2 5\n 17\n", Numbers(2)))));
  EXPECT_THAT(series->info().fields[0].components, ElementsAre("5", "17"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, OpenVolumeFile(dir_.Sub("water.cube:water:17")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*second, 1));
  EXPECT_EQ(ValuesOf<float>(read)[2], 5 / 8.0F);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto values,
      OpenVolumeSeries(Write(absl::StrCat(Head("2 10 20 30 2"), kAtoms, Numbers(2)))));
  EXPECT_THAT(values->info().fields[0].components, ElementsAre("0", "1"));
}

TEST_F(CubeSeriesTest, RefusesInASentence) {
  struct Case {
    std::string bytes;
    std::string sentence;
  };
  for (const Case& c :
       {Case{"", "an empty file"}, Case{"a\nb\nLUT_3D_SIZE 32\n", "no Gaussian cube file"},
        Case{"a\nb\n1 0 0 0\n4 0 0 0\n", "4 voxels, 0 apart"},
        Case{"a\nb\n1 0 0 0\n0 1 0 0\n", "0 voxels"},
        Case{"a\nb\n99999999 0 0 0\n", "99999999 atoms"},
        Case{"a\nb\n1 0 0 nan\n", "no Gaussian cube file"},
        Case{testing::Gzip(Head("2 10 20 30")), "in a gzip stream, which is not read"},
        Case{Head("2 0 0 0") + " 8 8.0 0 0 0\n", "within its atoms"},
        Case{Head("-1 0 0 0") + " 8 8.0 0 0 0\n 99999 1\n", "list of orbitals"},
        Case{Head("0 0 0 0") + " 1 2 3", "is cut"},
        Case{"a\nb\n0 0 0 0\n16777216 1 0 0\n16777216 0 1 0\n16777216 0 0 1\n1", "water.cube"}}) {
    SCOPED_TRACE(c.sentence);
    const auto series = OpenVolumeSeries(Write(c.bytes));
    EXPECT_THAT(series.ok() ? (*series)->Open(0, 0, 0).status() : series.status(),
                StatusIs(kInvalid, AllOf(HasSubstr("water.cube"), HasSubstr(c.sentence))));
  }
}

}  // namespace
}  // namespace isoscope::source
