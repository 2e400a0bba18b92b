#include "core/formats/stacks/tiff_file.h"

#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
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
