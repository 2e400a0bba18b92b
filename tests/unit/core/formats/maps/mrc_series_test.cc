#include "core/formats/maps/mrc_series.h"

#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
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
#include "tests/unit/core/formats/maps/mrc_bytes.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::BytesOf;
using ::isoscope::testing::Gzip;
using ::isoscope::testing::MrcBytes;
using ::isoscope::testing::MrcWords;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Swapped;
using ::isoscope::testing::ValuesOf;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr int kSamples = 24;  // 4 x 3 x 2

template <typename T>
std::vector<T> Ramp(int count = kSamples) {
  std::vector<T> values;
  for (int i = 0; i < count; ++i) {
    values.push_back(static_cast<T>(3 * i - 20));
  }
  return values;
}

// World position of an index.
math::Vec3d At(const volume::GridGeometry& geometry, const math::Vec3d& index) {
  return math::TransformPoint(geometry.world_from_index(), index);
}

void ExpectNear(const math::Vec3d& a, const math::Vec3d& b) {
  EXPECT_LT(math::Length(a - b), 1e-5) << a.x << " " << a.y << " " << a.z;
}

class MrcSeriesTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& bytes) {
    testing::WriteFile(dir_.Sub(name), bytes);
    return dir_.Sub(name);
  }
  absl::Status Error(const MrcWords& words, const std::string& samples = "") {
    const std::string path = Write("bad.mrc", MrcBytes(words, samples));
    const auto series = OpenVolumeSeries(path);
    return series.ok() ? (*series)->Open(0, 0, 0).status() : series.status();
  }
  testing::TempDir dir_;
};

TEST_F(MrcSeriesTest, EveryModeInBothByteOrdersPlainAndCompressed) {
  struct Case {
    int mode;
    ScalarType type;
    std::size_t stored_size;
    std::string stored;   // little-endian
    std::string samples;  // as they are read
  };
  const std::vector<std::uint16_t> halves(kSamples, 0x3e00);  // 1.5
  const std::vector<Case> cases = {
      {0, ScalarType::kInt8, 1, BytesOf(Ramp<std::int8_t>()), BytesOf(Ramp<std::int8_t>())},
      {1, ScalarType::kInt16, 2, BytesOf(Ramp<std::int16_t>()), BytesOf(Ramp<std::int16_t>())},
      {2, ScalarType::kFloat32, 4, BytesOf(Ramp<float>()), BytesOf(Ramp<float>())},
      {6, ScalarType::kUint16, 2, BytesOf(Ramp<std::uint16_t>()), BytesOf(Ramp<std::uint16_t>())},
      {12, ScalarType::kFloat32, 2, BytesOf(halves), BytesOf(std::vector<float>(kSamples, 1.5F))}};
  for (const Case& c : cases) {
    for (const bool is_big : {false, true}) {
      SCOPED_TRACE(absl::StrCat("mode ", c.mode, is_big ? " big" : " little"));
      const std::string bytes =
          MrcBytes({.mode = c.mode, .extended = "extended header", .is_big_endian = is_big},
                   is_big ? Swapped(c.stored, c.stored_size) : c.stored);
      for (const std::string& path : {Write("map.mrc", bytes), Write("map.map.gz", Gzip(bytes)),
                                      Write("noname", bytes), Write("noname2", Gzip(bytes))}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
        EXPECT_EQ(series->info().length_unit, "angstrom");
        EXPECT_EQ(series->info().step_count(), 1);
        EXPECT_THAT(series->info().fields[0].name, ::testing::AnyOf("map", "noname", "noname2"));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
        EXPECT_EQ(volume->info().type, c.type);
        // Both ends of the grid: ORIGIN (10, 20, 30), cell 8 x 9 x 10 of 4 x 3 x 2 samples.
        ExpectNear(At(volume->info().geometry, {0, 0, 0}), {10, 20, 30});
        ExpectNear(At(volume->info().geometry, {3, 2, 1}), {16, 26, 35});
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
        EXPECT_TRUE(read == c.samples);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto only, OpenVolumeFile(path));
        EXPECT_EQ(only->info().geometry, volume->info().geometry);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
        EXPECT_THAT(files, ElementsAre(path));
      }
    }
  }
}

TEST_F(MrcSeriesTest, AxesFollowTheCell) {
  // Columns along Z, rows along X, sections along Y, as CCP4 often writes.
  MrcWords words{.axes = {3, 1, 2}, .origin = {0, 0, 0}, .start = {5, -2, 7}};
  words.grid = {3, 2, 4};   // along X, Y, Z
  words.cell = {6, 10, 2};  // spacing 2, 5, 0.5
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto volume, OpenVolumeFile(Write("a.ccp4", MrcBytes(words, BytesOf(Ramp<float>())))));
  const volume::GridGeometry& geometry = volume->info().geometry;
  EXPECT_EQ(geometry.sample_dims, (math::Index3{4, 3, 2}));
  ExpectNear(At(geometry, {0, 0, 0}), {-2 * 2.0, 7 * 5.0, 5 * 0.5});
  ExpectNear(At(geometry, {1, 0, 0}), {-4, 35, 3});
  ExpectNear(At(geometry, {3, 2, 1}), {-4 + 2 * 2.0, 35 + 5, 2.5 + 3 * 0.5});
}

TEST_F(MrcSeriesTest, CellAnglesTiltTheGrid) {
  MrcWords words{.origin = {0, 0, 0}};
  words.angles = {90, 90, 120};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto volume, OpenVolumeFile(Write("a.map", MrcBytes(words, BytesOf(Ramp<float>())))));
  ExpectNear(At(volume->info().geometry, {1, 0, 0}), {2, 0, 0});
  ExpectNear(At(volume->info().geometry, {0, 1, 0}), {3 * -0.5, 3 * std::sqrt(0.75), 0});
  ExpectNear(At(volume->info().geometry, {0, 0, 1}), {0, 0, 5});
}

TEST_F(MrcSeriesTest, ReadsWhatProgramsLeaveOut) {
  struct Case {
    std::string what;
    MrcWords words;
    math::Vec3d last;
  };
  MrcWords no_cell{.cell = {0, 0, 0}, .angles = {0, 0, 0}, .axes = {0, 0, 0}};
  MrcWords no_grid;
  no_grid.grid = {0, 0, 0};
  MrcWords wrong_stamp;
  wrong_stamp.stamp = 0x1111;
  for (const Case& c :
       {Case{"no cell", no_cell, {13, 22, 31}}, Case{"no grid", no_grid, {16, 26, 35}},
        Case{"a stamp of the other order", wrong_stamp, {16, 26, 35}}}) {
    SCOPED_TRACE(c.what);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto series,
        OpenVolumeSeries(Write("a.mrc", MrcBytes(c.words, BytesOf(Ramp<float>())))));
    EXPECT_EQ(series->info().length_unit, c.what == "no cell" ? "" : "angstrom");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, 0));
    ExpectNear(At(volume->info().geometry, {3, 2, 1}), c.last);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 2));
    EXPECT_EQ(ValuesOf<float>(read), Ramp<float>());
  }
}

TEST_F(MrcSeriesTest, BytesOfImodAreUnsignedUnlessItsFlagsSayOtherwise) {
  const std::string samples(kSamples, '\xc8');
  for (const bool is_signed : {false, true}) {
    MrcWords words{.mode = 0};
    words.imod_flags = is_signed ? 5 : 4;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume,
                                  OpenVolumeFile(Write("a.mrc", MrcBytes(words, samples))));
    EXPECT_EQ(volume->info().type, is_signed ? ScalarType::kInt8 : ScalarType::kUint8);
  }
}

TEST_F(MrcSeriesTest, VolumesOfAStackAreSteps) {
  MrcWords words{.dims = {4, 3, 6}, .space_group = 401};
  const std::vector<float> all = Ramp<float>(3 * kSamples);
  const std::string path = Write("stack.mrcs", MrcBytes(words, BytesOf(all)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path));
  EXPECT_THAT(series->info().times, ElementsAre(0, 1, 2));
  for (int step = 0; step < 3; ++step) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, series->Open(0, 0, step));
    EXPECT_EQ(volume->info().geometry.sample_dims, (math::Index3{4, 3, 2}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*volume, 1));
    EXPECT_EQ(ValuesOf<float>(read), std::vector<float>(all.begin() + step * kSamples,
                                                        all.begin() + (step + 1) * kSamples));
  }
  EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, HasSubstr("steps: 3, from 0 to 2")));
}

TEST_F(MrcSeriesTest, RefusesInASentence) {
  struct Case {
    MrcWords words;
    std::string sentence;
  };
  MrcWords flat;
  flat.angles = {10, 10, 179};
  MrcWords half_cell;
  half_cell.cell = {8, 0, 10};
  MrcWords negative;
  negative.extended_bytes = -5;
  MrcWords huge;
  huge.extended_bytes = 0x7fffffff;
  for (const Case& c :
       {Case{{.mode = 3}, "complex numbers"}, Case{{.mode = 4}, "complex numbers"},
        Case{{.mode = 101}, "4 bits"}, Case{{.mode = 7}, "mode 7"},
        Case{{.axes = {1, 1, 3}}, "MAPC, MAPR and MAPS are 1, 1 and 3"}, Case{flat, "no cell"},
        Case{half_cell, "cell of 8 x 0 x 10"}, Case{negative, "extended header of -5"},
        Case{huge, "2147484767 bytes"}, Case{{.dims = {0, 3, 2}}, "no MRC file"},
        Case{{.dims = {4, 3, 5}, .space_group = 401}, "of 2 sections each, with 5"},
        Case{{.dims = {4, 3, 1}}, "4 x 3 x 1"},
        Case{{.dims = {1 << 24, 1 << 24, 1 << 14}}, "bad.mrc"}}) {
    SCOPED_TRACE(c.sentence);
    EXPECT_THAT(Error(c.words, BytesOf(Ramp<float>())),
                StatusIs(kInvalid, AllOf(HasSubstr("bad.mrc"), HasSubstr(c.sentence))));
  }
  const std::string whole = MrcBytes({}, BytesOf(Ramp<float>()));
  for (std::size_t size = 0; size < whole.size(); size += size < 1020 ? 97 : 1) {
    const auto series = OpenVolumeSeries(Write("cut.mrc", whole.substr(0, size)));
    EXPECT_FALSE(series.ok() && (*series)->Open(0, 0, 0).ok()) << size;
  }
}

}  // namespace
}  // namespace isoscope::source
