// Series of five small slices, written by the helpers of tests/support:
//
// - stacking by position, oblique orientations, the choice of a series;
// - wrong series: missing, doubled, tilted, mixed or cut slices;
// - privacy: no field of a patient is printed;
// - files that end the library's process, which is then replaced.

#include "core/formats/dicom/dicom_source.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/wait.h>

#include "core/formats/dicom/dicom_module.h"
#include "tests/support/dicom_file.h"
#include "tests/support/only_volume.h"
#include "tests/support/skips.h"
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
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using volume::ScalarType;

constexpr std::size_t kSliceBytes = 12 * 9 * 2;

class DicomSourceTest : public ::testing::Test {
 protected:
  // The path of slice `z` of samples_. The name does not tell the position.
  std::string Path(int z) const { return dir_.Sub(absl::StrCat("im", z * 7 % 5, ".x")); }
  void Write(int z, DicomSlice slice) const {
    slice.number = 5 - z;
    WriteFile(Path(z), DicomBytes(slice, samples_.substr(static_cast<std::size_t>(z) * kSliceBytes,
                                                         kSliceBytes)));
  }
  // Five slices 1.5 apart.
  void WriteSeries(const std::string& transfer_syntax = DicomSlice().transfer_syntax) const {
    for (int z = 0; z < 5; ++z) {
      Write(z, {.position = absl::StrCat("10\\20\\", 30 + 1.5 * z),
                .transfer_syntax = transfer_syntax});
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
    EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{12, 9, 5}));
    EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.5, 2, 1.5}));
    EXPECT_EQ(source->info().geometry.origin, (math::Vec3d{10, 20, 30}));
    EXPECT_EQ(source->info().type, ScalarType::kInt16);
    EXPECT_EQ(source->info().patient_frame, volume::PatientFrame()) << "LPS";
    EXPECT_EQ(source->info().memory_bytes, kDicomModuleBytes + 2 * 12 * 9 * 2) << "and two slices";
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
  EXPECT_EQ(source->info().geometry.direction.columns[0], (math::Vec3d{0, 1, 0}));
  EXPECT_EQ(source->info().geometry.direction.columns[1], (math::Vec3d{0, 0, 1}));
  EXPECT_EQ(source->info().geometry.direction.columns[2], (math::Vec3d{1, 0, 0}));
  EXPECT_DOUBLE_EQ(source->info().geometry.spacing.z, 3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 5));
  EXPECT_TRUE(read == samples_);
}

TEST_F(DicomSourceTest, MissingDoubledTiltedAndMixedSlicesAreRefused) {
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  WriteSeries();
  std::filesystem::remove(Path(2));
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(kInvalid, HasSubstr("1 slice is missing between them")));
  Write(2, {.position = "10\\20\\31.5"});
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(), StatusIs(kInvalid, HasSubstr("there twice")));
  Write(2, {.position = "11\\20\\33"});
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(kInvalid, HasSubstr("begins 1 beside the line")));
  Write(2, {.width = 9, .height = 12, .position = "10\\20\\33"});
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(), StatusIs(kInvalid, HasSubstr("one size")));
  Write(2, {.position = "10\\20\\33", .orientation = "1\\0\\0\\0\\0\\1"});
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(kInvalid, HasSubstr("slices of 2 orientations")));
}

TEST_F(DicomSourceTest, TiltedGantryKeepsEachSliceInItsPlace) {
  for (int z = 0; z < 5; ++z) {
    Write(z, {.position = absl::StrCat("10\\", 20 + 2 * z, "\\", 30 + 1.5 * z)});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.path()));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.5, 2, 2.5}));
  const math::Vec3d last =
      math::TransformPoint(source->info().geometry.world_from_index(), {11, 8, 4});
  EXPECT_LT(math::Length(last - math::Vec3d{15.5, 44, 36}), 1e-12);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 2));
  EXPECT_TRUE(read == samples_);
}

TEST_F(DicomSourceTest, UnevenSlicesAreResampledIfTheRulesSaySo) {
  const std::vector<double> places{30, 32, 33, 35, 36};
  for (int z = 0; z < 5; ++z) {
    Write(z, {.position = absl::StrCat("10\\20\\", places[static_cast<std::size_t>(z)])});
  }
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("2 behind"), HasSubstr("1 is the usual distance"),
                             HasSubstr("--resample"))));
  const GridRules rules{.resamples = true};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.path(), "", rules));
  EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{12, 9, 7}));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.5, 2, 1}));
  EXPECT_EQ(source->info().type, ScalarType::kFloat32);
  EXPECT_EQ(source->info().patient_frame, volume::PatientFrame());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 2));
  const auto sample = [&](int z, std::size_t i) {
    std::int16_t value = 0;
    std::memcpy(&value, samples_.data() + static_cast<std::size_t>(z) * kSliceBytes + 2 * i, 2);
    return static_cast<float>(value);
  };
  for (std::size_t i = 0; i < 108; ++i) {
    const auto resampled = [&](std::size_t z) {
      float value = 0;
      std::memcpy(&value, read.data() + 4 * (z * 108 + i), 4);
      return value;
    };
    ASSERT_EQ(resampled(0), sample(0, i));
    ASSERT_EQ(resampled(1), (sample(0, i) + sample(1, i)) / 2);
    ASSERT_EQ(resampled(3), sample(2, i));
    ASSERT_EQ(resampled(4), (sample(2, i) + sample(3, i)) / 2);
    ASSERT_EQ(resampled(6), sample(4, i));
  }
  // A slice that is there twice has no place of its own.
  Write(1, {.position = "10\\20\\30"});
  EXPECT_THAT(OpenVolumeFile(dir_.path(), "", rules).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("there twice")));
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
  EXPECT_EQ(first->info().geometry.sample_dims.z, 5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto second, OpenVolumeFile(dir_.Sub("other1.dcm")));
  EXPECT_EQ(second->info().geometry.sample_dims.z, 2);
}

// Reads the whole series and returns the text on standard output and error.
std::string WordsOfReading(const std::string& path, absl::Status* status) {
  ::testing::internal::CaptureStdout();
  ::testing::internal::CaptureStderr();
  auto source = OpenVolumeFile(path);
  *status = source.ok() ? ReadAll(**source, 2).status() : source.status();
  return ::testing::internal::GetCapturedStdout() + ::testing::internal::GetCapturedStderr();
}

TEST_F(DicomSourceTest, PrivateFieldsThatTheLibraryDoesNotKnowAreNotPrinted) {
  // GDCM finds no such field in its dictionary and quotes it.
  const std::string more = testing::DicomElement(0x31, 0x1010, "LO", "Doe^Jane") +
                           testing::DicomElement(0x35, 0x10, "LO", "A\\B") +
                           testing::DicomElement(0x35, 0x1010, "DS", "Doe^Jane");
  for (int z = 0; z < 5; ++z) {
    Write(z, {.position = absl::StrCat("10\\20\\", 30 + 1.5 * z), .more = more});
  }
  absl::Status status;
  EXPECT_EQ(WordsOfReading(dir_.path(), &status), "");
  ISOSCOPE_EXPECT_OK(status);
  // Nor where it can't be read: 17 bits are stored in 16.
  std::string bytes = testing::ReadFile(Path(2));
  bytes.replace(bytes.find(testing::DicomElement(0x28, 0x101, "US", std::string("\x10\0", 2))), 10,
                testing::DicomElement(0x28, 0x101, "US", std::string("\x11\0", 2)));
  WriteFile(Path(2), bytes);
  EXPECT_EQ(WordsOfReading(dir_.path(), &status), "");
  EXPECT_THAT(status.message(), Not(HasSubstr("Doe")));
}

// Five samples a pixel: GDCM ends its process by an assertion.
std::string FatalBytes(const DicomSlice& slice, const std::string& pixels) {
  std::string bytes = DicomBytes(slice, pixels);
  const auto samples = [](std::uint16_t count) {
    return testing::DicomElement(0x28, 2, "US", testing::DicomNumber(count));
  };
  return bytes.replace(bytes.find(samples(1)), samples(1).size(), samples(5));
}

TEST_F(DicomSourceTest, FileThatEndsTheLibrarysProcessIsAnErrorAndNothingElse) {
  const std::string more = testing::DicomElement(0x31, 0x1010, "LO", "Doe^Jane");
  WriteSeries(testing::kDicomRle);
  const std::string good = testing::ReadFile(Path(2));
  const DicomSlice slice{
      .position = "10\\20\\33", .number = 3, .more = more, .transfer_syntax = testing::kDicomRle};
  const std::string pixels(kSliceBytes, 'p');
  const std::vector<std::string> fatal{FatalBytes(slice, pixels),
                                       DicomBytes(slice, pixels) + "aaaaaa",  // no element
                                       DicomBytes(slice, pixels) + "aaaaaaaaa"};
  for (const std::string& bytes : fatal) {
    WriteFile(Path(2), bytes);
    absl::Status status;
    EXPECT_EQ(WordsOfReading(dir_.path(), &status), "");
    EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(Path(2) + ": ")));
    EXPECT_THAT(status.message(), HasSubstr("SIGABRT"));
    EXPECT_THAT(status.message(), Not(HasSubstr("Doe")));
    WriteFile(Path(2), good);
    EXPECT_EQ(WordsOfReading(dir_.path(), &status), "");
    ISOSCOPE_EXPECT_OK(status);
  }
  // While the series is open, too.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.path()));
  for (const std::string& bytes : fatal) {
    WriteFile(Path(2), bytes);
    EXPECT_THAT(ReadAll(*source, 5).status(),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr(Path(2) + ": ")));
    WriteFile(Path(2), good);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 9));
    EXPECT_TRUE(read == samples_);
  }
}

TEST_F(DicomSourceTest, SliceWithTooFewPixelsIsRefusedAndNotFilledUp) {
  WriteSeries();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.path()));
  WriteFile(Path(2), DicomBytes({.position = "10\\20\\33"}, std::string(kSliceBytes - 2, 'p')));
  EXPECT_THAT(ReadAll(*source, 9).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(Path(2) + ": ")));
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(Path(2) + ": ")));
}

// The children of this process, by their numbers; none where the kernel does not tell.
std::vector<pid_t> Children() {
  std::vector<pid_t> children;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream list(task.path() / "children");
    for (pid_t child = 0; list >> child;) {
      children.push_back(child);
    }
  }
  return children;
}

TEST_F(DicomSourceTest, LibrarysProcessThatIsKilledBetweenSlicesIsReplaced) {
  WriteSeries(testing::kDicomRle);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.path()));
  if (Children().empty()) {
    ISOSCOPE_SKIP("proc_children", "the kernel does not list children (CONFIG_PROC_CHILDREN)");
  }
  std::string read(samples_.size(), '?');
  for (std::int64_t z = 0; z < 5; ++z) {
    const std::vector<pid_t> children = Children();
    ASSERT_EQ(children.size(), 1U) << "one process a source";
    ASSERT_EQ(kill(children[0], SIGKILL), 0);
    ISOSCOPE_EXPECT_OK(source->ReadRows(9 * z, 9 * z + 9,
                                        read.data() + z * static_cast<std::int64_t>(kSliceBytes)));
  }
  EXPECT_TRUE(read == samples_);
}

TEST_F(DicomSourceTest, NoProcessIsLeftOfASource) {
  WriteSeries(testing::kDicomRle);
  for (const bool is_read : {false, true}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.path()));
    if (is_read) {
      ISOSCOPE_EXPECT_OK(ReadAll(*source, 2).status());
    }
  }
  WriteFile(Path(2),
            FatalBytes({.transfer_syntax = testing::kDicomRle}, std::string(kSliceBytes, 'p')));
  EXPECT_FALSE(OpenVolumeFile(dir_.path()).ok());
  EXPECT_EQ(waitpid(-1, nullptr, WNOHANG), -1);
  EXPECT_EQ(errno, ECHILD);
}

TEST_F(DicomSourceTest, FilesWithoutAnImageAreLeftOutWithOneLine) {
  constexpr char kReport[] = "1.2.840.10008.5.1.4.1.1.88.33";
  constexpr char kIndex[] = "1.2.840.10008.1.3.10";
  WriteSeries();
  const auto without_pixels = [](const std::string& storage_class) {
    const std::string whole = DicomBytes({.storage_class = storage_class}, "");
    return whole.substr(0, whole.size() - 12);
  };
  WriteFile(dir_.Sub("DICOMDIR"), without_pixels(kIndex));
  WriteFile(dir_.Sub("a-report"), without_pixels(kReport));
  WriteFile(dir_.Sub("dicomdir.dcm"), without_pixels(kIndex));
  for (const std::string& path : {dir_.path(), Path(1)}) {
    ::testing::internal::CaptureStderr();
    const auto source = OpenVolumeFile(path);
    const std::string said = ::testing::internal::GetCapturedStderr();
    ISOSCOPE_ASSERT_OK(source.status());
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(**source, 2));
    EXPECT_TRUE(read == samples_);
    EXPECT_THAT(said, HasSubstr("dicom_files_without_image_left_out count=2 first=" +
                                dir_.Sub("a-report")));
    EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1) << said;
  }
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("a-report")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("without an image")));
  // A slice without its pixels is no such file.
  WriteFile(Path(4), without_pixels("1.2.840.10008.5.1.4.1.1.2"));
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(Path(4) + ": ")));
}

TEST_F(DicomSourceTest, FolderOfReportsAloneSaysSo) {
  const std::string whole = DicomBytes({.storage_class = "1.2.840.10008.5.1.4.1.1.88.33"}, "");
  WriteFile(dir_.Sub("r"), whole.substr(0, whole.size() - 12));
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none of its 1 DICOM files")));
}

TEST_F(DicomSourceTest, CutFileOfAnotherSeriesStopsOnlyThatOne) {
  WriteSeries();
  const std::string other = DicomBytes({.series = "1.2.77"}, std::string(kSliceBytes, 'o'));
  WriteFile(dir_.Sub("other.dcm"), other.substr(0, other.size() - 1));
  ISOSCOPE_EXPECT_OK(OpenVolumeFile(Path(0)).status());
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("2 series")));
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("other.dcm")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("cut")));
  WriteFile(dir_.Sub("other.dcm"), other.substr(0, other.find("1.2.77")));
  EXPECT_THAT(OpenVolumeFile(Path(0)).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("other.dcm")));
}

TEST_F(DicomSourceTest, NoSeriesAndCutSlicesAreErrors) {
  EXPECT_THAT(OpenVolumeFile(dir_.path()).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("DICOM")));
  WriteFile(dir_.Sub("a.dcm"), "no DICOM");
  EXPECT_FALSE(OpenVolumeFile(dir_.Sub("a.dcm")).ok());
  WriteSeries();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(Path(0)));
  const std::string whole = testing::ReadFile(Path(4));
  for (std::size_t size = 0; size < whole.size(); size += size < 500 ? 1 : 50) {
    WriteFile(Path(4), whole.substr(0, size));
    EXPECT_FALSE(ReadAll(*source, 5).ok()) << size;
    if (size > 132) {  // a shorter file is no DICOM file
      EXPECT_FALSE(OpenVolumeFile(dir_.path()).ok()) << size;
    }
  }
}

}  // namespace
}  // namespace isoscope::source
