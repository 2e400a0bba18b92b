#include "server/frame/active_blocks.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numeric>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/metric_values.h"

namespace isoscope::server {
namespace {

using ::testing::ElementsAre;

using ShardsByAgent = std::vector<std::vector<int>>;

std::string KeyOf(const std::string& id, const ShardsByAgent& shards, double isovalue) {
  return ActiveBlocksCache::KeyOf(id, /*level=*/0, shards, {{.isovalue = isovalue}});
}

// A row of blocks.
volume::BlockLayout LayoutOf(std::int64_t block_count) {
  return *volume::BlockLayout::Make({block_count + 1, 2, 2}, {1, 1, 1});
}

// The first `count` blocks of a small volume, all of one agent.
std::shared_ptr<const ActiveBlocks> Blocks(std::size_t count) {
  std::vector<volume::BlockId> ids(count);
  std::iota(ids.begin(), ids.end(), 0U);
  return std::make_shared<const ActiveBlocks>(
      std::vector<std::vector<volume::BlockId>>{ids},
      LayoutOf(std::max<std::int64_t>(1, static_cast<std::int64_t>(count))));
}

constexpr std::size_t kBlockBytes = sizeof(volume::BlockId);

TEST(ActiveBlocksTest, AgentsFollowOneAnotherAndTheSetHasAll) {
  const ActiveBlocks active({{1, 4}, {}, {0, 9}}, LayoutOf(10));
  EXPECT_THAT(active.ids, ElementsAre(1, 4, 0, 9));
  EXPECT_THAT(active.begin_by_agent, ElementsAre(0, 2, 2, 4));
  EXPECT_THAT(active.set.Ids(), ElementsAre(0, 1, 4, 9));
}

TEST(ActiveBlocksTest, ALargeVolumeHasATreeOfTheSameBlocks) {
  const ActiveBlocks active({{1, 4}, {}, {0, 9}}, LayoutOf(10), /*max_dense_blocks=*/9);
  EXPECT_THAT(active.ids, ElementsAre(1, 4, 0, 9));
  EXPECT_THAT(active.begin_by_agent, ElementsAre(0, 2, 2, 4));
  ASSERT_NE(active.tree, nullptr);
  EXPECT_THAT(active.tree->blocks.Ids(), ElementsAre(0, 1, 4, 9));
  // Blocks that are not active are left out.
  const std::vector<std::uint64_t> marks = active.tree->MarksOf({4, 3, 9, 7, 4});
  std::vector<bool> is_marked;
  for (std::size_t i = 0; i < active.ids.size(); ++i) {
    is_marked.push_back(active.tree->IsMarked(marks, i));
  }
  EXPECT_THAT(is_marked, ElementsAre(false, true, false, true));
  EXPECT_EQ(ActiveBlocks({{1}}, LayoutOf(10), /*max_dense_blocks=*/10).tree, nullptr);
}

TEST(ActiveBlocksCacheTest, EverythingThatDecidesTheListsIsInTheKey) {
  // Each differs from all others: datasets, isovalues, and shards spread in other ways, among them
  // those whose digits are alike.
  const std::vector<std::string> keys = {
      KeyOf("a", {{0}, {1}}, 1),
      KeyOf("b", {{0}, {1}}, 1),
      KeyOf("a", {{0}, {1}}, 2),
      KeyOf("a", {{0}, {1}}, -1),
      KeyOf("a", {{0}, {1}}, std::nextafter(1.0, 2.0)),
      KeyOf("a", {{1}, {0}}, 1),
      KeyOf("a", {{0, 1}}, 1),
      KeyOf("a", {{0, 1}, {}}, 1),
      KeyOf("a", {{}, {0, 1}}, 1),
      KeyOf("a", {{0}, {1}, {2}}, 1),
      KeyOf("a", {{0}, {1, 2}}, 1),
      KeyOf("a", {{0, 1}, {2}}, 1),
      KeyOf("a", {{0}, {12}}, 1),
      KeyOf("a", {{0, 11}}, 1),
      ActiveBlocksCache::KeyOf("a", /*level=*/1, {{0}, {1}}, {{.isovalue = 1}}),
  };
  EXPECT_EQ(std::set<std::string>(keys.begin(), keys.end()).size(), keys.size());
  EXPECT_EQ(KeyOf("a", {{0}, {1}}, 1), keys.front());
  EXPECT_EQ(KeyOf("a", {{0}}, 0.0), KeyOf("a", {{0}}, -0.0)) << "one level, two keys";
}

TEST(ActiveBlocksCacheTest, LabelsOfEachSurfaceAreInTheKey) {
  using volume::InsideRule;
  const std::vector<std::vector<InsideRule>> surfaces = {
      {InsideRule::OfIsovalue(1)},
      {InsideRule::OfIsovalue(0)},
      {InsideRule::OfLabels({0})},
      {InsideRule::OfLabels({1})},
      {InsideRule::OfLabels({1, 2})},
      {InsideRule::OfLabels({1}), InsideRule::OfLabels({2})},
      {InsideRule::OfLabels({2}), InsideRule::OfLabels({1})},
      {InsideRule::OfLabels({1}), InsideRule::OfIsovalue(2)},
      {InsideRule::OfLabels({std::nextafter(1.0, 2.0)})},
  };
  std::set<std::string> keys;
  for (const std::vector<InsideRule>& rules : surfaces) {
    keys.insert(ActiveBlocksCache::KeyOf("a", 0, {{0}}, rules));
  }
  EXPECT_EQ(keys.size(), surfaces.size());
  EXPECT_EQ(ActiveBlocksCache::KeyOf("a", 0, {{0}}, {InsideRule::OfLabels({2, 1, 2})}),
            ActiveBlocksCache::KeyOf("a", 0, {{0}}, {InsideRule::OfLabels({1, 2})}));
}

TEST(ActiveBlocksCacheTest, FindsWhatWasInsertedAndNothingElse) {
  ActiveBlocksCache cache(10'000);
  EXPECT_EQ(cache.Find("a"), nullptr);
  const auto blocks = Blocks(3);
  cache.Insert("a", blocks);
  EXPECT_EQ(cache.Find("a"), blocks);
  EXPECT_EQ(cache.Find("b"), nullptr);
  cache.Insert("a", Blocks(4));  // the second of two frames that asked at once
  EXPECT_EQ(cache.Find("a"), blocks);
}

TEST(ActiveBlocksCacheTest, LeastRecentlyUsedIsForgottenFirst) {
  ActiveBlocksCache cache(3000 * kBlockBytes + 1000);  // three of these, not four
  for (const char* key : {"a", "b", "c"}) {
    cache.Insert(key, Blocks(1000));
  }
  ASSERT_NE(cache.Find("a"), nullptr);
  cache.Insert("d", Blocks(1000));
  EXPECT_EQ(cache.Find("b"), nullptr);
  for (const char* key : {"a", "c", "d"}) {
    EXPECT_NE(cache.Find(key), nullptr) << key;
  }
  // A large one takes the place of several.
  cache.Insert("e", Blocks(2500));
  EXPECT_NE(cache.Find("e"), nullptr);
  for (const char* key : {"a", "c", "d"}) {
    EXPECT_EQ(cache.Find(key), nullptr) << key;
  }
}

TEST(ActiveBlocksCacheTest, WhatDoesNotFitIsNotKeptAndForgetsNothing) {
  ActiveBlocksCache cache(10'000);
  cache.Insert("a", Blocks(100));
  cache.Insert("large", Blocks(10'000));
  EXPECT_EQ(cache.Find("large"), nullptr);
  EXPECT_NE(cache.Find("a"), nullptr);
  ActiveBlocksCache none(0);
  none.Insert("a", Blocks(0));
  EXPECT_EQ(none.Find("a"), nullptr);
}

TEST(ActiveBlocksCacheTest, BytesOfManyListsStayBounded) {
  constexpr std::size_t kMaxBytes = 50'000;
  ActiveBlocksCache cache(kMaxBytes);
  std::vector<std::weak_ptr<const ActiveBlocks>> alive;
  for (std::size_t i = 0; i < 500; ++i) {
    const auto blocks = Blocks(i % 37 * 50);
    cache.Insert(std::to_string(i), blocks);
    alive.push_back(blocks);
    std::size_t held = 0;
    for (std::size_t j = 0; j <= i; ++j) {
      held += alive[j].expired() || j == i ? 0 : j % 37 * 50 * kBlockBytes;
    }
    ASSERT_LE(held, kMaxBytes) << i;
  }
}

TEST(ActiveBlocksCacheTest, WhatIsForgottenLivesOnWithThoseWhoHoldIt) {
  ActiveBlocksCache cache(1000 * kBlockBytes + 1000);
  cache.Insert("a", Blocks(1000));
  const auto held = cache.Find("a");
  cache.Insert("b", Blocks(1000));
  ASSERT_EQ(cache.Find("a"), nullptr);
  EXPECT_EQ(held->ids.size(), 1000U);
}

TEST(ActiveBlocksCacheTest, FramesSideBySideFindTheirOwnLists) {
  ActiveBlocksCache cache(20'000);
  std::vector<std::thread> threads;
  for (std::size_t first = 0; first < 4; ++first) {
    threads.emplace_back([&cache, first] {
      for (std::size_t i = first; i < 2000; ++i) {
        const std::size_t count = i % 13 * 100;
        const std::string key = std::to_string(count);
        if (const auto found = cache.Find(key); found != nullptr) {
          EXPECT_EQ(found->ids.size(), count);
        } else {
          cache.Insert(key, Blocks(count));
        }
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

TEST(ActiveBlocksCacheTest, LooksAreCountedByResult) {
  ActiveBlocksCache cache(1 << 20);
  EXPECT_EQ(cache.Find("a"), nullptr);
  cache.Insert("a", Blocks(1));
  EXPECT_NE(cache.Find("a"), nullptr);
  EXPECT_NE(cache.Find("a"), nullptr);
  std::vector<base::MetricFamily> families;
  cache.AppendMetrics(&families);
  auto values = testing::ValuesOf(families);
  EXPECT_EQ(values["isoscope_cache_lookups_total cache=active_blocks result=hit"], 2);
  EXPECT_EQ(values["isoscope_cache_lookups_total cache=active_blocks result=miss"], 1);
}

}  // namespace
}  // namespace isoscope::server
