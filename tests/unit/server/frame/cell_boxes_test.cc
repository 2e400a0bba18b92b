#include "server/frame/cell_boxes.h"

#include <optional>
#include <set>
#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "tests/support/metric_values.h"

namespace isoscope::server {
namespace {

using volume::InsideRule;

const math::IndexBox kBox{{1, 2, 3}, {4, 5, 6}};

view::ClipRegion RegionOf(double offset) {
  view::ClipRegion region;
  region.half_spaces.push_back({{1, 0, 0}, offset});
  return region;
}

TEST(CellBoxCacheTest, KeysTellDatasetsSurfacesAndRegionsApart) {
  view::ClipRegion boxed;
  boxed.box = math::Box3d{.min = {0, 0, 0}, .max = {1, 1, 1}};
  view::ClipRegion larger = boxed;
  larger.box->max.z = 2;
  const std::set<std::string> keys = {
      CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(1)}, {}),
      CellBoxCache::KeyOf("b", {InsideRule::OfIsovalue(1)}, {}),
      CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(2)}, {}),
      CellBoxCache::KeyOf("a", {InsideRule::OfLabels({1})}, {}),
      CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(1), InsideRule::OfIsovalue(2)}, {}),
      CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(1)}, RegionOf(1)),
      CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(1)}, RegionOf(2)),
      CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(1)}, boxed),
      CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(1)}, larger)};
  EXPECT_EQ(keys.size(), 9U);
  EXPECT_EQ(CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(0.0)}, RegionOf(0.0)),
            CellBoxCache::KeyOf("a", {InsideRule::OfIsovalue(-0.0)}, RegionOf(-0.0)));
}

TEST(CellBoxCacheTest, ThatThereAreNoCellsIsKnownToo) {
  CellBoxCache cache;
  EXPECT_EQ(cache.Find("a"), nullptr);
  cache.Insert("a", kBox);
  cache.Insert("b", std::nullopt);
  ASSERT_NE(cache.Find("a"), nullptr);
  EXPECT_EQ(*cache.Find("a"), kBox);
  ASSERT_NE(cache.Find("b"), nullptr);
  EXPECT_EQ(*cache.Find("b"), std::nullopt);
  base::MetricFamily lookups;
  lookups.name = "lookups";
  cache.AppendSamples(&lookups);
  auto values = testing::ValuesOf({lookups});
  EXPECT_EQ(values["lookups cache=cell_boxes result=hit"], 4);
  EXPECT_EQ(values["lookups cache=cell_boxes result=miss"], 1);
}

// With a thousand datasets or a slider that is moved for hours.
TEST(CellBoxCacheTest, NewBoxesTakeThePlaceOfThoseUsedLongAgo) {
  CellBoxCache cache;
  cache.Insert("first", kBox);
  const std::string long_name(1000, 'x');
  for (int i = 0; i < 1000; ++i) {
    const std::string key = absl::StrCat(long_name, i);
    EXPECT_EQ(cache.Find(key), nullptr);
    cache.Insert(key, kBox);
    EXPECT_NE(cache.Find(key), nullptr) << i;
  }
  EXPECT_EQ(cache.Find("first"), nullptr);
}

}  // namespace
}  // namespace isoscope::server
