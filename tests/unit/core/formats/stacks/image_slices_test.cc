// Stacks of images that ITK writes, and what becomes of them when they are cut.

#include "core/formats/stacks/image_slices.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "itkJPEG2000ImageIO.h"
#include "itkJPEGImageIO.h"
#include "itkPNGImageIO.h"

#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
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
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(ImageSlicesTest, SlicesAreStackedByTheNumbersInTheirNames) {
  const TempDir dir;
  for (const int z : {10, 9, 8}) {
    WriteImage<itk::PNGImageIO>(dir.Sub(absl::StrCat("s", z, ".png")), {4, 3},
                                Counted<std::uint16_t>(12, z));
  }
  WriteFile(dir.Sub("notes.txt"), "none of them");
  for (const std::string& path : {dir.path(), dir.Sub("s*.png")}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
    EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{4, 3, 3}));
    EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{1, 1, 1}));
    ASSERT_EQ(source->info().type, volume::ScalarType::kUint16);
    std::vector<std::uint16_t> expected;
    for (const int z : {8, 9, 10}) {
      for (const std::uint16_t sample : Counted<std::uint16_t>(12, z)) {
        expected.push_back(sample);
      }
    }
    EXPECT_EQ(SamplesOf<std::uint16_t>(*source, 1), expected) << path;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
    EXPECT_THAT(files, ElementsAre(dir.Sub("s8.png"), dir.Sub("s9.png"), dir.Sub("s10.png")));
  }
}

TEST(ImageSlicesTest, StackWithAGapIsRefusedAndTakenAsNeighbours) {
  const TempDir dir;
  for (const int z : {1, 2, 4}) {
    WriteImage<itk::PNGImageIO>(dir.Sub(absl::StrCat("s", z, ".png")), {4, 3},
                                Counted<std::uint8_t>(12, z));
  }
  for (const std::string& path : {dir.path(), dir.Sub("s*.png")}) {
    EXPECT_THAT(OpenVolumeSeries(path),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr("missing between s2.png and s4.png: 3; --axes Z")));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, OpenVolumeSeries(path, {.axes = "Z"}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, 0, 0));
    EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{4, 3, 3}));
    EXPECT_THAT(OpenVolumeSeries(path, {.axes = "TZ"}),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("--axes TZ")));
  }
}

TEST(ImageSlicesTest, Jpeg2000ComesBackWithEachBit) {
  for (const std::string ending : {".jp2", ".j2k", ".JP2", ".J2C", ".jpc"}) {
    const TempDir dir;
    for (int z = 0; z < 2; ++z) {
      // ITK goes by the name, which only these two have.
      const std::string written =
          dir.Sub(absl::EndsWithIgnoreCase(ending, "2") ? "a.jp2" : "a.j2k");
      WriteImage<itk::JPEG2000ImageIO>(written, {40, 30}, Counted<std::uint16_t>(1200, z));
      std::filesystem::rename(written, dir.Sub(absl::StrCat(z, ending)));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.path()));
    EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{40, 30, 2}));
    EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{1, 1, 1}));
    ASSERT_EQ(source->info().type, volume::ScalarType::kUint16);
    std::vector<std::uint16_t> expected = Counted<std::uint16_t>(1200);
    for (const std::uint16_t sample : Counted<std::uint16_t>(1200, 1)) {
      expected.push_back(sample);
    }
    EXPECT_EQ(SamplesOf<std::uint16_t>(*source, 1), expected) << ending;
  }
}

TEST(ImageSlicesTest, GreyJpegHasTheSamplesThatItkReads) {
  const TempDir dir;
  const auto io = itk::JPEGImageIO::New();
  for (const char* name : {"0.jpg", "1.JPEG"}) {
    WriteImage<itk::JPEGImageIO>(dir.Sub(name), {16, 16}, Counted<std::uint8_t>(256));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.path()));
  EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{16, 16, 2}));
  std::vector<std::uint8_t> expected(256);
  io->SetFileName(dir.Sub("0.jpg"));
  io->ReadImageInformation();
  ASSERT_EQ(io->GetNumberOfComponents(), 1U);
  io->Read(expected.data());
  for (int i = 0; i < 256; ++i) {
    ASSERT_NEAR(expected[static_cast<std::size_t>(i)], i, 6);
    expected.push_back(expected[static_cast<std::size_t>(i)]);
  }
  EXPECT_EQ(SamplesOf<std::uint8_t>(*source, 1), expected);
}

TEST(ImageSlicesTest, SlicesOfOneHeightButAnotherWidthOrTypeAreRefused) {
  const TempDir dir;
  WriteImage<itk::PNGImageIO>(dir.Sub("0.png"), {4, 3}, Counted<std::uint8_t>(12));
  for (const bool is_wide : {false, true}) {
    if (is_wide) {
      WriteImage<itk::PNGImageIO>(dir.Sub("1.png"), {5, 3}, Counted<std::uint8_t>(15));
    } else {
      WriteImage<itk::PNGImageIO>(dir.Sub("1.png"), {4, 3}, Counted<std::uint16_t>(12));
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.path()));
    EXPECT_THAT(ReadAll(*source, 1).status(),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         HasSubstr(is_wide ? "5 x 3 samples of uint8" : "of uint16")));
  }
}

TEST(ImageSlicesTest, MemoryOfTheDecoderOfJpeg2000IsCounted) {
  std::vector<std::int64_t> bytes;
  for (const bool is_jpeg_2000 : {false, true}) {
    const TempDir dir;
    for (int z = 0; z < 2; ++z) {
      if (is_jpeg_2000) {
        WriteImage<itk::JPEG2000ImageIO>(dir.Sub(absl::StrCat(z, ".jp2")), {40, 30},
                                         Counted<std::uint16_t>(1200));
      } else {
        WriteImage<itk::PNGImageIO>(dir.Sub(absl::StrCat(z, ".png")), {40, 30},
                                    Counted<std::uint16_t>(1200));
      }
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.path()));
    bytes.push_back(source->info().memory_bytes);
  }
  EXPECT_EQ(bytes[1] - bytes[0], 12 * 40 * 30);
}

TEST(ImageSlicesTest, SlicesOfAVolumeAreOfOneKindAndPreviewsAreLeftOut) {
  const TempDir dir;
  WriteImage<itk::JPEGImageIO>(dir.Sub("preview.jpg"), {8, 8}, Counted<std::uint8_t>(192), 3);
  WriteImage<itk::JPEGImageIO>(dir.Sub("a.jpg"), {8, 8}, Counted<std::uint8_t>(64));
  EXPECT_THAT(ImageSlicesNamed(dir.path()), ElementsAre(dir.Sub("a.jpg"), dir.Sub("preview.jpg")));
  WriteImage<itk::JPEG2000ImageIO>(dir.Sub("b.jp2"), {8, 8}, Counted<std::uint8_t>(64));
  EXPECT_THAT(ImageSlicesNamed(dir.path()), ElementsAre(dir.Sub("b.jp2")));
  for (const char* name : {"c1.png", "c2.png"}) {
    WriteImage<itk::PNGImageIO>(dir.Sub(name), {8, 8}, Counted<std::uint8_t>(64));
  }
  EXPECT_THAT(ImageSlicesNamed(dir.path()), ElementsAre(dir.Sub("c1.png"), dir.Sub("c2.png")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir.path()));
  EXPECT_EQ(source->info().geometry.sample_dims, (math::Index3{8, 8, 2}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(dir.Sub("*.jpg")));
  EXPECT_THAT(files, ElementsAre(dir.Sub("a.jpg"), dir.Sub("preview.jpg")));
}

TEST(ImageSlicesTest, ColoursMixedSlicesAndSingleOnesAreRefused) {
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
  EXPECT_THAT(OpenVolumeFile(dir.Sub("0.png")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr("0.png: one slice; a volume has two or more: give their folder")));
  EXPECT_THAT(OpenVolumeFile(dir.Sub("0*.png")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       HasSubstr(absl::StrCat("one slice (", dir.Sub("0.png"), ")"))));
  EXPECT_THAT(OpenVolumeFile(dir.Sub("x*.png")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no slices")));
}

TEST(ImageSlicesTest, CutFilesAreRefusedWhereverTheyEnd) {
  for (const char* ending : {".png", ".jp2", ".j2k", ".jpg"}) {
    const TempDir slices;
    for (int z = 0; z < 2; ++z) {
      const std::string path = slices.Sub(absl::StrCat(z, ending));
      const std::string kind = ending;
      if (kind == ".png") {
        WriteImage<itk::PNGImageIO>(path, {40, 30}, Counted<std::uint16_t>(1200));
      } else if (kind == ".jpg") {
        WriteImage<itk::JPEGImageIO>(path, {40, 30}, Counted<std::uint8_t>(1200));
      } else {
        WriteImage<itk::JPEG2000ImageIO>(path, {40, 30}, Counted<std::uint16_t>(1200));
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
