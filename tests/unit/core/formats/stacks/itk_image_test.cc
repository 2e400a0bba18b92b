// Files that ITK writes, and what becomes of them when they are cut.

#include "core/formats/stacks/itk_image.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "itkBioRadImageIO.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/medical/itk_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Counted;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ReadFile;
using ::isoscope::testing::SamplesOf;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::isoscope::testing::WriteImage;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(ItkImageTest, BioRadComesBack) {
  const TempDir dir;
  const std::string path = dir.Sub("a.pic");
  WriteImage<itk::BioRadImageIO>(path, {4, 3, 2}, Counted<std::uint8_t>(24));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
  EXPECT_EQ(source->geometry().sample_dims, (math::Index3{4, 3, 2}));
  ASSERT_EQ(source->scalar_type(), volume::ScalarType::kUint8);
  EXPECT_EQ(SamplesOf<std::uint8_t>(*source, 1), Counted<std::uint8_t>(24));
}

TEST(ItkImageTest, StimulateIsAHeaderWithItsSamplesBeside) {
  const TempDir dir;
  const std::string path = dir.Sub("a.spr");
  WriteFile(path,
            "numDim: 3\ndim: 4 3 2\norigin: 10 20 30\nfov: 2 3 3\ninterval: 0.5 1 1.5\n"
            "dataType: BYTE\n");
  const std::vector<std::uint8_t> samples = Counted<std::uint8_t>(24);
  WriteFile(dir.Sub("a.sdt"), std::string(samples.begin(), samples.end()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
  EXPECT_EQ(source->geometry().sample_dims, (math::Index3{4, 3, 2}));
  EXPECT_EQ(source->geometry().spacing, (math::Vec3d{0.5, 1, 1.5}));
  EXPECT_EQ(source->geometry().origin, (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(SamplesOf<std::uint8_t>(*source, 1), samples);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
  EXPECT_THAT(files, ElementsAre(path, dir.Sub("a.sdt")));
}

TEST(ItkImageTest, BytesOfNoFormatAreRefused) {
  const TempDir dir;
  WriteFile(dir.Sub("b.pic"), std::string(100, 'a'));
  EXPECT_THAT(OpenVolumeFile(dir.Sub("b.pic")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("b.pic: can't be read as BioRad: "), Not(HasSubstr("0x")))));
}

// ITK 5.2 looks for the notes of this file without an end.
TEST(ItkImageTest, ABioRadHeaderThatIsCutEndsAtOnce) {
  const TempDir dir;
  const std::string path = dir.Sub("a.pic");
  WriteImage<itk::BioRadImageIO>(path, {4, 3, 2}, Counted<std::uint8_t>(24));
  std::string bytes = ReadFile(path).substr(0, 75);
  bytes[10] = 1;  // has notes
  WriteFile(path, bytes);
  EXPECT_THAT(OpenVolumeFile(path),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("header has 75 bytes, expected 76")));
}

// Each cut of each format: an error, never samples that the memory held.
TEST(ItkImageTest, CutFilesAreRefusedWhereverTheyEnd) {
  const TempDir dir;
  WriteImage<itk::BioRadImageIO>(dir.Sub("a.pic"), {40, 30, 2}, Counted<std::uint8_t>(2400));
  WriteFile(dir.Sub("b.spr"), "numDim: 3\ndim: 4 3 2\ndataType: WORD\n");
  WriteFile(dir.Sub("b.sdt"), std::string(48, 'a'));
  for (const char* name : {"a.pic", "b.sdt"}) {
    const std::string whole = ReadFile(dir.Sub(name));
    const std::string opened = dir.Sub(std::string(name) == "b.sdt" ? "b.spr" : name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto complete, OpenVolumeFile(opened));
    ISOSCOPE_EXPECT_OK(ReadAll(*complete, 1).status());
    for (int i = 0; i <= 12; ++i) {
      const std::size_t cut = static_cast<std::size_t>(i) * whole.size() / 12;
      WriteFile(dir.Sub(name), whole.substr(0, std::min(cut, whole.size() - 1)));
      const auto source = OpenVolumeFile(opened);
      const absl::Status status = source.ok() ? ReadAll(**source, 1).status() : source.status();
      EXPECT_FALSE(status.ok()) << name << " " << i;
      EXPECT_THAT(std::string(status.message()), HasSubstr(opened)) << i;
    }
  }
}

}  // namespace
}  // namespace isoscope::source
