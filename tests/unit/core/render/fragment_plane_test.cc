#include "core/render/fragment_plane.h"

#include <bit>
#include <cstdint>
#include <memory>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

namespace isoscope::render {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr int kWidth = 100;  // two lock tiles, the second is cut
constexpr int kHeight = 20;

// The fragments that are merged into one pixel, in this order, and the expected result.
struct Case {
  const char* name;
  std::vector<float> depths;  // fragment i has primitive id 64 + i
  float depth;
  std::uint32_t primitive_id;
  std::vector<std::uint32_t> tied;  // primitive ids
};

std::vector<std::uint32_t> TiesOf(const FragmentPlane& plane, std::size_t lock_tile) {
  std::vector<std::uint32_t> ids;
  for (const FragmentPlane::Tie& tie : plane.TiesOf(lock_tile)) {
    ids.push_back(static_cast<std::uint32_t>(tie.fragment));
  }
  return ids;
}

void MergeAt(int x, int y, const std::vector<float>& depths, FragmentPlane* plane) {
  const std::vector<std::uint32_t> pixels(depths.size(), static_cast<std::uint32_t>(x | y << 16));
  std::vector<std::uint32_t> bits;
  std::vector<std::uint32_t> triangles;
  for (const float depth : depths) {
    triangles.push_back(static_cast<std::uint32_t>(triangles.size()));
    bits.push_back(std::bit_cast<std::uint32_t>(depth));
  }
  plane->Merge(
      {.bounds = {x, y, x + 1, y + 1}, .pixels = pixels, .depths = bits, .triangles = triangles},
      64);
}

// Takes the fragments of all touched tiles. The list has whole tiles' room.
void TakeAll(bool is_last, FragmentPlane* plane, ShadeList* list) {
  const image::FrameImage image(kWidth, kHeight);
  list->Reset({});
  for (std::size_t i = 0; i < plane->lock_tile_count(); ++i) {
    plane->ForEachImageTile(i, plane->TouchedOf(i), [&](const auto& tile) {
      plane->TakeFragments(tile, is_last, image, list);
    });
    plane->EndTile(i, is_last);
  }
  plane->EndShading(is_last);
}

TEST(FragmentPlaneTest, TheNearestFragmentStaysAndTiesAreListed) {
  const auto list = std::make_unique<ShadeList>();
  FragmentPlane plane(kWidth, kHeight);
  for (const Case& c : {Case{"one", {1.0F}, 1.0F, 64, {}},
                        Case{"the nearer comes later", {0.5F, 0.25F}, 0.25F, 65, {}},
                        Case{"the nearer comes first", {0.25F, 0.5F}, 0.25F, 64, {}},
                        Case{"equal depths", {0.5F, 0.5F, 0.5F}, 0.5F, 64, {65, 66}},
                        Case{"a hidden tie", {0.5F, 0.5F, 0.25F}, 0.25F, 66, {65}}}) {
    SCOPED_TRACE(c.name);
    MergeAt(97, 17, c.depths, &plane);
    EXPECT_EQ(TiesOf(plane, 1), c.tied);
    EXPECT_EQ(plane.tie_bytes(), c.tied.size() * sizeof(FragmentPlane::Tie));
    TakeAll(/*is_last=*/true, &plane, list.get());
    ASSERT_EQ(list->batch.count, 1U);
    EXPECT_EQ(list->pixels[0], 17U * kWidth + 97);
    EXPECT_EQ(list->depths[0], std::bit_cast<std::uint32_t>(c.depth));
    EXPECT_EQ(list->primitive_ids[0], c.primitive_id);
    EXPECT_EQ(list->batch.x[0], 97.5F);
    EXPECT_EQ(list->batch.y[0], 17.5F);
    EXPECT_EQ(plane.tie_bytes(), 0U);
  }
}

TEST(FragmentPlaneTest, AShadedPixelIsTakenAgainOnlyWithANearerFragment) {
  const auto list = std::make_unique<ShadeList>();
  FragmentPlane plane(kWidth, kHeight);
  MergeAt(3, 4, {0.5F}, &plane);
  TakeAll(/*is_last=*/false, &plane, list.get());
  EXPECT_EQ(list->batch.count, 1U);
  MergeAt(3, 4, {0.75F, 0.5F}, &plane);
  EXPECT_THAT(TiesOf(plane, 0), ElementsAre(65U)) << "with the shaded pixel";
  TakeAll(/*is_last=*/false, &plane, list.get());
  EXPECT_EQ(list->batch.count, 0U);
  MergeAt(3, 4, {0.25F}, &plane);
  TakeAll(/*is_last=*/true, &plane, list.get());
  EXPECT_EQ(list->batch.count, 1U);
}

TEST(FragmentPlaneTest, NothingIsLeftAfterTheLastShadingOrClear) {
  const auto list = std::make_unique<ShadeList>();
  FragmentPlane plane(kWidth, kHeight);
  for (const bool is_abandoned : {false, true}) {
    MergeAt(3, 4, {0.5F, 0.5F}, &plane);
    TakeAll(/*is_last=*/false, &plane, list.get());
    MergeAt(80, 19, {0.5F, 0.5F}, &plane);
    if (is_abandoned) {
      plane.Clear();
    } else {
      TakeAll(/*is_last=*/true, &plane, list.get());
    }
    EXPECT_EQ(plane.TouchedOf(0) | plane.TouchedOf(1), 0U);
    EXPECT_THAT(TiesOf(plane, 1), IsEmpty());
    MergeAt(3, 4, {1.0F}, &plane);
    MergeAt(80, 19, {1.0F}, &plane);
    TakeAll(/*is_last=*/true, &plane, list.get());
    EXPECT_EQ(list->batch.count, 2U);
  }
}

TEST(FragmentPlaneTest, TilesAndRowsThatABatchMeetsAreTouched) {
  FragmentPlane plane(kWidth, kHeight);
  plane.Merge({.bounds = {60, 14, 70, 18}, .pixels = {}, .depths = {}, .triangles = {}}, 0);
  std::vector<std::vector<int>> tiles;
  for (std::size_t i = 0; i < plane.lock_tile_count(); ++i) {
    plane.ForEachImageTile(i, plane.TouchedOf(i), [&](const auto& tile) {
      tiles.push_back({tile.column, tile.row, tile.rows});
    });
  }
  EXPECT_THAT(tiles, ElementsAre(ElementsAre(3, 0, 0xc000), ElementsAre(3, 1, 3),
                                 ElementsAre(4, 0, 0xc000), ElementsAre(4, 1, 3)));
}

}  // namespace
}  // namespace isoscope::render
