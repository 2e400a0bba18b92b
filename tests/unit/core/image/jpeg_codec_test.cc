#include "core/image/jpeg_codec.h"

#include <cstdio>
// jpeglib.h needs cstdio's FILE.
#include <jpeglib.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::image {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

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

// Every third pixel shows the background.
std::vector<Rgba8> RampWithHoles(int width, int height) {
  std::vector<Rgba8> pixels = Ramp(width, height);
  for (std::size_t i = 0; i < pixels.size(); i += 3) {
    pixels[i].a = 0;
  }
  return pixels;
}

TEST(JpegRowWriterTest, RowsInPiecesGiveTheBytesOfTheWhole) {
  constexpr Rgba8 kBackground{200, 10, 90, 0};
  for (const auto& [width, height] : {std::pair(1, 1), {37, 61}, {1000, 64}, {3, 500}}) {
    const std::vector<Rgba8> pixels = RampWithHoles(width, height);
    const auto row_size = static_cast<std::size_t>(width);
    for (const int quality : {1, 90, 100}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string whole,
                                    EncodeJpeg(width, height, pixels, kBackground, quality));
      for (const int first_rows : {0, 1, 7, 8, 9, 33}) {
        for (const int rows : {1, 5, 8, 16, 499}) {
          JpegRowWriter writer(width, height, kBackground, quality);
          std::string joined;
          for (int y = 0, count = first_rows; y < height; y += count, count = rows) {
            count = std::min(count, height - y);
            ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                          writer.Append(std::span(pixels).subspan(
                                              static_cast<std::size_t>(y) * row_size,
                                              static_cast<std::size_t>(count) * row_size)));
            joined += bytes;
          }
          EXPECT_TRUE(joined == whole)
              << width << " x " << height << ", " << first_rows << " rows, then " << rows;
        }
      }
    }
  }
}

// Symptom: a picture in bands was kept as pixels until its last row was there.
TEST(JpegRowWriterTest, BytesComeWithTheirRows) {
  constexpr int kSide = 512;
  std::vector<Rgba8> noise(std::size_t{kSide} * kSide);
  std::uint32_t state = 1;
  for (Rgba8& pixel : noise) {
    state = state * 1664525 + 1013904223;
    pixel = {static_cast<std::uint8_t>(state >> 24), static_cast<std::uint8_t>(state >> 16),
             static_cast<std::uint8_t>(state >> 8), 255};
  }
  JpegRowWriter writer(kSide, kSide, {}, 95);
  const auto half = std::span<const Rgba8>(noise).first(noise.size() / 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string first, writer.Append(half));
  JpegRowWriter moved = std::move(writer);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string second,
                                moved.Append(std::span<const Rgba8>(noise).last(half.size())));
  EXPECT_GT(first.size(), second.size() * 4 / 5);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string nothing, moved.Append({}));
  EXPECT_TRUE(nothing.empty());
  ISOSCOPE_EXPECT_OK(DecodeJpeg(first + second));
}

TEST(JpegRowWriterTest, APictureThatIsNotCompleteOrNotBegunIsGivenUp) {
  const std::vector<Rgba8> pixels = Ramp(64, 64);
  const JpegRowWriter unused(64, 64, {}, 90);
  JpegRowWriter begun(64, 64, {}, 90);
  ISOSCOPE_EXPECT_OK(begun.Append(std::span(pixels).first(std::size_t{64} * 20)));
}

TEST(JpegRowWriterTest, MoreThanLibjpegTakesIsAnErrorThatStays) {
  constexpr int kTooWide = 65501;
  const std::vector<Rgba8> row(kTooWide);
  JpegRowWriter writer(kTooWide, 2, {}, 90);
  for (int i = 0; i < 2; ++i) {
    EXPECT_THAT(writer.Append(row), StatusIs(absl::StatusCode::kResourceExhausted,
                                             HasSubstr("JPEG of 65501 x 2 pixels: ")));
  }
}

TEST(JpegRowWriterDeathTest, RowsOfAnotherSizeAndTooManyRowsEndTheProgram) {
  const std::vector<Rgba8> pixels = Ramp(8, 9);
  JpegRowWriter writer(8, 8, {}, 90);
  EXPECT_DEATH(writer.Append(std::span(pixels).first(12)).IgnoreError(), "rows.size");
  EXPECT_DEATH(writer.Append(pixels).IgnoreError(), "row_count");
  EXPECT_DEATH(JpegRowWriter(0, 8, {}, 90), "width");
  EXPECT_DEATH(JpegRowWriter(8, 0, {}, 90), "height");
  EXPECT_DEATH(JpegRowWriter(8, 8, {}, 101), "quality");
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
                StatusIs(absl::StatusCode::kDataLoss))
        << size;
  }
  EXPECT_THAT(DecodeJpeg("no picture at all"), StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::image
