#include "core/formats/stacks/tiff_file.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/mounted_file.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/stacks/tiff_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::TiffPlane;
using ::isoscope::testing::TiffStackFile;
using ::isoscope::testing::WriteTiffStack;
using ::testing::HasSubstr;

TEST(TiffFileTest, TheFirstBytesTell) {
  for (const std::string& head : {std::string("II*\0", 4), std::string("MM\0*", 4),
                                  std::string("II+\0more", 8), std::string("MM\0+", 4)}) {
    EXPECT_TRUE(IsTiff(head));
  }
  for (const std::string& head : {std::string(), std::string("II*"), std::string("IIII")}) {
    EXPECT_FALSE(IsTiff(head));
  }
}

TEST(TiffFileTest, TheScanFindsPagesAndLeavesThumbnailsOut) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  const TiffStackFile file{
      .pages = 3, .description = "text", .lsm = "tag", .resolution = 4, .has_thumbnails = true};
  ASSERT_TRUE(WriteTiffStack(path, file));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffFile tiff, OpenTiff(path));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffPages pages, ScanTiffPages(tiff.get(), path));
  ASSERT_EQ(pages.offsets.size(), 3u);
  EXPECT_EQ(pages.description, "text");
  EXPECT_EQ(pages.lsm, "tag");
  EXPECT_EQ(pages.x_resolution, 4);
  EXPECT_EQ(pages.resolution_unit, RESUNIT_NONE);
  EXPECT_GT(pages.raw_offset, 0u);
  ASSERT_NE(TIFFSetSubDirectory(tiff.get(), pages.offsets[2]), 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const PageFormat format,
                                FormatOfPage(tiff.get(), path, TiffColours::kRefused));
  EXPECT_EQ(format.plane_bytes(), 24);
  std::vector<std::uint16_t> samples(12);
  ISOSCOPE_ASSERT_OK(
      ReadTiffPlane(tiff.get(), format, 0, path, reinterpret_cast<char*>(samples.data())));
  EXPECT_EQ(samples, TiffPlane(file, 2));
}

// A file at an address that vanishes behind some byte.
class VanishingFile final : public testing::MemoryReadFile {
 public:
  VanishingFile(const std::string& bytes, std::int64_t end) : MemoryReadFile(bytes), end_(end) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    return offset + static_cast<std::int64_t>(size) > end_
               ? absl::NotFoundError("has vanished")
               : MemoryReadFile::ReadAt(offset, size, out);
  }

 private:
  const std::int64_t end_;
};

// Symptom: a page that could not be fetched was DATA_LOSS, "the file is cut or damaged".
TEST(TiffFileTest, AFileThatVanishesWhileItIsScannedIsNotDamaged) {
  const TempDir dir;
  ASSERT_TRUE(WriteTiffStack(dir.Sub("a.tif"), {.pages = 3}));
  const std::string bytes = testing::ReadFile(dir.Sub("a.tif"));
  const auto scan = [&](std::size_t end) {
    const auto file = std::make_shared<VanishingFile>(bytes, static_cast<std::int64_t>(end));
    io::MountFile({.file = file});
    const absl::StatusOr<TiffFile> tiff = OpenTiff(file->path());
    return tiff.ok() ? ScanTiffPages(tiff->get(), file->path()).status() : tiff.status();
  };
  ISOSCOPE_EXPECT_OK(scan(bytes.size()));
  int failed = 0;
  for (std::size_t end = 8; end < bytes.size(); end += 3) {
    const absl::Status status = scan(end);
    EXPECT_TRUE(status.ok() || absl::IsNotFound(status)) << end << " " << status;
    failed += status.ok() ? 0 : 1;
  }
  EXPECT_GT(failed, 3);
}

TEST(TiffFileTest, ColoursForDisplayAreLeftToTheSamples) {
  const TempDir dir;
  const std::string path = dir.Sub("a.tif");
  ASSERT_TRUE(WriteTiffStack(path, {.pages = 1, .photometric = PHOTOMETRIC_PALETTE}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const TiffFile tiff, OpenTiff(path));
  EXPECT_THAT(FormatOfPage(tiff.get(), path, TiffColours::kRefused).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("a palette")));
  ISOSCOPE_EXPECT_OK(FormatOfPage(tiff.get(), path, TiffColours::kForDisplay).status());
  EXPECT_THAT(OpenTiff(dir.Sub("none.tif")).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.tif")));
}

}  // namespace
}  // namespace isoscope::source
