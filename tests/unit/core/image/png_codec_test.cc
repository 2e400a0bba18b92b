#include "core/image/png_codec.h"

#include <png.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::image {
namespace {

using isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::vector<Rgba8> MakePixels(int width, int height, bool opaque) {
  std::vector<Rgba8> pixels;
  std::uint32_t state = 12345;
  for (int i = 0; i < width * height; ++i) {
    state = state * 1664525U + 1013904223U;
    pixels.push_back({.r = static_cast<std::uint8_t>(i % 251),
                      .g = static_cast<std::uint8_t>(state >> 24),
                      .b = static_cast<std::uint8_t>(i / 7),
                      .a = opaque ? std::uint8_t{255} : static_cast<std::uint8_t>(state >> 16)});
  }
  return pixels;
}

// Colour type byte of the header: 8 signature, 8 chunk head, 4 + 4 size, 1 bit depth.
int ColorType(const std::string& png) { return png[25]; }

// A PNG by libpng's simplified interface, of a kind EncodePng does not write.
std::string WriteOtherFormat(png_uint_32 format, int width, int height, const void* pixels,
                             const void* colormap, png_uint_32 colormap_entries) {
  png_image image;
  std::memset(&image, 0, sizeof(image));
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = format;
  image.colormap_entries = colormap_entries;
  std::string out(1 << 16, '\0');
  png_alloc_size_t size = out.size();
  EXPECT_NE(png_image_write_to_memory(&image, out.data(), &size, 0, pixels, 0, colormap), 0);
  out.resize(size);
  return out;
}

TEST(PngCodecTest, PixelsSurviveTheRoundTrip) {
  for (const bool opaque : {false, true}) {
    for (const auto& [width, height] : std::vector<std::pair<int, int>>{
             {1, 1}, {1, 7}, {7, 1}, {3, 5}, {64, 64}, {257, 131}, {2000, 3}}) {
      SCOPED_TRACE(::testing::Message() << width << " x " << height << " opaque " << opaque);
      const std::vector<Rgba8> pixels = MakePixels(width, height, opaque);
      const std::string png = EncodePng(width, height, pixels);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const RgbaImage decoded, DecodePng(png));
      EXPECT_EQ(decoded, (RgbaImage{.width = width, .height = height, .pixels = pixels}));
    }
  }
}

TEST(PngCodecTest, OnlyOpaqueImagesLoseTheirAlphaChannel) {
  EXPECT_EQ(ColorType(EncodePng(4, 4, MakePixels(4, 4, true))), PNG_COLOR_TYPE_RGB);
  std::vector<Rgba8> pixels = MakePixels(4, 4, true);
  pixels.back().a = 254;
  EXPECT_EQ(ColorType(EncodePng(4, 4, pixels)), PNG_COLOR_TYPE_RGB_ALPHA);
}

TEST(PngCodecTest, SamePixelsGiveSameBytesAndSayTheyAreSrgb) {
  const std::vector<Rgba8> pixels = MakePixels(50, 40, false);
  const std::string png = EncodePng(50, 40, pixels);
  EXPECT_EQ(png, EncodePng(50, 40, pixels));
  EXPECT_THAT(png, StartsWith("\x89PNG\r\n\x1a\n"));
  EXPECT_THAT(png, HasSubstr("sRGB"));
}

TEST(PngCodecTest, GreyAndPalettePngsAreExpanded) {
  const std::array<std::uint8_t, 4> grey{0, 85, 170, 255};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      RgbaImage image, DecodePng(WriteOtherFormat(PNG_FORMAT_GRAY, 2, 2, grey.data(), nullptr, 0)));
  ASSERT_EQ(image.pixels.size(), 4U);
  EXPECT_EQ(image.pixels[1], (Rgba8{85, 85, 85, 255}));
  EXPECT_EQ(image.pixels[3], (Rgba8{255, 255, 255, 255}));

  const std::array<std::uint8_t, 8> palette{10, 20, 30, 255, 40, 50, 60, 70};
  const std::array<std::uint8_t, 2> indices{1, 0};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      image, DecodePng(WriteOtherFormat(PNG_FORMAT_RGBA_COLORMAP, 2, 1, indices.data(),
                                        palette.data(), 2)));
  ASSERT_EQ(image.pixels.size(), 2U);
  EXPECT_EQ(image.pixels[0], (Rgba8{40, 50, 60, 70}));
  EXPECT_EQ(image.pixels[1], (Rgba8{10, 20, 30, 255}));
}

TEST(PngCodecTest, EveryTruncationIsDataLoss) {
  const std::string png = EncodePng(9, 5, MakePixels(9, 5, false));
  for (std::size_t size = 0; size < png.size(); ++size) {
    // A buffer of exactly this size, so that an overread is seen by the sanitizer.
    const auto buffer = std::make_unique<char[]>(size);
    std::memcpy(buffer.get(), png.data(), size);
    EXPECT_THAT(DecodePng(absl::string_view(buffer.get(), size)),
                StatusIs(absl::StatusCode::kDataLoss, _))
        << size;
  }
}

TEST(PngCodecTest, EveryFlippedBitIsDataLoss) {
  const std::string png = EncodePng(9, 5, MakePixels(9, 5, false));
  for (std::size_t bit = 0; bit < png.size() * 8; ++bit) {
    std::string damaged = png;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    EXPECT_THAT(DecodePng(damaged), StatusIs(absl::StatusCode::kDataLoss, _)) << "bit " << bit;
  }
}

TEST(PngCodecTest, SizesThatTheBytesCantHoldAreRefusedBeforeMemoryIsTaken) {
  std::string png = EncodePng(1, 1, MakePixels(1, 1, false));
  // Width and height 16384 with a checksum that is right.
  constexpr std::size_t kHeader = 12;
  for (const std::size_t at : {16U, 20U}) {
    png[at + 2] = 0x40;
    png[at + 3] = 0;
  }
  std::uint32_t crc = 0xffffffff;
  for (std::size_t i = kHeader; i < kHeader + 17; ++i) {
    crc ^= static_cast<std::uint8_t>(png[i]);
    for (int bit = 0; bit < 8; ++bit) {
      crc = crc >> 1 ^ ((crc & 1) != 0 ? 0xedb88320U : 0U);
    }
  }
  crc = ~crc;
  for (std::size_t i = 0; i < 4; ++i) {
    png[kHeader + 17 + i] = static_cast<char>(crc >> (24 - 8 * i));
  }
  EXPECT_THAT(DecodePng(png), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("16384 x 16384")));
}

TEST(PngCodecTest, OtherBytesAreDataLoss) {
  EXPECT_THAT(DecodePng(""), StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_THAT(DecodePng("GIF89a, not a PNG at all, whatever the name"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("Not a PNG")));
}

}  // namespace
}  // namespace isoscope::image
