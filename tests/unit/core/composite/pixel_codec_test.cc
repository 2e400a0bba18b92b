#include "core/composite/pixel_codec.h"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::composite {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::size_t kHeaderSize = 40;

// Noise: each pixel covered with this probability, anything in it. The worst case for the codec.
image::FrameImage MakeNoise(int width, int height, double coverage, std::uint64_t seed) {
  image::FrameImage image(width, height);
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    if (base::RandomUnit(seed, 4 * i) >= coverage) {
      continue;
    }
    image.depth[i] = static_cast<float>(base::RandomUnit(seed, 4 * i + 1));
    const std::uint64_t bits = base::RandomBits(seed, 4 * i + 2);
    image.block_id[i] = static_cast<std::uint32_t>(bits) % image::kNoBlock;
    image.color[i] = {static_cast<std::uint8_t>(bits >> 32), static_cast<std::uint8_t>(bits >> 40),
                      static_cast<std::uint8_t>(bits >> 48), 255};
  }
  return image;
}

// Patches of a smooth surface, a block for every 12 pixels.
image::FrameImage MakeSmooth(int width, int height) {
  image::FrameImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      if ((x / 20 + y / 15) % 3 == 0) {
        continue;
      }
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                     static_cast<std::size_t>(x);
      image.depth[i] = 0.5F + 0.0001F * static_cast<float>(x) + 0.0002F * static_cast<float>(y);
      image.block_id[i] = static_cast<std::uint32_t>(x / 12 + 100 * (y / 12));
      const auto shade = static_cast<std::uint8_t>(x + y);
      image.color[i] = {shade, static_cast<std::uint8_t>(shade / 2), 9, 255};
    }
  }
  return image;
}

image::FrameImage Decode(const std::vector<std::string>& bands, int width, int height) {
  image::FrameImage image(width, height);
  for (const std::string& band : bands) {
    ISOSCOPE_EXPECT_OK(DecodePixelsInto(band, &image));
  }
  return image;
}

void ExpectRoundTrip(const image::FrameImage& image) {
  EXPECT_EQ(Decode(EncodePixels(image, nullptr), image.width, image.height), image)
      << image.width << " x " << image.height;
}

TEST(PixelCodecTest, EveryPixelComesBack) {
  for (const auto& [width, height] : std::vector<std::pair<int, int>>{
           {1, 1}, {7, 9}, {8, 8}, {9, 7}, {64, 64}, {65, 63}, {200, 3}, {3, 200}, {131, 127}}) {
    for (const double coverage : {0.0, 0.01, 0.3, 0.9, 1.0}) {
      ExpectRoundTrip(MakeNoise(width, height, coverage, static_cast<std::uint64_t>(width)));
    }
    ExpectRoundTrip(MakeSmooth(width, height));
  }
}

TEST(PixelCodecTest, ExtremeValuesComeBack) {
  image::FrameImage image(3, 1);
  image.depth = {0.0F, 1.0F, 0x1.fffffep-1F};
  image.block_id = {0, image::kNoBlock - 1, 0};
  image.color = {{0, 255, 0, 255}, {255, 0, 255, 255}, {0, 0, 0, 255}};
  ExpectRoundTrip(image);
  image.depth[0] = -0.0F;
  ExpectRoundTrip(image);
}

TEST(PixelCodecTest, AnEmptyImageNeedsNoBand) {
  EXPECT_THAT(EncodePixels(image::FrameImage(100, 100), nullptr), IsEmpty());
  EXPECT_THAT(EncodePixels(image::FrameImage(), nullptr), IsEmpty());
  EXPECT_THAT(EncodePixels(MakeSmooth(50, 50), [](int, int) { return false; }), IsEmpty());
}

TEST(PixelCodecTest, OnlyWantedPixelsAreSent) {
  const image::FrameImage image = MakeNoise(50, 40, 0.7, 5);
  const auto wanted = [](int x, int y) { return (x * 7 + y) % 3 == 0 && x != 20; };
  image::FrameImage expected(50, 40);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 50; ++x) {
      const auto i = static_cast<std::size_t>(y * 50 + x);
      if (wanted(x, y)) {
        expected.depth[i] = image.depth[i];
        expected.block_id[i] = image.block_id[i];
        expected.color[i] = image.color[i];
      }
    }
  }
  EXPECT_EQ(Decode(EncodePixels(image, wanted), 50, 40), expected);
}

TEST(PixelCodecTest, TheNearerFragmentStays) {
  image::FrameImage far(2, 1);
  far.depth = {0.5F, 0.5F};
  far.block_id = {7, 7};
  far.color = {{1, 1, 1, 255}, {1, 1, 1, 255}};
  image::FrameImage into(2, 1);
  into.depth = {0.25F, 0.5F};
  into.block_id = {9, 9};
  into.color = {{2, 2, 2, 255}, {2, 2, 2, 255}};
  const std::vector<std::string> bands = EncodePixels(far, nullptr);
  ASSERT_EQ(bands.size(), 1U);
  ISOSCOPE_ASSERT_OK(DecodePixelsInto(bands[0], &into));
  EXPECT_EQ(into.block_id, (std::vector<std::uint32_t>{9, 7}));  // a tie: the lower block
  EXPECT_EQ(into.depth, (std::vector<float>{0.25F, 0.5F}));
  EXPECT_EQ(into.color[1].r, 1);
}

TEST(PixelCodecTest, BandsOfALargeImageAreLimitedAndInAnyOrder) {
  const image::FrameImage image = MakeNoise(4000, 300, 1.0, 11);
  std::vector<std::string> bands = EncodePixels(image, nullptr);
  EXPECT_GT(bands.size(), 3U);
  for (const std::string& band : bands) {
    // Noise does not compress; Zstandard adds a few bytes.
    EXPECT_LT(static_cast<std::int64_t>(band.size()), kMaxBandBytes + kMaxBandBytes / 128);
  }
  std::swap(bands.front(), bands.back());
  EXPECT_EQ(Decode(bands, 4000, 300), image);
}

TEST(PixelCodecTest, ASmoothSurfaceIsSentInFewBytes) {
  const image::FrameImage image = MakeSmooth(256, 256);
  std::size_t size = 0;
  for (const std::string& band : EncodePixels(image, nullptr)) {
    size += band.size();
  }
  // 12 bytes a pixel before, about 44000 pixels covered.
  EXPECT_LT(size, 80000U);
}

TEST(PixelCodecTest, EveryTruncationIsDataLossAndLeavesTheImage) {
  const std::string band = EncodePixels(MakeSmooth(40, 30), nullptr)[0];
  const image::FrameImage before = MakeNoise(40, 30, 0.5, 3);
  image::FrameImage into = before;
  for (std::size_t size = 0; size < band.size(); ++size) {
    // An allocation of exactly this size, so that a sanitizer sees a read past it.
    const std::string cut(band.data(), size);
    ASSERT_THAT(DecodePixelsInto(cut, &into), StatusIs(absl::StatusCode::kDataLoss, _)) << size;
  }
  EXPECT_THAT(DecodePixelsInto(band + "x", &into), StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_EQ(into, before);
}

TEST(PixelCodecTest, EveryBitFlipIsDataLossAndLeavesTheImage) {
  std::string band = EncodePixels(MakeSmooth(24, 20), nullptr)[0];
  const image::FrameImage before = MakeNoise(24, 20, 0.5, 3);
  image::FrameImage into = before;
  for (std::size_t bit = 0; bit < 8 * band.size(); ++bit) {
    band[bit / 8] = static_cast<char>(band[bit / 8] ^ (1 << (bit % 8)));
    ASSERT_THAT(DecodePixelsInto(band, &into), StatusIs(absl::StatusCode::kDataLoss, _)) << bit;
    band[bit / 8] = static_cast<char>(band[bit / 8] ^ (1 << (bit % 8)));
  }
  EXPECT_EQ(into, before);
}

// A sender that means harm can compute the checksum: what is behind it is still checked.
std::string Sealed(std::string header, const std::string& payload) {
  header.resize(kHeaderSize);
  std::string band = header + base::Compress(payload);
  base::StoreLittleEndian(base::ExtendCrc32c(0, band.data() + 8, band.size() - 8), band.data() + 4);
  return band;
}

TEST(PixelCodecTest, DamageBehindAValidChecksumNeverReadsOrWritesOutside) {
  for (const double coverage : {0.2, 1.0}) {
    const image::FrameImage image = MakeNoise(21, 19, coverage, 8);
    const std::string band = EncodePixels(image, nullptr)[0];
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::string payload,
        base::Decompress(absl::string_view(band).substr(kHeaderSize), 1 << 20));
    std::int64_t refused = 0;
    for (std::size_t byte = 8; byte < kHeaderSize + payload.size(); ++byte) {
      for (const int flip : {1, 0x80}) {
        std::string header = band.substr(0, kHeaderSize);
        std::string body = payload;
        char& target = byte < kHeaderSize ? header[byte] : body[byte - kHeaderSize];
        target = static_cast<char>(target ^ flip);
        image::FrameImage into(21, 19);
        const absl::Status status = DecodePixelsInto(Sealed(header, body), &into);
        if (!status.ok()) {
          ++refused;
          ASSERT_THAT(status, StatusIs(absl::StatusCode::kDataLoss, _));
          ASSERT_EQ(into, image::FrameImage(21, 19));
        }
        if (byte < kHeaderSize) {
          ASSERT_FALSE(status.ok()) << "header byte " << byte;
        }
      }
    }
    EXPECT_GT(refused, 0);
    for (std::size_t size = 0; size < payload.size(); ++size) {
      image::FrameImage into(21, 19);
      ASSERT_THAT(
          DecodePixelsInto(Sealed(band.substr(0, kHeaderSize), payload.substr(0, size)), &into),
          StatusIs(absl::StatusCode::kDataLoss, _));
    }
  }
}

TEST(PixelCodecTest, ABandOfAnotherImageSizeIsRefused) {
  const std::string band = EncodePixels(MakeSmooth(40, 30), nullptr)[0];
  image::FrameImage into(30, 40);
  EXPECT_THAT(DecodePixelsInto(band, &into),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("40 x 30 pixels; expected 30 x 40")));
}

}  // namespace
}  // namespace isoscope::composite
