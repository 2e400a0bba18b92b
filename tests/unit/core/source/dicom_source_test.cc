#include "core/source/dicom_source.h"

#include <filesystem>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/dicom_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::DicomBytes;
using ::isoscope::testing::DicomSlice;
using ::isoscope::testing::Noise;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::_;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr std::size_t kSliceBytes = 12 * 9 * 2;

class DicomSourceTest : public ::testing::Test {
 protected:
  // Slice `z` of samples_ as a file whose name says nothing of its place.
  std::string Path(int z) const { return dir_.Sub(absl::StrCat("im", z * 7 % 5, ".x")); }
  void Write(int z, DicomSlice slice) const {
    slice.number = 5 - z;
    WriteFile(Path(z), DicomBytes(slice, samples_.substr(static_cast<std::size_t>(z) * kSliceBytes,
                                                         kSliceBytes)));
  }
  // Five slices 1.5 apart.
  void WriteSeries() const {
    for (int z = 0; z < 5; ++z) {
      Write(z, {.position = absl::StrCat("10\\20\\", 30 + 1.5 * z)});
    }
  }

  TempDir dir_;
  const std::string samples_ = Noise({12, 9, 5}, ScalarType::kInt16);
};

TEST_F(DicomSourceTest, SeriesIsStackedByPositionFromItsFolderAndFromAFile) {
  WriteSeries();
  WriteFile(dir_.Sub("readme.txt"), "no slice");
  for (const std::string& path : {dir_.path(), Path(3)}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
    EXPECT_EQ(source->geometry().sample_dims, (math::Index3{12, 9, 5}));
    EXPECT_EQ(source->geometry().spacing, (math::Vec3d{0.5, 2, 1.5}));
    EXPECT_EQ(source->geometry().origin, (math::Vec3d{10, 20, 30}));
    EXPECT_EQ(source->scalar_type(), ScalarType::kInt16);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 2));
    EXPECT_TRUE(read == samples_);
  }
}

TEST_F(DicomSourceTest, ObliqueSeriesKeepsItsOrientation) {
  // Rows along y, columns along z: the normal is x.
  for (int z = 0; z < 5; ++z) {
    Write(z, {.position = absl::StrCat(10 + 3 * z, "\\20\\30"), .orientation = "0\\1\\0\\0\\0\\1"});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.path()));
  EXPECT_EQ(source->geometry().direction.columns[0], (math::Vec3d{0, 1, 0}));
  EXPECT_EQ(source->geometry().direction.columns[1], (math::Vec3d{0, 0, 1}));
  EXPECT_EQ(source->geometry().direction.columns[2], (math::Vec3d{1, 0, 0}));
  EXPECT_DOUBLE_EQ(source->geometry().spacing.z, 3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 5));
  EXPECT_TRUE(read == samples_);
}

TEST_F(DicomSourceTest, MissingDoubledTiltedAndMixedSlicesAreRefused) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  WriteSeries();
  std::filesystem::remove(Path(2));
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(kInvalid, HasSubstr("one is missing, or there twice")));
  Write(2, {.position = "10\\20\\31.5"});
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(), StatusIs(kInvalid, HasSubstr("there twice")));
  Write(2, {.position = "11\\20\\33"});
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(), StatusIs(kInvalid, HasSubstr("gantry")));
  Write(2, {.width = 9, .height = 12, .position = "10\\20\\33"});
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(), StatusIs(kInvalid, HasSubstr("size and type")));
  Write(2, {.position = "10\\20\\33", .is_signed = false});
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(), StatusIs(kInvalid, HasSubstr("uint16")));
}

TEST_F(DicomSourceTest, FolderOfTwoSeriesAsksForAFileOfOne) {
  WriteSeries();
  for (int z = 0; z < 2; ++z) {
    DicomSlice other{.series = "1.2.77", .position = absl::StrCat("0\\0\\", z), .number = 9 + z};
    WriteFile(dir_.Sub(absl::StrCat("other", z, ".dcm")),
              DicomBytes(other, std::string(kSliceBytes, 'o')));
  }
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("2 series")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto first, OpenVolumeFile(Path(0)));
  EXPECT_EQ(first->geometry().sample_dims.z, 5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, OpenVolumeFile(dir_.Sub("other1.dcm")));
  EXPECT_EQ(second->geometry().sample_dims.z, 2);
}

TEST_F(DicomSourceTest, NoSeriesAndCutSlicesAreErrors) {
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("DICOM")));
  WriteFile(dir_.Sub("a.dcm"), "no DICOM");
  EXPECT_FALSE(OpenVolumeFile(dir_.Sub("a.dcm")).ok());
  WriteSeries();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(Path(0)));
  const std::string whole = testing::ReadFile(Path(4));
  for (std::size_t size = 0; size < whole.size(); size += size < 500 ? 1 : 50) {
    WriteFile(Path(4), whole.substr(0, size));
    EXPECT_FALSE(ReadAll(*source, 5).ok()) << size;
    if (size > 132) {  // before, it is no DICOM file to anybody
      EXPECT_FALSE(OpenVolumeFile(dir_.path()).ok()) << size;
    }
  }
}

}  // namespace
}  // namespace isoscope::source
