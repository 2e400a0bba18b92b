#include "core/visibility/occlusion_map.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/compression.h"
#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::visibility {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

constexpr std::size_t kHeaderSize = 20;

view::View MakeView(view::Projection projection = view::Projection::kPerspective,
                    double closeness = 1) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {65, 65, 65};
  view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
  camera.projection = projection;
  camera.eye = camera.target + (camera.eye - camera.target) * closeness;
  auto view = view::View::Make(camera, {64, 64}, geometry);
  ISOSCOPE_EXPECT_OK(view);
  return *std::move(view);
}

// Surfaces with holes, at depths that differ little, so that both answers of a test are frequent.
image::FrameImage MakeImage(int width, int height, std::uint64_t seed, double hole_share) {
  image::FrameImage image(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                     static_cast<std::size_t>(x);
      if (base::RandomUnit(seed, 2 * i) < hole_share) {
        continue;
      }
      image.depth[i] = static_cast<float>(0.3 + 0.2 * std::sin(0.1 * x) * std::cos(0.07 * y) +
                                          0.01 * base::RandomUnit(seed, 2 * i + 1));
      image.block_id[i] = static_cast<std::uint32_t>(i % 5);
    }
  }
  return image;
}

TEST(DepthQuantizerTest, EndsAreZeroAndTheLargestCoveredValue) {
  for (const auto projection : {view::Projection::kPerspective, view::Projection::kOrthographic}) {
    const DepthQuantizer quantizer(MakeView(projection));
    EXPECT_EQ(quantizer.Quantize(0.0F), 0);
    EXPECT_EQ(quantizer.Quantize(-0.0F), 0);
    EXPECT_GE(quantizer.Quantize(1.0F), DepthQuantizer::kUncovered - 2);
    EXPECT_LT(quantizer.Quantize(1.0F), DepthQuantizer::kUncovered);
  }
}

TEST(DepthQuantizerTest, IsLinearInDistance) {
  const view::View view = MakeView(view::Projection::kPerspective, 0.3);
  const DepthQuantizer quantizer(view);
  const double n = view.near_distance();
  const double f = view.far_distance();
  for (double t = 0.001; t < 1; t += 0.001) {
    const double z = n + t * (f - n);
    const double window_depth = f * (z - n) / (z * (f - n));
    EXPECT_NEAR(quantizer.Quantize(static_cast<float>(window_depth)), t * 65534, 8);
  }
}

TEST(DepthQuantizerTest, NeighbouringFloatsNeverChangeOrder) {
  for (const double closeness : {5.0, 1.0, 0.3, 0.01}) {
    for (const auto projection :
         {view::Projection::kPerspective, view::Projection::kOrthographic}) {
      const DepthQuantizer quantizer(MakeView(projection, closeness));
      for (std::uint64_t i = 0; i < 3000; ++i) {
        auto depth = static_cast<float>(base::RandomUnit(1, i));
        if (i % 3 == 0) {
          depth = 1.0F - depth * 1e-4F;
        }
        if (i % 3 == 1) {
          depth *= 1e-4F;
        }
        std::uint16_t previous = quantizer.Quantize(depth);
        for (int step = 0; step < 40 && depth < 1.0F; ++step) {
          depth = std::nextafter(depth, 1.0F);
          const std::uint16_t next = quantizer.Quantize(depth);
          ASSERT_GE(next, previous) << depth;
          previous = next;
        }
      }
      std::uint16_t previous = 0;
      for (std::uint32_t bits = 0; bits <= 0x3f800000; bits += 4093) {
        const std::uint16_t next = quantizer.Quantize(std::bit_cast<float>(bits));
        ASSERT_GE(next, previous);
        previous = next;
      }
    }
  }
}

// What Hides promises, said over texels.
bool HidesByBruteForce(const image::FrameImage& image, const DepthQuantizer& quantizer,
                       MapKind kind, int level, const view::Footprint& footprint) {
  const view::PixelRect& rect = footprint.rect;
  const int size = 1 << level;
  const int begin_x = rect.begin_x / size * size;
  const int begin_y = rect.begin_y / size * size;
  const int end_x = std::min((rect.end_x + size - 1) / size * size, image.width);
  const int end_y = std::min((rect.end_y + size - 1) / size * size, image.height);
  for (int y = begin_y; y < end_y; ++y) {
    for (int x = begin_x; x < end_x; ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                     static_cast<std::size_t>(x);
      if (image.block_id[i] == image::kNoBlock) {
        return false;
      }
      if (kind == MapKind::kDepth &&
          quantizer.Quantize(image.depth[i]) >= quantizer.Quantize(footprint.nearest_depth)) {
        return false;
      }
    }
  }
  return true;
}

view::Footprint RandomFootprint(int width, int height, std::uint64_t seed, std::uint64_t n) {
  view::Footprint footprint;
  const double largest = n % 4 == 0 ? 1.0 : 0.15;
  const auto side = [&](std::uint64_t k, int size) {
    const int length =
        1 + static_cast<int>(base::RandomUnit(seed, 8 * n + k) * largest * (size - 1));
    const int begin = static_cast<int>(base::RandomUnit(seed, 8 * n + k + 1) * (size - length + 1));
    return std::pair<int, int>{begin, begin + length};
  };
  std::tie(footprint.rect.begin_x, footprint.rect.end_x) = side(0, width);
  std::tie(footprint.rect.begin_y, footprint.rect.end_y) = side(2, height);
  footprint.nearest_depth = static_cast<float>(0.05 + 0.6 * base::RandomUnit(seed, 8 * n + 4));
  return footprint;
}

TEST(OcclusionMapTest, HidesExactlyWhatEveryTexelHides) {
  const DepthQuantizer quantizer(MakeView());
  int hidden = 0;
  int shown = 0;
  for (const auto& [width, height] :
       std::vector<std::pair<int, int>>{{1, 1}, {1, 50}, {64, 64}, {131, 77}, {200, 3}}) {
    for (const double hole_share : {0.0, 0.0005, 0.5}) {
      const image::FrameImage image =
          MakeImage(width, height, static_cast<std::uint64_t>(width), hole_share);
      for (const MapKind kind : {MapKind::kDepth, MapKind::kMask}) {
        for (const int level : {0, 1, 2, 3, 5, 14}) {
          const OcclusionMap map = OcclusionMap::FromImage(image, quantizer, kind, level);
          for (std::uint64_t n = 0; n < 120; ++n) {
            const view::Footprint footprint = RandomFootprint(width, height, 77, n);
            const bool expected = HidesByBruteForce(image, quantizer, kind, level, footprint);
            ASSERT_EQ(map.Hides(footprint, quantizer), expected)
                << width << " x " << height << " level " << level << " case " << n;
            ++(expected ? hidden : shown);
          }
        }
      }
    }
  }
  EXPECT_GT(hidden, 2000);
  EXPECT_GT(shown, 2000);
}

TEST(OcclusionMapTest, NothingThatCouldWinAPixelIsHidden) {
  // Without the quantizer: exact depths against what Hides and HidesFragment say.
  const DepthQuantizer quantizer(MakeView());
  const image::FrameImage image = MakeImage(90, 70, 5, 0.0);
  int fragments_hidden = 0;
  for (const int level : {0, 2}) {
    const OcclusionMap map = OcclusionMap::FromImage(image, quantizer, MapKind::kDepth, level);
    for (std::uint64_t n = 0; n < 3000; ++n) {
      const view::Footprint footprint = RandomFootprint(90, 70, 6, n);
      const bool hides = map.Hides(footprint, quantizer);
      for (int y = footprint.rect.begin_y; y < footprint.rect.end_y; ++y) {
        for (int x = footprint.rect.begin_x; x < footprint.rect.end_x; ++x) {
          const float nearest_drawn = image.depth[static_cast<std::size_t>(y * 90 + x)];
          if (hides) {
            ASSERT_GT(footprint.nearest_depth, nearest_drawn);
          }
          if (map.HidesFragment(x, y, footprint.nearest_depth, quantizer)) {
            ++fragments_hidden;
            ASSERT_GT(footprint.nearest_depth, nearest_drawn);
          }
        }
      }
    }
  }
  EXPECT_GT(fragments_hidden, 1000);
}

TEST(OcclusionMapTest, EqualDepthIsNotHidden) {
  const DepthQuantizer quantizer(MakeView());
  image::FrameImage image(1, 1);
  image.depth[0] = 0.5F;
  image.block_id[0] = 0;
  const OcclusionMap map = OcclusionMap::FromImage(image, quantizer, MapKind::kDepth, 0);
  EXPECT_FALSE(map.Hides({{0, 0, 1, 1}, 0.5F}, quantizer));
  EXPECT_FALSE(map.HidesFragment(0, 0, 0.5F, quantizer));
  EXPECT_TRUE(map.Hides({{0, 0, 1, 1}, 0.51F}, quantizer));
}

TEST(OcclusionMapTest, TheDefaultMapHidesNothing) {
  const DepthQuantizer quantizer(MakeView());
  const OcclusionMap nothing;
  EXPECT_FALSE(nothing.Hides({{}, 1.0F}, quantizer));
  EXPECT_FALSE(nothing.HidesFragment(3, 3, 1.0F, quantizer));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OcclusionMap back,
                                OcclusionMap::Decode(nothing.Encode(), {64, 64}));
  EXPECT_FALSE(back.Hides({{0, 0, 1, 1}, 1.0F}, quantizer));
}

TEST(OcclusionMapTest, AnEmptyFootprintIsHiddenAndAMaskSpeaksOfNoFragment) {
  const DepthQuantizer quantizer(MakeView());
  const image::FrameImage image = MakeImage(20, 20, 1, 0.0);
  const OcclusionMap mask = OcclusionMap::FromImage(image, quantizer, MapKind::kMask, 0);
  EXPECT_TRUE(mask.Hides({{}, 0.0F}, quantizer));
  EXPECT_FALSE(mask.HidesFragment(5, 5, 1.0F, quantizer));
}

TEST(OcclusionMapTest, WhatIsSentAnswersTheSame) {
  const DepthQuantizer quantizer(MakeView());
  for (const auto& [width, height] :
       std::vector<std::pair<int, int>>{{1, 1}, {131, 77}, {64, 64}, {3, 200}}) {
    const image::FrameImage image = MakeImage(width, height, 2, 0.001);
    for (const MapKind kind : {MapKind::kDepth, MapKind::kMask}) {
      for (const int level : {0, 2, 14}) {
        const OcclusionMap map = OcclusionMap::FromImage(image, quantizer, kind, level);
        const std::string bytes = map.Encode();
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OcclusionMap back,
                                      OcclusionMap::Decode(bytes, {width, height}));
        EXPECT_EQ(back.Encode(), bytes);
        for (std::uint64_t n = 0; n < 200; ++n) {
          const view::Footprint footprint = RandomFootprint(width, height, 9, n);
          ASSERT_EQ(back.Hides(footprint, quantizer), map.Hides(footprint, quantizer));
          ASSERT_EQ(back.HidesFragment(footprint.rect.begin_x, footprint.rect.begin_y,
                                       footprint.nearest_depth, quantizer),
                    map.HidesFragment(footprint.rect.begin_x, footprint.rect.begin_y,
                                      footprint.nearest_depth, quantizer));
        }
      }
    }
  }
}

TEST(OcclusionMapTest, EveryTruncationAndBitFlipIsDataLoss) {
  const DepthQuantizer quantizer(MakeView());
  const image::FrameImage image = MakeImage(40, 30, 2, 0.1);
  std::string bytes = OcclusionMap::FromImage(image, quantizer, MapKind::kDepth, 2).Encode();
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    const std::string cut(bytes.data(), size);
    ASSERT_THAT(OcclusionMap::Decode(cut, {40, 30}), StatusIs(absl::StatusCode::kDataLoss, _));
  }
  EXPECT_THAT(OcclusionMap::Decode(bytes + "x", {40, 30}),
              StatusIs(absl::StatusCode::kDataLoss, _));
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << (bit % 8)));
    ASSERT_THAT(OcclusionMap::Decode(bytes, {40, 30}), StatusIs(absl::StatusCode::kDataLoss, _));
    bytes[bit / 8] = static_cast<char>(bytes[bit / 8] ^ (1 << (bit % 8)));
  }
}

TEST(OcclusionMapTest, DamageBehindAValidChecksumIsRefused) {
  const DepthQuantizer quantizer(MakeView());
  const std::string bytes =
      OcclusionMap::FromImage(MakeImage(40, 30, 2, 0.1), quantizer, MapKind::kDepth, 1).Encode();
  const auto sealed = [](std::string map) {
    base::StoreLittleEndian(base::ExtendCrc32c(0, map.data() + 8, map.size() - 8), map.data() + 4);
    return map;
  };
  for (std::size_t byte = 8; byte < kHeaderSize; ++byte) {
    std::string damaged = bytes;
    damaged[byte] = static_cast<char>(damaged[byte] ^ 0x40);
    EXPECT_FALSE(OcclusionMap::Decode(sealed(damaged), {40, 30}).ok()) << "byte " << byte;
  }
  for (const std::size_t size : {std::size_t{0}, std::size_t{599}, std::size_t{601}}) {
    EXPECT_THAT(OcclusionMap::Decode(
                    sealed(bytes.substr(0, kHeaderSize) + base::Compress(std::string(size, 'x'))),
                    {40, 30}),
                StatusIs(absl::StatusCode::kDataLoss, _));
  }
  for (std::size_t byte = kHeaderSize; byte < bytes.size(); ++byte) {
    std::string damaged = bytes;
    damaged[byte] = static_cast<char>(damaged[byte] ^ 0x11);
    // Either refused or some other map of the right size: a sanitizer sees anything worse.
    const auto map = OcclusionMap::Decode(sealed(damaged), {40, 30});
    if (map.ok()) {
      EXPECT_FALSE(map->Encode().empty());
    } else {
      EXPECT_THAT(map, StatusIs(absl::StatusCode::kDataLoss, _));
    }
  }
}

TEST(OcclusionMapTest, AMapOfAnotherViewportIsRefused) {
  const DepthQuantizer quantizer(MakeView());
  const std::string bytes =
      OcclusionMap::FromImage(MakeImage(40, 30, 2, 0.1), quantizer, MapKind::kDepth, 1).Encode();
  EXPECT_THAT(
      OcclusionMap::Decode(bytes, {30, 40}),
      StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("40 x 30 pixels; expected 30 x 40")));
}

}  // namespace
}  // namespace isoscope::visibility
