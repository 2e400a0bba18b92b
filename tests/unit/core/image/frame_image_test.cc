#include "core/image/frame_image.h"

#include <cstddef>
#include <cstdint>
#include <utility>

#include "gtest/gtest.h"

#include "core/base/memory_info.h"

namespace isoscope::image {
namespace {

TEST(FragmentKeyTest, NearerWinsThenTheLowerBlockThenAnythingOverBackground) {
  EXPECT_LT(FragmentKey(0.25F, 9), FragmentKey(0.5F, 1));
  EXPECT_LT(FragmentKey(0.5F, 1), FragmentKey(0.5F, 2));
  EXPECT_LT(FragmentKey(0.0F, 0), FragmentKey(1e-45F, 0));
  EXPECT_LT(FragmentKey(1.0F, kNoOwner - 1), FragmentKey(kFarDepth, kNoOwner));
}

TEST(FragmentKeyTest, NegativeZeroIsZero) {
  EXPECT_EQ(FragmentKey(-0.0F, 3), FragmentKey(0.0F, 3));
}

TEST(FragmentKeyTest, DepthAndBlockComeBack) {
  const std::uint64_t key = FragmentKey(0.375F, 12);
  EXPECT_EQ(DepthOf(key), 0.375F);
  EXPECT_EQ(OwnerOf(key), 12u);
}

TEST(FrameImageTest, StartsAsBackgroundWithNothingTouched) {
  const FrameImage image(3, 2);
  EXPECT_EQ(image.pixel_count(), 6u);
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    EXPECT_EQ(image.keys[i], kBackgroundKey);
    EXPECT_EQ(image.colors[i], Rgba8{});
  }
  EXPECT_EQ(image.touched, TileSet(3, 2));
}

TEST(FrameImageTest, SetTouchesTheTileOfThePixel) {
  FrameImage image(40, 40);
  image.Set(39, 17, FragmentKey(0.5F, 7), {1, 2, 3, 255});
  EXPECT_EQ(image.keys[image.IndexOf(39, 17)], FragmentKey(0.5F, 7));
  TileSet expected(40, 40);
  expected.Insert(2, 1);
  EXPECT_EQ(image.touched, expected);
  TileMask mask{};
  mask[1] = 1U << 7;
  EXPECT_EQ(image.CoveredOf(2, 1), mask);
  EXPECT_EQ(image.CoveredOf(0, 0), TileMask{});
}

TEST(FrameImageTest, CoverAllCoversThePixelsInsideTheImageOnly) {
  FrameImage image(20, 17);
  image.CoverAll();
  TileSet tiles(20, 17);
  tiles.InsertAll();
  EXPECT_EQ(image.touched, tiles);
  TileMask mask;
  mask.fill(0xffff);
  EXPECT_EQ(image.CoveredOf(0, 0), mask);
  mask.fill(0x000f);
  EXPECT_EQ(image.CoveredOf(1, 0), mask);
  mask = {0xffff};
  EXPECT_EQ(image.CoveredOf(0, 1), mask);
  mask = {0x000f};
  EXPECT_EQ(image.CoveredOf(1, 1), mask);
}

TEST(FrameImagePoolTest, WhatWasWrittenAllOverComesBackAsBackground) {
  const auto pool = FrameImagePool::Make(1 << 20);
  {
    FrameImage image = pool->Take(50, 33);
    image.keys.assign(image.keys.size(), FragmentKey(0.5F, 1));
    image.colors.assign(image.colors.size(), Rgba8{1, 2, 3, 4});
    image.CoverAll();
  }
  const FrameImage again = pool->Take(50, 33);
  EXPECT_EQ(again, FrameImage(50, 33));
  EXPECT_EQ(again.covered, FrameImage(50, 33).covered);
}

TEST(FrameImagePoolTest, AnImageComesBackAsBackgroundWithoutNewMemory) {
  const auto pool = FrameImagePool::Make(1 << 20);
  const std::uint64_t* planes = nullptr;
  {
    FrameImage image = pool->Take(50, 33);
    planes = image.keys.data();
    for (int y = 0; y < 33; ++y) {
      for (int x = 0; x < 50; ++x) {
        image.Set(x, y, FragmentKey(0.25F, 3), {9, 9, 9, 255});
      }
    }
    const FrameImage moved = std::move(image);  // returns to the pool once, from its new place
  }
  const FrameImage again = pool->Take(50, 33);
  EXPECT_EQ(again.keys.data(), planes);
  EXPECT_EQ(again, FrameImage(50, 33));
  EXPECT_EQ(again.touched, TileSet(50, 33));
  EXPECT_EQ(again.covered, FrameImage(50, 33).covered);
}

TEST(FrameImagePoolTest, ImagesInUseAreNeverShared) {
  const auto pool = FrameImagePool::Make(1 << 20);
  const FrameImage a = pool->Take(8, 8);
  const FrameImage b = pool->Take(8, 8);
  EXPECT_NE(a.keys.data(), b.keys.data());
}

TEST(FrameImagePoolTest, AnotherSizeIsAnotherImage) {
  const auto pool = FrameImagePool::Make(1 << 20);
  { const FrameImage small = pool->Take(8, 8); }
  const FrameImage large = pool->Take(8, 9);
  EXPECT_EQ(large.pixel_count(), 72u);
  EXPECT_EQ(large.keys.size(), 72u);
}

TEST(FrameImagePoolTest, MoreThanItMayKeepIsFreed) {
  // One image of 8 x 8 takes 8 * 8 * 12 bytes.
  const auto pool = FrameImagePool::Make(800);
  const std::uint64_t* last = nullptr;
  {
    FrameImage a = pool->Take(8, 8);
    FrameImage b = pool->Take(8, 8);
    last = a.keys.data();  // b goes back first, then a takes its place
  }
  const FrameImage kept = pool->Take(8, 8);
  EXPECT_EQ(kept.keys.data(), last);
}

TEST(FrameImagePoolTest, APreparedImageIsResidentBeforeItIsTaken) {
  constexpr int kSidePx = 2048;
  constexpr std::size_t kBytes = std::size_t{kSidePx} * kSidePx * 12;
  constexpr std::size_t kSlack = kBytes / 4;  // for other memory of the process
  const auto pool = FrameImagePool::Make(2 * kBytes);
  const std::size_t before = base::ResidentBytes();
  pool->Prepare(kSidePx, kSidePx);
  const std::size_t prepared = base::ResidentBytes();
  EXPECT_GE(prepared + kSlack, before + kBytes);
  FrameImage image = pool->Take(kSidePx, kSidePx);
  EXPECT_EQ(image.keys, FrameImage(kSidePx, kSidePx).keys);
  image.keys.assign(image.keys.size(), 0);
  image.colors.assign(image.colors.size(), Rgba8{1, 1, 1, 1});
  EXPECT_LE(base::ResidentBytes(), prepared + kSlack) << "it was not taken from what is there";
}

TEST(FrameImagePoolTest, NothingIsPreparedThatMayNotBeKept) {
  constexpr int kSidePx = 2048;
  constexpr std::size_t kBytes = std::size_t{kSidePx} * kSidePx * 12;
  const auto pool = FrameImagePool::Make(kBytes - 1);
  const std::size_t before = base::ResidentBytes();
  pool->Prepare(kSidePx, kSidePx);
  EXPECT_LE(base::ResidentBytes(), before + kBytes / 4);
  EXPECT_EQ(pool->Take(kSidePx, kSidePx).width, kSidePx);
}

TEST(FrameImagePoolTest, AnImageMayOutliveItsPool) {
  FrameImage image;
  {
    const auto pool = FrameImagePool::Make(1 << 20);
    image = pool->Take(4, 4);
  }
  image.Set(1, 1, FragmentKey(0.5F, 1), {});
}

TEST(FrameImagePoolTest, ACopyIsTheHoldersOwn) {
  const auto pool = FrameImagePool::Make(1 << 20);
  FrameImage copy;
  {
    FrameImage image = pool->Take(4, 4);
    image.Set(2, 2, FragmentKey(0.5F, 1), {5, 5, 5, 255});
    copy = image;
  }
  EXPECT_EQ(copy.keys[copy.IndexOf(2, 2)], FragmentKey(0.5F, 1));
  EXPECT_NE(pool->Take(4, 4).keys.data(), copy.keys.data());
}

}  // namespace
}  // namespace isoscope::image
