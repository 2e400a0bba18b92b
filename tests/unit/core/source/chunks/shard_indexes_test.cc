#include "core/source/chunks/shard_indexes.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxBytes = std::int64_t{64} << 10;

// Some 16 KiB: three fit kMaxBytes.
ShardIndexes::Index IndexOf(std::int64_t offset) {
  return std::make_shared<const std::vector<ShardEntry>>(std::size_t{1024},
                                                         ShardEntry{.offset = offset, .size = 1});
}

TEST(ShardIndexesTest, TheLeastRecentlyUsedGoesFirst) {
  ShardIndexes indexes(kMaxBytes);
  const std::int64_t array = indexes.NumberArray();
  indexes.Keep(array, "a", IndexOf(1));
  indexes.Keep(array, "b", IndexOf(2));
  indexes.Keep(array, "c", IndexOf(3));
  ASSERT_TRUE(indexes.Find(array, "a").has_value());
  indexes.Keep(array, "d", IndexOf(4));
  EXPECT_FALSE(indexes.Find(array, "b").has_value());
  for (const char* const key : {"a", "c", "d"}) {
    EXPECT_TRUE(indexes.Find(array, key).has_value()) << key;
  }
  EXPECT_EQ(indexes.Find(array, "a").value()->front().offset, 1);
}

TEST(ShardIndexesTest, AllArraysTogetherStayWithinTheBound) {
  ShardIndexes indexes(kMaxBytes);
  for (int i = 0; i < 10; ++i) {
    indexes.Keep(indexes.NumberArray(), "a", IndexOf(i));
    EXPECT_LE(indexes.kept_bytes(), kMaxBytes);
  }
  EXPECT_GT(indexes.kept_bytes(), kMaxBytes / 2);
  indexes.SetMaxBytes(kMaxBytes / 2);
  EXPECT_LE(indexes.kept_bytes(), kMaxBytes / 2);
}

// Else each chunk of such a shard would ask for its index.
TEST(ShardIndexesTest, TheLastOneStaysHoweverLarge) {
  ShardIndexes indexes(100);
  const std::int64_t array = indexes.NumberArray();
  indexes.Keep(array, "a", IndexOf(1));
  EXPECT_TRUE(indexes.Find(array, "a").has_value());
  indexes.Keep(array, "b", IndexOf(2));
  EXPECT_FALSE(indexes.Find(array, "a").has_value());
  EXPECT_TRUE(indexes.Find(array, "b").has_value());
}

TEST(ShardIndexesTest, OneThatComesAgainTakesThePlaceOfTheFirst) {
  ShardIndexes indexes(kMaxBytes);
  const std::int64_t array = indexes.NumberArray();
  indexes.Keep(array, "a", IndexOf(1));
  const std::int64_t bytes = indexes.kept_bytes();
  indexes.Keep(array, "a", IndexOf(2));
  EXPECT_EQ(indexes.kept_bytes(), bytes);
  EXPECT_EQ(indexes.Find(array, "a").value()->front().offset, 2);
}

TEST(ShardIndexesTest, AnArrayThatGoesTakesItsOwnAlone) {
  ShardIndexes indexes(kMaxBytes);
  const std::int64_t first = indexes.NumberArray();
  const std::int64_t second = indexes.NumberArray();
  indexes.Keep(first, "a", IndexOf(1));
  indexes.Keep(second, "a", nullptr);  // there is no such shard
  indexes.Forget(first);
  EXPECT_FALSE(indexes.Find(first, "a").has_value());
  const std::optional<ShardIndexes::Index> missing = indexes.Find(second, "a");
  ASSERT_TRUE(missing.has_value());
  EXPECT_EQ(*missing, nullptr);
  indexes.Forget(second);
  EXPECT_EQ(indexes.kept_bytes(), 0);
}

}  // namespace
}  // namespace isoscope::source
