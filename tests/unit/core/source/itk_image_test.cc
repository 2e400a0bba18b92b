// Files that ITK writes, and what becomes of them when they are cut.

#include "core/source/itk_image.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "itkBMPImageIO.h"
#include "itkBioRadImageIO.h"
#include "itkPNGImageIO.h"

#include "core/source/volume_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/source/vti_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ReadFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

// Writes an image with ITK; `samples` in the order of the file.
template <typename Io, typename T>
void WriteImage(const std::string& path, const std::vector<unsigned>& dims,
                const std::vector<T>& samples, unsigned components = 1) {
  const auto io = Io::New();
  const auto axes = static_cast<unsigned>(dims.size());
  io->SetFileName(path);
  io->SetNumberOfDimensions(axes);
  itk::ImageIORegion region(axes);
  for (unsigned axis = 0; axis < axes; ++axis) {
    io->SetDimensions(axis, dims[axis]);
    io->SetSpacing(axis, 0.5 * (axis + 1));
    io->SetOrigin(axis, 0);
    region.SetSize(axis, dims[axis]);
    region.SetIndex(axis, 0);
  }
  io->SetComponentType(sizeof(T) == 1 ? itk::IOComponentEnum::UCHAR : itk::IOComponentEnum::USHORT);
  io->SetNumberOfComponents(components);
  io->SetPixelType(components == 1 ? itk::IOPixelEnum::SCALAR : itk::IOPixelEnum::RGB);
  io->SetIORegion(region);
  io->WriteImageInformation();
  io->Write(samples.data());
}

template <typename T>
std::vector<T> Counted(std::size_t count, int first = 0) {
  std::vector<T> samples;
  for (std::size_t i = 0; i < count; ++i) {
    samples.push_back(static_cast<T>(static_cast<int>(i) * (sizeof(T) == 1 ? 1 : 257) + first));
  }
  return samples;
}

template <typename T>
std::vector<T> SamplesOf(VolumeSource& source, std::int64_t planes) {
  const auto bytes = ReadAll(source, planes);
  EXPECT_TRUE(bytes.ok()) << bytes.status();
  return bytes.ok() ? testing::ValuesOf<T>(*bytes) : std::vector<T>();
}

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

TEST(ItkImageTest, SlicesAreStackedByTheNumbersInTheirNames) {
  const TempDir dir;
  for (const int z : {10, 9, 2}) {
    WriteImage<itk::PNGImageIO>(dir.Sub(absl::StrCat("s", z, ".png")), {4, 3},
                                Counted<std::uint16_t>(12, z));
  }
  WriteFile(dir.Sub("notes.txt"), "none of them");
  for (const std::string& path : {dir.path(), dir.Sub("s*.png")}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
    EXPECT_EQ(source->geometry().sample_dims, (math::Index3{4, 3, 3}));
    EXPECT_EQ(source->geometry().spacing, (math::Vec3d{1, 1, 1}));
    ASSERT_EQ(source->scalar_type(), volume::ScalarType::kUint16);
    std::vector<std::uint16_t> expected;
    for (const int z : {2, 9, 10}) {
      for (const std::uint16_t sample : Counted<std::uint16_t>(12, z)) {
        expected.push_back(sample);
      }
    }
    EXPECT_EQ(SamplesOf<std::uint16_t>(*source, 1), expected) << path;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
    EXPECT_THAT(files, ElementsAre(dir.Sub("s2.png"), dir.Sub("s9.png"), dir.Sub("s10.png")));
  }
}

TEST(ItkImageTest, GreyBmpComesBack) {
  const TempDir dir;
  for (int z = 0; z < 2; ++z) {
    WriteImage<itk::BMPImageIO>(dir.Sub(absl::StrCat(z, ".bmp")), {5, 3},
                                Counted<std::uint8_t>(15, 100 * z));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.path()));
  EXPECT_EQ(source->geometry().sample_dims, (math::Index3{5, 3, 2}));
  std::vector<std::uint8_t> expected = Counted<std::uint8_t>(15);
  for (const std::uint8_t sample : Counted<std::uint8_t>(15, 100)) {
    expected.push_back(sample);
  }
  EXPECT_EQ(SamplesOf<std::uint8_t>(*source, 1), expected);
  std::string coloured = ReadFile(dir.Sub("0.bmp"));
  coloured[54 + 4 * 7] = '\xff';  // blue of the seventh colour
  WriteFile(dir.Sub("0.bmp"), coloured);
  EXPECT_THAT(OpenVolumeFile(dir.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("0.bmp: a colour image")));
}

TEST(ItkImageTest, ColoursMixedSlicesAndSingleOnesAreRefused) {
  const TempDir dir;
  WriteImage<itk::PNGImageIO>(dir.Sub("0.png"), {4, 3}, Counted<std::uint8_t>(36), 3);
  WriteImage<itk::PNGImageIO>(dir.Sub("1.png"), {4, 3}, Counted<std::uint8_t>(36), 3);
  EXPECT_THAT(OpenVolumeFile(dir.path()).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("0.png: a colour image")));
  WriteImage<itk::PNGImageIO>(dir.Sub("0.png"), {4, 3}, Counted<std::uint8_t>(12));
  WriteImage<itk::PNGImageIO>(dir.Sub("1.png"), {3, 4}, Counted<std::uint8_t>(12));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.path()));
  EXPECT_THAT(ReadAll(*source, 1).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("1.png: 3 x 4")));
  EXPECT_FALSE(OpenVolumeFile(dir.Sub("0.png")).ok());
  WriteFile(dir.Sub("b.pic"), std::string(100, 'a'));
  EXPECT_THAT(OpenVolumeFile(dir.Sub("b.pic")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("b.pic: can't be read as BioRad: "), Not(HasSubstr("0x")))));
  EXPECT_THAT(OpenVolumeFile(dir.Sub("x*.png")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no slices")));
}

// Each cut of each format: an error, never samples that the memory held.
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
  for (const char* ending : {".png", ".bmp"}) {
    const TempDir slices;
    for (int z = 0; z < 2; ++z) {
      const std::string path = slices.Sub(absl::StrCat(z, ending));
      if (ending == std::string(".png")) {
        WriteImage<itk::PNGImageIO>(path, {40, 30}, Counted<std::uint16_t>(1200));
      } else {
        WriteImage<itk::BMPImageIO>(path, {40, 30}, Counted<std::uint8_t>(1200));
      }
    }
    const std::string path = slices.Sub(absl::StrCat("1", ending));
    const std::string whole = ReadFile(path);
    for (int i = 0; i < 12; ++i) {
      WriteFile(path, whole.substr(0, static_cast<std::size_t>(i) * whole.size() / 12));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(slices.path()));
      const absl::Status status = ReadAll(*source, 1).status();
      EXPECT_FALSE(status.ok()) << ending << " " << i;
    }
  }
}

}  // namespace
}  // namespace isoscope::source
