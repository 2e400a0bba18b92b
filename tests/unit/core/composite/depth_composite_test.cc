#include "core/composite/depth_composite.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "gtest/gtest.h"

#include "core/base/large_pages.h"
#include "core/base/random.h"
#include "core/image/layer_stack.h"
#include "hwy/targets.h"

namespace isoscope::composite {
namespace {

constexpr int kWidth = 67;  // not whole tiles
constexpr int kHeight = 37;

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
    const float depth = kDepths[bits / 3 % kDepths.size()];
    const auto block = static_cast<std::uint32_t>(bits >> 32) % 5 * 4 + agent;
    const auto shade = static_cast<std::uint8_t>(bits >> 40);
    const int x = static_cast<int>(i) % kWidth;
    // Tiles that only some agents touch, and some that none does.
    if (base::RandomBits(seed, 100000 + static_cast<std::uint64_t>(x / 16)) % 3 != 0) {
      image.Set(x, static_cast<int>(i) / kWidth, image::FragmentKey(depth, block),
                {shade, static_cast<std::uint8_t>(agent), 7, 255});
    }
  }
  return image;
}

// The definition, one pixel at a time.
constexpr image::FragmentOrder kOrder{.block_count = 1000, .ties = image::TieRule::kColor};

image::FrameImage Reference(const image::FrameImage& a, const image::FrameImage& b) {
  image::FrameImage out = a;
  for (std::size_t i = 0; i < out.pixel_count(); ++i) {
    if (kOrder.IsBefore(b.keys[i], b.colors[i], a.keys[i], a.colors[i])) {
      out.keys[i] = b.keys[i];
      out.colors[i] = b.colors[i];
    }
  }
  return out;
}

// Expects background at pixels that are not covered, and outside the touched tiles.
void ExpectCoveredWhereDrawn(const image::FrameImage& image) {
  constexpr int kTilePx = image::TileSet::kTilePx;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const std::uint32_t row =
          image.CoveredOf(x / kTilePx, y / kTilePx)[static_cast<std::size_t>(y % kTilePx)];
      if (!image.touched.Contains(x / kTilePx, y / kTilePx) || (row >> x % kTilePx & 1) == 0) {
        ASSERT_EQ(image.keys[image.IndexOf(x, y)], image::kBackgroundKey) << x << ", " << y;
        ASSERT_EQ(image.colors[image.IndexOf(x, y)], image::Rgba8{}) << x << ", " << y;
      }
    }
  }
}

image::FrameImage Composite(const image::FrameImage& a, const image::FrameImage& b) {
  image::FrameImage out = a;
  CompositeInto(b, kOrder, &out);
  return out;
}

TEST(DepthCompositeTest, RowsOfTilesInAnyOrderMakeTheWhole) {
  const image::FrameImage from = MakeImage(11, 1);
  image::FrameImage whole = MakeImage(12, 2);
  image::FrameImage by_row = whole;
  CompositeInto(from, kOrder, &whole);
  for (const int row : {2, 0, 1, 2}) {
    CompositeTileRowInto(from, row, kOrder, &by_row);
  }
  EXPECT_EQ(by_row, whole);
  EXPECT_EQ(by_row.touched, whole.touched);
}

TEST(DepthCompositeTest, LayersOfTwoAgentsAreTheSetOfBothsFragments) {
  const auto images = image::FrameImagePool::Make(0);
  const auto stack = [&] {
    return image::LayerStack(kWidth, kHeight, 2, {.block_count = 1000}, images.get());
  };
  image::LayerStack one = stack();
  image::LayerStack other = stack();
  image::LayerStack expected = stack();
  for (int i = 0; i < 600; ++i) {
    const std::uint64_t bits = base::RandomBits(5, static_cast<std::uint64_t>(i));
    const int x = static_cast<int>(bits % kWidth);
    const int y = static_cast<int>(bits / kWidth % kHeight);
    const auto depth = static_cast<float>(bits >> 20 & 7) / 8;
    const std::uint64_t key =
        image::FragmentKey(depth, static_cast<std::uint32_t>(bits >> 30) % 1000);
    const image::Rgba8 color{static_cast<std::uint8_t>(bits >> 40), 1, 2, 128};
    (i % 2 == 0 ? one : other).Insert(x, y, key, color);
    expected.Insert(x, y, key, color);
  }
  for (int row = 0; row < 3; ++row) {
    CompositeTileRowInto(other, row, &one);
    CompositeTileRowInto(other, row, &one);  // once more: nothing changes
  }
  EXPECT_TRUE(one == expected);
}

TEST(DepthCompositeTest, TheFirstFragmentInTheOrderWinsWithEveryInstructionSet) {
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  const std::int64_t supported = hwy::SupportedTargets();
  for (std::int64_t rest = supported; rest != 0; rest &= rest - 1) {
    hwy::SetSupportedTargetsForTest(rest & -rest);
    SCOPED_TRACE(hwy::TargetName(rest & -rest));
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      const image::FrameImage a = MakeImage(2 * seed, 0);
      const image::FrameImage b = MakeImage(2 * seed + 1, 1);
      const image::FrameImage both = Composite(a, b);
      ASSERT_EQ(both, Reference(a, b)) << "seed " << seed;
      ExpectCoveredWhereDrawn(both);
    }
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

// A block's caps come with the occluders, and its triangles with the visible blocks.
TEST(DepthCompositeTest, FragmentsOfOneBlockInTwoImagesAreDecidedByTheirColours) {
  const image::FrameImage caps = MakeImage(21, 0);
  const image::FrameImage triangles = MakeImage(22, 0);
  int equal_keys = 0;
  for (std::size_t i = 0; i < caps.pixel_count(); ++i) {
    equal_keys +=
        caps.keys[i] == triangles.keys[i] && caps.colors[i] != triangles.colors[i] ? 1 : 0;
  }
  ASSERT_GT(equal_keys, 20);
  const image::FrameImage expected = Reference(caps, triangles);
  EXPECT_TRUE(Reference(triangles, caps) == expected);
  const absl::Cleanup all_targets = [] { hwy::SetSupportedTargetsForTest(0); };
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    EXPECT_TRUE(Composite(caps, triangles) == expected) << hwy::TargetName(target);
    EXPECT_TRUE(Composite(triangles, caps) == expected) << hwy::TargetName(target);
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
      CompositeInto(images[agent], kOrder, &all);
    }
    if (first.width == 0) {
      first = all;
    }
    ASSERT_EQ(all, first);
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST(DepthCompositeTest, ASurfaceAtTheFarPlaneBeatsTheBackground) {
  image::FrameImage surface(1, 1);
  surface.Set(0, 0, image::FragmentKey(1.0F, 9), {1, 2, 3, 255});
  EXPECT_EQ(image::OwnerOf(Composite(image::FrameImage(1, 1), surface).keys[0]), 9U);
  EXPECT_EQ(image::OwnerOf(Composite(surface, image::FrameImage(1, 1)).keys[0]), 9U);
}

TEST(FlattenOverTest, OnlyWhatNoBlockCoversShowsTheBackground) {
  for (const int width : {2, 100}) {
    image::FrameImage image(width, 40);
    image.Set(1, 0, image::FragmentKey(1.0F, 0), {10, 20, 30, 255});
    base::LargePageVector<image::Rgba8> expected(image.pixel_count(), {1, 2, 3, 4});
    expected[1] = {10, 20, 30, 255};
    FlattenOver({1, 2, 3, 4}, &image);
    EXPECT_EQ(image.colors, expected);
  }
}

TEST(FlattenOverTest, APooledImageComesBackClean) {
  const auto pool = image::FrameImagePool::Make(1 << 20);
  {
    image::FrameImage image = pool->Take(50, 50);
    image.Set(20, 20, image::FragmentKey(0.5F, 1), {10, 20, 30, 255});
    FlattenOver({0, 0, 0, 255}, &image);
  }
  EXPECT_EQ(pool->Take(50, 50), image::FrameImage(50, 50));
}

TEST(FlattenOverTest, ATransparentBackgroundChangesNothing) {
  image::FrameImage image(40, 40);
  image.Set(1, 0, image::FragmentKey(0.5F, 7), {10, 20, 30, 255});
  const image::FrameImage before = image;
  FlattenOver({}, &image);
  EXPECT_EQ(image, before);
  EXPECT_EQ(image.touched, before.touched);
}

}  // namespace
}  // namespace isoscope::composite
