#include "clients/cpp/picture_file/poster.h"

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::client {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using testing::TempDir;

constexpr std::int64_t kMaxFileBytes = std::int64_t{64} << 20;

image::Rgba8 PixelOf(int x, int y, bool opaque) {
  return {static_cast<std::uint8_t>(x), static_cast<std::uint8_t>(y),
          static_cast<std::uint8_t>(x / 256 + y / 3),
          static_cast<std::uint8_t>(opaque ? 255 : x % 200)};
}

image::RgbaImage ImageOf(const view::Region& region, bool opaque) {
  image::RgbaImage image{.width = region.width_px, .height = region.height_px, .pixels = {}};
  for (int y = 0; y < region.height_px; ++y) {
    for (int x = 0; x < region.width_px; ++x) {
      image.pixels.push_back(PixelOf(region.x + x, region.y + y, opaque));
    }
  }
  return image;
}

TEST(PosterTest, OnlyPicturesTooLargeForOneFrameAreCutIntoTiles) {
  EXPECT_FALSE(NeedsRegions({1, 1}));
  EXPECT_FALSE(NeedsRegions({4096, 4096}));
  EXPECT_FALSE(NeedsRegions({16384, 1}));
  EXPECT_TRUE(NeedsRegions({4096, 4097}));
  EXPECT_TRUE(NeedsRegions({16385, 1}));
}

TEST(PosterTest, AStripOfTilesIsBoundedAndATileIsOfACommonSize) {
  for (const int width : {1, 1000, 4097, 16385, 32768, 65536}) {
    for (const int height : {1, 500, 4097, 65536}) {
      const view::Viewport region = RegionSizeOf({width, height});
      SCOPED_TRACE(::testing::Message() << width << " x " << height << ": " << region.width_px
                                        << " x " << region.height_px);
      EXPECT_GE(region.width_px, 1);
      EXPECT_LE(region.width_px, std::min(width, view::kMaxViewportPx));
      EXPECT_LE(std::int64_t{region.width_px} * region.height_px, std::int64_t{1} << 20);
      EXPECT_LE(std::int64_t{width} * 4 * region.height_px, kMaxStripBytes);
      EXPECT_EQ(region.height_px % image::PngRowWriter::RowsPerStripe(width), 0);
    }
  }
}

TEST(PosterTest, TilesKeepToTheSideThatTheirSamplesAllow) {
  EXPECT_EQ(RegionSizeOf({32768, 4}, 4000).width_px, 4000);
  EXPECT_EQ(RegionSizeOf({3000, 4}, 4000).width_px, 3000);
  const view::Viewport flat = RegionSizeOf({28028, 92}, 16384, std::int64_t{4} << 20);
  EXPECT_LE(std::int64_t{28028} * 4 * flat.height_px, std::int64_t{4} << 20);
  EXPECT_GE(flat.height_px, 1);
}

TEST(PosterTest, TilesMakeTheFileOfTheWholePicture) {
  const TempDir folder;
  for (const bool opaque : {true, false}) {
    const view::Viewport viewport{2500, 2100};
    const std::string path = folder.Sub("p.png");
    int regions = 0;
    int progress = 0;
    const auto render = [&](const view::Region& region) -> absl::StatusOr<image::RgbaImage> {
      ++regions;
      return ImageOf(region, opaque);
    };
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::int64_t size, WritePoster(viewport, RegionSizeOf(viewport), opaque, path, render,
                                             [&](absl::string_view) { ++progress; }));
    EXPECT_GT(regions, 4);
    EXPECT_EQ(progress, regions);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string file, io::ReadWholeFile(path, kMaxFileBytes));
    EXPECT_EQ(static_cast<std::int64_t>(file.size()), size);
    const image::RgbaImage whole = ImageOf({0, 0, 2500, 2100}, opaque);
    EXPECT_EQ(file, image::EncodePng(2500, 2100, whole.pixels));
  }
}

TEST(PosterTest, AnErrorOrAWrongTileLeavesNoFile) {
  const TempDir folder;
  int regions = 0;
  const auto fail_late = [&](const view::Region& region) -> absl::StatusOr<image::RgbaImage> {
    if (++regions == 3) {
      return absl::UnavailableError("gone");
    }
    return ImageOf(region, true);
  };
  EXPECT_THAT(WritePoster({2500, 2100}, RegionSizeOf({2500, 2100}), true, folder.Sub("p.png"),
                          fail_late, [](absl::string_view) {}),
              StatusIs(absl::StatusCode::kUnavailable, "gone"));
  const auto whole = [](const view::Region&) -> absl::StatusOr<image::RgbaImage> {
    return ImageOf({0, 0, 10, 10}, true);
  };
  EXPECT_THAT(WritePoster({2500, 2100}, RegionSizeOf({2500, 2100}), true, folder.Sub("p.png"),
                          whole, [](absl::string_view) {}),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("10 x 10")));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace isoscope::client
