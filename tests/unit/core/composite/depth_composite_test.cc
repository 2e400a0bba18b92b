#include "core/composite/depth_composite.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::composite {
namespace {

using ::testing::ElementsAre;

constexpr int kWidth = 67;  // odd, so that the last run of pixels is cut
constexpr int kHeight = 13;

// An image as one agent draws it: few depths, so that ties between blocks are frequent; the blocks
// of agents are disjoint, as shards are.
image::FrameImage MakeImage(std::uint64_t seed, std::uint32_t agent) {
  image::FrameImage image(kWidth, kHeight);
  constexpr std::array<float, 6> kDepths{-0.0F, 0.0F, 0.25F, 0.5F, 0.75F, 1.0F};
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    const std::uint64_t bits = base::RandomBits(seed, i);
    if (bits % 3 == 0) {
      continue;
    }
    image.depth[i] = kDepths[bits / 3 % kDepths.size()];
    image.block_id[i] = static_cast<std::uint32_t>(bits >> 32) % 5 * 4 + agent;
    const auto shade = static_cast<std::uint8_t>(bits >> 40);
    image.color[i] = {shade, static_cast<std::uint8_t>(agent), 7, 255};
  }
  return image;
}

// By the definition of FragmentKey, one pixel at a time.
image::FrameImage Reference(const image::FrameImage& a, const image::FrameImage& b) {
  image::FrameImage out = a;
  for (std::size_t i = 0; i < out.pixel_count(); ++i) {
    if (image::FragmentKey(b.depth[i], b.block_id[i]) <
        image::FragmentKey(a.depth[i], a.block_id[i])) {
      out.depth[i] = b.depth[i];
      out.block_id[i] = b.block_id[i];
      out.color[i] = b.color[i];
    }
  }
  return out;
}

image::FrameImage Composite(const image::FrameImage& a, const image::FrameImage& b) {
  image::FrameImage out = a;
  CompositeInto(b, &out);
  return out;
}

TEST(DepthCompositeTest, TheSmallerFragmentKeyWins) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const image::FrameImage a = MakeImage(2 * seed, 0);
    const image::FrameImage b = MakeImage(2 * seed + 1, 1);
    ASSERT_EQ(Composite(a, b), Reference(a, b)) << "seed " << seed;
  }
}

TEST(DepthCompositeTest, IsCommutativeAssociativeAndIdempotent) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const image::FrameImage a = MakeImage(3 * seed, 0);
    const image::FrameImage b = MakeImage(3 * seed + 1, 1);
    const image::FrameImage c = MakeImage(3 * seed + 2, 2);
    ASSERT_EQ(Composite(a, b), Composite(b, a));
    ASSERT_EQ(Composite(Composite(a, b), c), Composite(a, Composite(b, c)));
    ASSERT_EQ(Composite(a, a), a);
    ASSERT_EQ(Composite(Composite(a, b), b), Composite(a, b));
  }
}

TEST(DepthCompositeTest, TheOrderOfArrivalDoesNotMatter) {
  std::vector<image::FrameImage> images;
  for (std::uint32_t agent = 0; agent < 4; ++agent) {
    images.push_back(MakeImage(100 + agent, agent));
  }
  std::vector<std::size_t> order(images.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  image::FrameImage first;
  do {
    image::FrameImage all(kWidth, kHeight);
    for (const std::size_t agent : order) {
      CompositeInto(images[agent], &all);
    }
    if (first.width == 0) {
      first = all;
    }
    ASSERT_EQ(all, first);
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST(DepthCompositeTest, MinusZeroTiesWithZeroAndTheBlockDecides) {
  image::FrameImage low(1, 1);
  low.depth[0] = 0.0F;
  low.block_id[0] = 3;
  low.color[0] = {1, 1, 1, 255};
  image::FrameImage high = low;
  high.depth[0] = -0.0F;
  high.block_id[0] = 4;
  high.color[0] = {2, 2, 2, 255};
  EXPECT_EQ(Composite(low, high).block_id[0], 3U);
  EXPECT_EQ(Composite(high, low).block_id[0], 3U);
  EXPECT_EQ(Composite(high, low).color[0].r, 1);
}

TEST(DepthCompositeTest, ASurfaceAtTheFarPlaneBeatsTheBackground) {
  image::FrameImage surface(1, 1);
  surface.block_id[0] = 9;
  EXPECT_EQ(Composite(image::FrameImage(1, 1), surface).block_id[0], 9U);
  EXPECT_EQ(Composite(surface, image::FrameImage(1, 1)).block_id[0], 9U);
}

TEST(FlattenOverTest, OnlyWhatNoBlockCoversShowsTheBackground) {
  image::FrameImage image(2, 1);
  image.block_id[1] = 0;
  image.color[1] = {10, 20, 30, 255};
  image.depth[1] = 1.0F;
  EXPECT_THAT(FlattenOver(image, {1, 2, 3, 4}),
              ElementsAre(image::Rgba8{1, 2, 3, 4}, image::Rgba8{10, 20, 30, 255}));
}

}  // namespace
}  // namespace isoscope::composite
