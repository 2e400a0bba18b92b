#include "core/image/jpeg_codec.h"

#include <cstdio>
// jpeglib.h needs cstdio's FILE.
#include <jpeglib.h>

#include <cstddef>
#include <cstdlib>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::image {
namespace {

struct Decoded {
  int width = 0;
  int height = 0;
  int horizontal_sampling = 0;
  std::vector<unsigned char> rgb;
};

// By libjpeg, whose default error handler ends the test program.
Decoded Decode(const std::string& jpeg) {
  jpeg_decompress_struct info{};
  jpeg_error_mgr errors{};
  info.err = jpeg_std_error(&errors);
  jpeg_create_decompress(&info);
  jpeg_mem_src(&info, reinterpret_cast<const unsigned char*>(jpeg.data()), jpeg.size());
  jpeg_read_header(&info, TRUE);
  info.out_color_space = JCS_RGB;
  jpeg_start_decompress(&info);
  Decoded decoded;
  decoded.width = static_cast<int>(info.output_width);
  decoded.height = static_cast<int>(info.output_height);
  decoded.horizontal_sampling = info.comp_info[0].h_samp_factor;
  decoded.rgb.resize(std::size_t{info.output_width} * info.output_height * 3);
  while (info.output_scanline < info.output_height) {
    JSAMPLE* row = decoded.rgb.data() + std::size_t{info.output_scanline} * info.output_width * 3;
    jpeg_read_scanlines(&info, &row, 1);
  }
  jpeg_finish_decompress(&info);
  jpeg_destroy_decompress(&info);
  return decoded;
}

// Smooth, so that JPEG keeps it.
std::vector<Rgba8> Ramp(int width, int height) {
  std::vector<Rgba8> pixels;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      pixels.push_back({static_cast<std::uint8_t>(x), static_cast<std::uint8_t>(y),
                        static_cast<std::uint8_t>(255 - x), 255});
    }
  }
  return pixels;
}

TEST(JpegCodecTest, ASmoothPictureComesBackNearlyAsItWas) {
  const std::vector<Rgba8> pixels = Ramp(200, 123);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string jpeg, EncodeJpeg(200, 123, pixels, {}, 95));
  const Decoded decoded = Decode(jpeg);
  ASSERT_EQ(decoded.width, 200);
  ASSERT_EQ(decoded.height, 123);
  EXPECT_EQ(decoded.horizontal_sampling, 1) << "colours are subsampled";
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    ASSERT_LE(std::abs(decoded.rgb[3 * i] - pixels[i].r), 6);
    ASSERT_LE(std::abs(decoded.rgb[3 * i + 1] - pixels[i].g), 6);
    ASSERT_LE(std::abs(decoded.rgb[3 * i + 2] - pixels[i].b), 6);
  }
}

TEST(JpegCodecTest, QualityCostsBytesAndEqualPixelsGiveEqualBytes) {
  const std::vector<Rgba8> pixels = Ramp(256, 256);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string low, EncodeJpeg(256, 256, pixels, {}, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string high, EncodeJpeg(256, 256, pixels, {}, 100));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string again, EncodeJpeg(256, 256, pixels, {}, 100));
  EXPECT_LT(low.size(), high.size() / 2);
  EXPECT_EQ(high, again);
}

TEST(JpegCodecTest, TheBackgroundShowsWhereNothingIs) {
  const std::vector<Rgba8> pixels(64, Rgba8{0, 0, 0, 0});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string jpeg,
                                EncodeJpeg(8, 8, pixels, {250, 250, 250, 255}, 100));
  for (const unsigned char value : Decode(jpeg).rgb) {
    ASSERT_NEAR(value, 250, 2);
  }
}

TEST(JpegCodecTest, OneRowAndOneColumnAreEnough) {
  for (const auto& [width, height] : {std::pair(1, 1), std::pair(1, 700), std::pair(16384, 1)}) {
    const std::vector<Rgba8> pixels = Ramp(width, height);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string jpeg,
                                  EncodeJpeg(width, height, pixels, {}, 90));
    EXPECT_EQ(Decode(jpeg).width, width);
    EXPECT_EQ(Decode(jpeg).height, height);
  }
}

TEST(DecodeJpegTest, GivesTheSizeAndNearlyTheColours) {
  const std::vector<Rgba8> pixels = Ramp(40, 24);
  const absl::StatusOr<std::string> jpeg = EncodeJpeg(40, 24, pixels, {}, 95);
  ISOSCOPE_ASSERT_OK(jpeg);
  const absl::StatusOr<RgbaImage> image = DecodeJpeg(*jpeg);
  ISOSCOPE_ASSERT_OK(image);
  ASSERT_EQ(image->width, 40);
  ASSERT_EQ(image->height, 24);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    EXPECT_NEAR(image->pixels[i].r, pixels[i].r, 6);
    EXPECT_NEAR(image->pixels[i].g, pixels[i].g, 6);
    EXPECT_NEAR(image->pixels[i].b, pixels[i].b, 6);
    EXPECT_EQ(image->pixels[i].a, 255);
  }
}

TEST(DecodeJpegTest, RefusesEveryPrefixAndNoise) {
  const absl::StatusOr<std::string> jpeg = EncodeJpeg(17, 9, Ramp(17, 9), {}, 80);
  ISOSCOPE_ASSERT_OK(jpeg);
  for (std::size_t size = 0; size + 2 < jpeg->size(); ++size) {
    const std::vector<char> exact(jpeg->begin(), jpeg->begin() + static_cast<std::ptrdiff_t>(size));
    EXPECT_THAT(DecodeJpeg(absl::string_view(exact.data(), exact.size())),
                testing::StatusIs(absl::StatusCode::kDataLoss))
        << size;
  }
  EXPECT_THAT(DecodeJpeg("no picture at all"), testing::StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::image
