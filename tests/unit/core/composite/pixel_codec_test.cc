// The codec of pixels, in three groups:
//
// - Round trips: noise, smooth surfaces, extreme depths, many colours, layers, any order of bands.
// - Sizes: as many bands as the pixels need, and few bytes for a smooth surface.
// - Damage: every truncation and bit flip, and damage behind a checksum that is computed again. The
//   answer is DATA_LOSS, and the image does not change.

#include "core/composite/pixel_codec.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "core/composite/depth_composite.h"
#include "tests/support/status_matchers.h"

namespace isoscope::composite {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr std::size_t kHeaderSize = 56;
constexpr std::size_t kPixelCountOffset = 28;
constexpr std::size_t kFrameSizeOffset = 48;

// Noise: each pixel is covered with this probability, with random content. The worst case for the
// codec.
image::FrameImage MakeNoise(int width, int height, double coverage, std::uint64_t seed) {
  image::FrameImage image(width, height);
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    if (base::RandomUnit(seed, 4 * i) >= coverage) {
      continue;
    }
    const auto depth = static_cast<float>(base::RandomUnit(seed, 4 * i + 1));
    const std::uint64_t bits = base::RandomBits(seed, 4 * i + 2);
    image.Set(static_cast<int>(i) % width, static_cast<int>(i) / width,
              image::FragmentKey(depth, static_cast<std::uint32_t>(bits) % image::kNoOwner),
              {static_cast<std::uint8_t>(bits >> 32), static_cast<std::uint8_t>(bits >> 40),
               static_cast<std::uint8_t>(bits >> 48), 255});
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
      const float depth = 0.5F + 0.0001F * static_cast<float>(x) + 0.0002F * static_cast<float>(y);
      const auto shade = static_cast<std::uint8_t>(x + y);
      image.Set(x, y,
                image::FragmentKey(depth, static_cast<std::uint32_t>(x / 12 + 100 * (y / 12))),
                {shade, static_cast<std::uint8_t>(shade / 2), 9, 255});
    }
  }
  return image;
}

// One surface of as many blocks as there can be.
constexpr image::FragmentOrder kOrder{.block_count = image::kNoOwner,
                                      .ties = image::TieRule::kColor};
constexpr SurfaceCounts kSurfaces{.opaque = 1, .layers = 1};

image::FrameImage Decode(const std::vector<std::string>& bands, int width, int height) {
  image::FrameImage image(width, height);
  for (const std::string& band : bands) {
    ISOSCOPE_EXPECT_OK(DecodePixelsInto(band, kOrder, kSurfaces, &image));
  }
  return image;
}

void ExpectRoundTrip(const image::FrameImage& image) {
  EXPECT_EQ(Decode(EncodePixels(image), image.width, image.height), image)
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
  image.Set(0, 0, image::FragmentKey(0.0F, 0), {0, 255, 0, 255});
  image.Set(1, 0, image::FragmentKey(1.0F, image::kNoOwner - 1), {255, 0, 255, 255});
  image.Set(2, 0, image::FragmentKey(0x1.fffffep-1F, 0), {0, 0, 0, 255});
  ExpectRoundTrip(image);
}

TEST(PixelCodecTest, AnEmptyImageNeedsNoBand) {
  EXPECT_THAT(EncodePixels(image::FrameImage(100, 100)), IsEmpty());
  EXPECT_THAT(EncodePixels(image::FrameImage()), IsEmpty());
  image::FrameImage touched(100, 100);
  touched.touched.InsertAll();
  EXPECT_THAT(EncodePixels(touched), IsEmpty());
}

TEST(PixelCodecTest, TheNearerFragmentStays) {
  image::FrameImage far(2, 1);
  far.Set(0, 0, image::FragmentKey(0.5F, 7), {1, 1, 1, 255});
  far.Set(1, 0, image::FragmentKey(0.5F, 7), {1, 1, 1, 255});
  image::FrameImage into(2, 1);
  into.Set(0, 0, image::FragmentKey(0.25F, 9), {2, 2, 2, 255});
  into.Set(1, 0, image::FragmentKey(0.5F, 9), {2, 2, 2, 255});
  const std::vector<std::string> bands = EncodePixels(far);
  ASSERT_EQ(bands.size(), 1U);
  ISOSCOPE_ASSERT_OK(DecodePixelsInto(bands[0], kOrder, kSurfaces, &into));
  EXPECT_THAT(into.keys, ElementsAre(image::FragmentKey(0.25F, 9),
                                     image::FragmentKey(0.5F, 7)));  // a tie: the lower block
  EXPECT_EQ(into.colors[0].r, 2);
  EXPECT_EQ(into.colors[1].r, 1);
}

TEST(PixelCodecTest, BandsOfALargeImageAreLimitedAndInAnyOrder) {
  const image::FrameImage image = MakeNoise(4000, 300, 1.0, 11);
  std::vector<std::string> bands = EncodePixels(image);
  EXPECT_GT(bands.size(), 3U);
  for (const std::string& band : bands) {
    EXPECT_LE(static_cast<std::int64_t>(band.size()), kMaxBandBytes);
  }
  std::swap(bands.front(), bands.back());
  EXPECT_EQ(Decode(bands, 4000, 300), image);
}

TEST(PixelCodecTest, AnImageHasNoMoreBandsThanItsPixelsNeed) {
  // 10 000 pixels all over the picture: one. A wide picture of noise: as many as their size asks
  // for. Rows without a pixel, before, between and after, are in none.
  EXPECT_EQ(EncodePixels(MakeNoise(1000, 1000, 0.01, 3)).size(), 1U);
  const image::FrameImage wide = MakeNoise(16384, 40, 1.0, 4);
  const std::vector<std::string> bands = EncodePixels(wide);
  EXPECT_EQ(bands.size(), 3U) << "a row of tiles is most of what a band may hold";
  for (const std::string& band : bands) {
    EXPECT_LE(static_cast<std::int64_t>(band.size()), kMaxBandBytes);
  }
  EXPECT_EQ(Decode(bands, wide.width, wide.height), wide);
  image::FrameImage gaps(2048, 1200);
  for (int x = 0; x < gaps.width; ++x) {
    for (int y = 100; y < 110; ++y) {
      gaps.Set(x, y, image::FragmentKey(0.5F, 3), {1, 2, 3, 255});
      gaps.Set(x, 908 + y, image::FragmentKey(0.25F, 4), {4, 5, 6, 255});
    }
  }
  const std::vector<std::string> gap_bands = EncodePixels(gaps);
  EXPECT_EQ(gap_bands.size(), 2U);
  EXPECT_EQ(Decode(gap_bands, gaps.width, gaps.height), gaps);
}

TEST(PixelCodecTest, BandsOfManyImagesCanBeCompositedAtTheSameTimeWithLocks) {
  constexpr int kWidth = 300;
  constexpr int kHeight = 170;
  image::FrameImage expected(kWidth, kHeight);
  std::vector<std::string> bands;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    // Some at all pixels, some at a few.
    const image::FrameImage image = MakeNoise(kWidth, kHeight, seed % 3 == 0 ? 1.0 : 0.1, seed);
    CompositeInto(image, kOrder, &expected);
    for (std::string& band : EncodePixels(image)) {
      bands.push_back(std::move(band));
    }
  }
  for (int round = 0; round < 5; ++round) {
    image::FrameImage into(kWidth, kHeight);
    RowLocks locks(kHeight);
    std::vector<std::thread> threads;
    for (std::size_t first = 0; first < 4; ++first) {
      threads.emplace_back([&, first] {
        for (std::size_t i = first; i < bands.size(); i += 4) {
          ISOSCOPE_EXPECT_OK(DecodePixelsInto(bands[i], kOrder, kSurfaces, &into, &locks));
        }
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    EXPECT_EQ(into, expected);
    EXPECT_EQ(into.touched, expected.touched);
  }
}

TEST(PixelCodecTest, ASmoothSurfaceIsSentInFewBytes) {
  const image::FrameImage image = MakeSmooth(256, 256);
  std::size_t size = 0;
  for (const std::string& band : EncodePixels(image)) {
    size += band.size();
  }
  // 12 bytes a pixel before, about 44000 pixels covered.
  EXPECT_LT(size, 80000U);
}

TEST(PixelCodecTest, EveryTruncationIsDataLossAndLeavesTheImage) {
  const std::string band = EncodePixels(MakeSmooth(40, 30))[0];
  const image::FrameImage before = MakeNoise(40, 30, 0.5, 3);
  image::FrameImage into = before;
  for (std::size_t size = 0; size < band.size(); ++size) {
    // An allocation of exactly this size, so that a sanitizer sees a read past it.
    const std::string cut(band.data(), size);
    ASSERT_THAT(DecodePixelsInto(cut, kOrder, kSurfaces, &into),
                StatusIs(absl::StatusCode::kDataLoss, _))
        << size;
  }
  EXPECT_THAT(DecodePixelsInto(band + "x", kOrder, kSurfaces, &into),
              StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_EQ(into, before);
}

TEST(PixelCodecTest, EveryBitFlipIsDataLossAndLeavesTheImage) {
  std::string band = EncodePixels(MakeSmooth(24, 20))[0];
  const image::FrameImage before = MakeNoise(24, 20, 0.5, 3);
  image::FrameImage into = before;
  for (std::size_t bit = 0; bit < 8 * band.size(); ++bit) {
    band[bit / 8] = static_cast<char>(band[bit / 8] ^ (1 << (bit % 8)));
    ASSERT_THAT(DecodePixelsInto(band, kOrder, kSurfaces, &into),
                StatusIs(absl::StatusCode::kDataLoss, _))
        << bit;
    band[bit / 8] = static_cast<char>(band[bit / 8] ^ (1 << (bit % 8)));
  }
  EXPECT_EQ(into, before);
}

// A hostile sender can compute the checksum, so the content is checked as well.
std::string Sealed(std::string band) {
  base::StoreLittleEndian(base::ExtendCrc32c(0, band.data() + 8, band.size() - 8), band.data() + 4);
  return band;
}

// A band taken apart: header, side information (decompressed), and the rest.
struct Parts {
  std::string header;
  std::string side;
  std::string rest;
};

Parts TakeApart(const std::string& band) {
  const auto frame_size = base::LoadLittleEndian<std::uint32_t>(band.data() + kFrameSizeOffset);
  const absl::string_view bytes(band);
  auto side = base::Decompress(bytes.substr(kHeaderSize, frame_size), 1 << 20);
  ISOSCOPE_EXPECT_OK(side);
  return {band.substr(0, kHeaderSize), *side, band.substr(kHeaderSize + frame_size)};
}

std::string PutTogether(Parts parts) {
  const std::string frame = base::Compress(parts.side);
  base::StoreLittleEndian(static_cast<std::uint32_t>(frame.size()),
                          parts.header.data() + kFrameSizeOffset);
  return Sealed(parts.header + frame + parts.rest);
}

std::uint32_t StatedPixelCount(const std::string& band) {
  return base::LoadLittleEndian<std::uint32_t>(band.data() + kPixelCountOffset);
}

std::uint32_t CoveredCount(const image::FrameImage& image) {
  std::uint32_t count = 0;
  for (const std::uint64_t key : image.keys) {
    count += image::OwnerOf(key) != image::kNoOwner ? 1U : 0U;
  }
  return count;
}

TEST(PixelCodecTest, DamageBehindAValidChecksumNeverReadsOrWritesOutside) {
  std::vector<image::FrameImage> images{MakeNoise(21, 19, 0.2, 8), MakeNoise(21, 19, 1.0, 8),
                                        MakeSmooth(40, 35), MakeNoise(40, 33, 1.0, 9)};
  for (const image::FrameImage& image : images) {
    const std::string band = EncodePixels(image)[0];
    const Parts parts = TakeApart(band);
    ASSERT_EQ(PutTogether(parts), band);
    const image::FrameImage empty(image.width, image.height);
    image::FrameImage into = empty;
    std::int64_t refused = 0;
    const auto try_band = [&](const std::string& damaged) {
      const absl::Status status = DecodePixelsInto(damaged, kOrder, kSurfaces, &into);
      if (status.ok()) {
        // Without a sanitizer, too, a pixel outside would be missing here.
        EXPECT_EQ(CoveredCount(into), StatedPixelCount(damaged));
        into = empty;
        return true;
      }
      ++refused;
      EXPECT_THAT(status, StatusIs(absl::StatusCode::kDataLoss, _));
      EXPECT_EQ(into, empty);
      EXPECT_EQ(into.touched, empty.touched);
      return false;
    };
    for (std::size_t byte = 8; byte < kHeaderSize; ++byte) {
      for (const int flip : {1, 0x80}) {
        Parts damaged = parts;
        damaged.header[byte] = static_cast<char>(damaged.header[byte] ^ flip);
        ASSERT_FALSE(try_band(Sealed(damaged.header + band.substr(kHeaderSize))))
            << "header byte " << byte;
      }
    }
    // Large bands are sampled, because testing every byte would take too long.
    const std::size_t stride = 1 + band.size() / 1500;
    for (std::size_t byte = 0; byte < parts.side.size() + parts.rest.size(); byte += stride) {
      for (const int flip : {1, 0x80}) {
        Parts damaged = parts;
        char& target =
            byte < parts.side.size() ? damaged.side[byte] : damaged.rest[byte - parts.side.size()];
        target = static_cast<char>(target ^ flip);
        try_band(PutTogether(damaged));
      }
    }
    for (std::size_t size = 0; size < parts.side.size(); size += stride) {
      ASSERT_FALSE(try_band(PutTogether({parts.header, parts.side.substr(0, size), parts.rest})));
    }
    for (std::size_t size = 0; size < parts.rest.size(); size += stride) {
      ASSERT_FALSE(try_band(PutTogether({parts.header, parts.side, parts.rest.substr(0, size)})));
    }
    EXPECT_GT(refused, 500);
    // Random bytes in the place of the pixels.
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      Parts damaged = parts;
      for (std::size_t i = 0; i < damaged.rest.size(); ++i) {
        damaged.rest[i] = static_cast<char>(base::RandomBits(seed, i));
      }
      try_band(PutTogether(damaged));
    }
  }
}

// All counts, labels and extra bits stay right: only the check of the masks can refuse it.
TEST(PixelCodecTest, CoverageOutsideTheImageIsRefused) {
  image::FrameImage image(21, 19);
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      image.Set(x, y, image::FragmentKey(0.5F, 3), {1, 2, 3, 255});
    }
  }
  const Parts parts = TakeApart(EncodePixels(image)[0]);
  // Two rows of tiles, a word each, and then the masks: tile 3 has 5 x 3 pixels in the image.
  constexpr std::size_t kLastMask = 2 * 8 + 3 * 32;
  ASSERT_EQ(parts.side.substr(kLastMask, 8), std::string("\x1f\0\x1f\0\x1f\0\0\0", 8));
  for (const std::string& mask : {std::string("\x1f\0\x1f\0\x0f\0\x01\0", 8),   // a row below
                                  std::string("\x1f\0\x1f\0\x2f\0\0\0", 8)}) {  // a column right
    Parts moved = parts;
    moved.side.replace(kLastMask, 8, mask);
    image::FrameImage into(21, 19);
    EXPECT_THAT(DecodePixelsInto(PutTogether(moved), kOrder, kSurfaces, &into),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("outside the image")));
    EXPECT_EQ(into, image::FrameImage(21, 19));
  }
}

TEST(PixelCodecTest, BandsOfOneImageCanBeDecodedAtTheSameTime) {
  const image::FrameImage image = MakeSmooth(500, 700);
  const std::vector<std::string> bands = EncodePixels(image);
  ASSERT_GT(bands.size(), 3U);
  image::FrameImage into(500, 700);
  std::vector<std::thread> threads;
  for (const std::string& band : bands) {
    threads.emplace_back(
        [&] { ISOSCOPE_EXPECT_OK(DecodePixelsInto(band, kOrder, kSurfaces, &into)); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(into, image);
  EXPECT_EQ(into.touched, image.touched);
}

TEST(PixelCodecTest, OnlyTilesWithACoveredPixelBecomeTouched) {
  image::FrameImage image(100, 300);
  image.touched.InsertAll();
  image.Set(99, 299, image::FragmentKey(0.5F, 3), {1, 2, 3, 255});
  image.Set(17, 0, image::FragmentKey(0.25F, 4), {4, 5, 6, 255});
  const image::FrameImage back = Decode(EncodePixels(image), 100, 300);
  EXPECT_EQ(back, image);
  image::TileSet expected(100, 300);
  expected.Insert(6, 18);
  expected.Insert(1, 0);
  EXPECT_EQ(back.touched, expected);
  EXPECT_EQ(back.covered, image.covered);
}

TEST(PixelCodecTest, ManyColoursComeBackWithAndWithoutAPalette) {
  for (const int colors : {1, 2, 255, 256, 257, 2047, 2048, 2049, 20000}) {
    image::FrameImage image(150, 150);
    for (int i = 0; i < 150 * 150; ++i) {
      const int n = i % colors;
      image.Set(i % 150, i / 150, image::FragmentKey(0.5F, 1),
                {static_cast<std::uint8_t>(n), static_cast<std::uint8_t>(n >> 8),
                 static_cast<std::uint8_t>(n * 3), static_cast<std::uint8_t>(255 - n / 7)});
    }
    ExpectRoundTrip(image);
  }
}

TEST(PixelCodecTest, EveryLengthOfADifferenceOfDepthComesBack) {
  // One lone pixel a tile, so that it is predicted from the tile before; both signs.
  for (const std::uint32_t start : {0U, 0x3f800000U, 0x1fffffffU}) {
    image::FrameImage image(16 * 64, 16);
    std::uint32_t bits = start;
    for (int tile = 0; tile < 64; ++tile) {
      const std::uint32_t step =
          tile / 2 < 30 ? (1U << (tile / 2)) - (tile % 2 == 0 ? 0U : 1U) : 7U;
      bits = bits + step <= 0x3f800000U ? bits + step : bits >= step ? bits - step : bits;
      image.Set(16 * tile, 3, std::uint64_t{bits} << 32 | 5U, {1, 2, 3, 255});
    }
    ExpectRoundTrip(image);
  }
}

TEST(PixelCodecTest, LayersComeBackFromAnyAgentsInAnyOrder) {
  constexpr image::FragmentOrder kLayerOrder{.block_count = 50};
  const auto images = image::FrameImagePool::Make(1 << 20);
  const auto make = [&] { return image::LayerStack(70, 40, 3, kLayerOrder, images.get()); };
  std::vector<image::LayerStack> agents;
  image::LayerStack expected = make();
  for (std::uint64_t agent = 0; agent < 3; ++agent) {
    agents.push_back(make());
    for (std::uint64_t i = 0; i < 4000; ++i) {
      const auto below = [&](std::uint64_t which, int end) {
        return static_cast<int>(end * base::RandomUnit(agent, 4 * i + which));
      };
      const auto owner = static_cast<std::uint32_t>(below(0, 150));
      const std::uint64_t key = image::FragmentKey(static_cast<float>(below(1, 40)) / 40, owner);
      const image::Rgba8 color{static_cast<std::uint8_t>(below(2, 200)), 7, 9, 255};
      const int x = static_cast<int>(i % 70);
      const int y = below(3, 40);
      agents.back().Insert(x, y, key, color);
      expected.Insert(x, y, key, color);
    }
  }
  image::LayerStack decoded = make();
  image::FrameImage image(70, 40);
  std::vector<std::string> bands;
  for (const image::LayerStack& agent : agents) {
    for (std::string& band : EncodeLayers(agent)) {
      bands.insert(bands.begin() + static_cast<std::ptrdiff_t>(bands.size() / 2), band);
      bands.push_back(std::move(band));  // twice
    }
  }
  for (const std::string& band : bands) {
    ISOSCOPE_ASSERT_OK(DecodePixelsInto(band, kLayerOrder, {0, 3}, &image, nullptr, &decoded));
  }
  EXPECT_TRUE(decoded == expected);
  EXPECT_EQ(decoded.LayerImages().size(), 3U);
  EXPECT_TRUE(image == image::FrameImage(70, 40)) << "layers are not opaque";
  EXPECT_THAT(EncodeLayers(make()), IsEmpty());
  EXPECT_THAT(EncodeLayers(image::LayerStack()), IsEmpty());
}

// All of a band is right but its owners; a hostile agent can encode and seal it. Tables of surfaces
// are indexed by owners.
TEST(PixelCodecTest, OwnersBeyondTheFramesSurfacesAreDataLossAndLeaveTheImage) {
  constexpr image::FragmentOrder kOf50Blocks{.block_count = 50};
  constexpr SurfaceCounts kOf4And3{.opaque = 4, .layers = 3};
  const auto images = image::FrameImagePool::Make(1 << 20);
  for (const std::uint32_t owner : {0U, 149U, 150U, 199U, 200U, 1U << 31, image::kNoOwner - 1}) {
    image::FrameImage opaque(20, 20);
    image::LayerStack layers(20, 20, 2, kOf50Blocks, images.get());
    for (int x = 0; x < 3; ++x) {  // with good ones beside it
      const std::uint64_t key = image::FragmentKey(0.5F, x == 1 ? owner : 7);
      opaque.Set(x, 3, key, {1, 2, 3, 255});
      layers.Insert(x, 3, key, {1, 2, 3, 255});
    }
    image::FrameImage into(20, 20);
    image::LayerStack into_layers(20, 20, 2, kOf50Blocks, images.get());
    const auto decode = [&](const std::vector<std::string>& bands) {
      return DecodePixelsInto(bands.front(), kOf50Blocks, kOf4And3, &into, nullptr, &into_layers);
    };
    const absl::Status layers_status = decode(EncodeLayers(layers));
    const absl::Status opaque_status = decode(EncodePixels(opaque));
    if (owner < 150) {
      ISOSCOPE_EXPECT_OK(layers_status);
      EXPECT_TRUE(into_layers == layers);
    } else {
      EXPECT_THAT(layers_status, StatusIs(absl::StatusCode::kDataLoss, HasSubstr("150"))) << owner;
      EXPECT_TRUE(into_layers.empty());
    }
    if (owner < 200) {
      ISOSCOPE_EXPECT_OK(opaque_status);
      EXPECT_EQ(into, opaque);
    } else {
      EXPECT_THAT(opaque_status, StatusIs(absl::StatusCode::kDataLoss, HasSubstr("200"))) << owner;
      EXPECT_EQ(into, image::FrameImage(20, 20));
    }
  }
}

TEST(PixelCodecTest, LayersOfAFrameThatHasNoneAreDataLoss) {
  const auto images = image::FrameImagePool::Make(1 << 20);
  image::LayerStack layers(20, 20, 1, {}, images.get());
  layers.Insert(3, 3, image::FragmentKey(0.5F, 0), {1, 2, 3, 255});
  image::FrameImage image(20, 20);
  EXPECT_THAT(DecodePixelsInto(EncodeLayers(layers).front(), {}, kSurfaces, &image),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("translucent")));
}

TEST(PixelCodecTest, ABandOfAnotherImageSizeIsRefused) {
  const std::string band = EncodePixels(MakeSmooth(40, 30))[0];
  image::FrameImage into(30, 40);
  EXPECT_THAT(DecodePixelsInto(band, kOrder, kSurfaces, &into),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("40 x 30 pixels; expected 30 x 40")));
}

}  // namespace
}  // namespace isoscope::composite
