#include "server/frame/sample_counts.h"

#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

namespace isoscope::server {
namespace {

std::shared_ptr<const SampleCounts> CountsUpTo(double max) {
  return std::make_shared<const SampleCounts>(
      SampleCounts{.samples = std::nullopt, .value_range = {0, max}});
}

TEST(SampleCountsCacheTest, AVolumeHasItsOwnCounts) {
  SampleCountsCache cache;
  EXPECT_EQ(cache.Find("a"), nullptr);
  cache.Insert("a", CountsUpTo(1));
  cache.Insert("b", CountsUpTo(2));
  EXPECT_EQ(cache.Find("a")->value_range.max, 1);
  EXPECT_EQ(cache.Find("b")->value_range.max, 2);
  cache.Insert("a", CountsUpTo(3));
  EXPECT_EQ(cache.Find("a")->value_range.max, 3);
}

// Symptom: a long series would have filled the memory.
TEST(SampleCountsCacheTest, TheVolumesUsedLastStay) {
  SampleCountsCache cache;
  cache.Insert("first", CountsUpTo(1));
  for (std::size_t i = 1; i < SampleCountsCache::kMaxVolumes; ++i) {
    cache.Insert(absl::StrCat(i), CountsUpTo(2));
  }
  EXPECT_NE(cache.Find("first"), nullptr);
  cache.Insert("one more", CountsUpTo(2));
  EXPECT_NE(cache.Find("first"), nullptr);
  EXPECT_EQ(cache.Find("1"), nullptr) << "that was used least recently";
}

}  // namespace
}  // namespace isoscope::server
