#include "server/picture/band_joiner.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::server {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

// Wide enough for several stripes of a PNG.
constexpr int kWidth = 3000;
constexpr int kHeight = 130;

frame::FrameSpec SpecOf(frame::ImageFormat format, image::Rgba8 background) {
  frame::FrameSpec spec;
  spec.viewport = {kWidth, kHeight};
  spec.background_color = background;
  spec.output.image_format = format;
  return spec;
}

// Pixels that repeat a little, with background between them.
image::FrameImage RandomPicture() {
  image::FrameImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const std::uint64_t i = image.IndexOf(x, y);
      if (base::RandomUnit(1, i / 3) < 0.7) {
        const auto shade = static_cast<std::uint8_t>(256 * base::RandomUnit(2, i / 2));
        image.Set(x, y, image::FragmentKey(0.5F, 3), {shade, 7, shade, 255});
      }
    }
  }
  return image;
}

image::FrameImage Cut(const image::FrameImage& whole, const view::Region& band) {
  image::FrameImage part(band.width_px, band.height_px);
  for (int y = 0; y < band.height_px; ++y) {
    for (int x = 0; x < band.width_px; ++x) {
      const std::size_t i = whole.IndexOf(band.x + x, band.y + y);
      part.Set(x, y, whole.keys[i], whole.colors[i]);
    }
  }
  return part;
}

std::vector<view::Region> BandsOf(int columns, int rows) {
  std::vector<view::Region> bands;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const int x = kWidth * column / columns;
      const int y = kHeight * row / rows;
      bands.push_back({x, y, kWidth * (column + 1) / columns - x, kHeight * (row + 1) / rows - y});
    }
  }
  return bands;
}

absl::StatusOr<FrameOutput> Join(const frame::FrameSpec& spec, const image::FrameImage& picture,
                                 const std::vector<view::Region>& bands, bool by_rows) {
  BandJoiner joiner(spec, by_rows);
  for (const view::Region& band : bands) {
    joiner.AddPicture(band, Cut(picture, band));
    if (absl::Status status = joiner.EncodeRows(); !status.ok()) {
      return status;
    }
  }
  return joiner.Finish();
}

TEST(BandJoinerTest, ThePictureHasTheBytesOfTheWholeInEachFormatHoweverItIsCut) {
  const image::FrameImage picture = RandomPicture();
  for (const auto format : {frame::ImageFormat::kPng, frame::ImageFormat::kJpeg,
                            frame::ImageFormat::kRgba8, frame::ImageFormat::kNone}) {
    for (const image::Rgba8 background :
         {image::Rgba8{9, 8, 7, 255}, image::Rgba8{9, 8, 7, 0}, image::Rgba8{9, 8, 7, 100}}) {
      const frame::FrameSpec spec = SpecOf(format, background);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string expected, EncodePicture(picture, spec));
      for (const auto& [columns, rows] :
           {std::pair(1, 1), {1, 2}, {1, 9}, {1, kHeight}, {2, 3}, {5, 1}, {4, 7}}) {
        for (const bool by_rows : {false, true}) {
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameOutput joined,
                                        Join(spec, picture, BandsOf(columns, rows), by_rows));
          EXPECT_TRUE(joined.image == expected)
              << static_cast<int>(format) << " " << columns << " x " << rows << " " << by_rows;
        }
      }
    }
  }
}

TEST(BandJoinerTest, TilesInAnyOrderHaveTheBytesOfTheWholeAndEachThoseOfItsRegion) {
  const image::FrameImage picture = RandomPicture();
  for (const image::Rgba8 background : {image::Rgba8{9, 20, 30, 255}, image::Rgba8{9, 20, 30, 0}}) {
    const frame::FrameSpec spec = SpecOf(frame::ImageFormat::kPng, background);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string whole, EncodePicture(picture, spec));
    std::vector<view::Region> tiles = BandsOf(7, 3);
    for (std::size_t i = tiles.size(); i > 1; --i) {
      std::swap(tiles[i - 1],
                tiles[static_cast<std::size_t>(static_cast<double>(i) * base::RandomUnit(3, i))]);
    }
    BandJoiner joiner(spec, /*is_encoded_by_rows=*/false);
    for (const view::Region& tile : tiles) {
      const image::FrameImage part = Cut(picture, tile);
      joiner.AddPicture(tile, part);
      ISOSCOPE_ASSERT_OK(joiner.EncodeRows());
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string of_tile, joiner.EncodePart(tile));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string of_region, EncodePicture(part, spec));
      EXPECT_TRUE(of_tile == of_region) << tile.x << ", " << tile.y;
    }
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameOutput joined, joiner.Finish());
    EXPECT_TRUE(joined.image == whole);
  }
}

TEST(BandJoinerTest, PlanesAreJoinedPixelByPixel) {
  frame::FrameSpec spec = SpecOf(frame::ImageFormat::kNone, {});
  spec.output.depth = true;
  spec.output.position = true;
  spec.output.surface_index = true;
  BandJoiner joiner(spec, false);
  const auto plane_of = [](const view::Region& band, std::size_t pixel_bytes) {
    std::string plane;
    for (int y = band.y; y < band.y + band.height_px; ++y) {
      for (int x = band.x; x < band.x + band.width_px; ++x) {
        for (std::size_t byte = 0; byte < pixel_bytes; ++byte) {
          plane += static_cast<char>(17 * y + x + 5 * static_cast<int>(byte));
        }
      }
    }
    return plane;
  };
  for (const view::Region& band : BandsOf(3, 4)) {
    FrameOutput planes;
    planes.depth = plane_of(band, frame::kDepthBytes);
    planes.position = plane_of(band, frame::kPositionBytes);
    planes.surface_index = plane_of(band, frame::kSurfaceIndexBytes);
    joiner.AddPlanes(band, planes);
    ISOSCOPE_ASSERT_OK(joiner.EncodeRows());
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const FrameOutput joined, joiner.Finish());
  const view::Region whole{0, 0, kWidth, kHeight};
  EXPECT_TRUE(joined.depth == plane_of(whole, frame::kDepthBytes));
  EXPECT_TRUE(joined.position == plane_of(whole, frame::kPositionBytes));
  EXPECT_TRUE(joined.surface_index == plane_of(whole, frame::kSurfaceIndexBytes));
  EXPECT_TRUE(joined.normal.empty());
  EXPECT_TRUE(joined.image.empty());
}

TEST(BandJoinerTest, ATranslucentPixelIsAnErrorWhereThreeChannelsWerePromised) {
  const frame::FrameSpec spec = SpecOf(frame::ImageFormat::kPng, {0, 0, 0, 255});
  image::FrameImage picture(kWidth, kHeight);
  picture.Set(5, 5, image::FragmentKey(0.5F, 3), {1, 2, 3, 254});
  EXPECT_THAT(Join(spec, picture, BandsOf(1, 2), /*by_rows=*/true),
              StatusIs(absl::StatusCode::kInternal, HasSubstr("translucent")));
  ISOSCOPE_EXPECT_OK(Join(spec, picture, BandsOf(1, 2), /*by_rows=*/false));
}

}  // namespace
}  // namespace isoscope::server
