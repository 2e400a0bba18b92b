#include "core/source/chunks/chunk_cache.h"

#include <memory>
#include <string>

#include "gtest/gtest.h"

namespace isoscope::source {
namespace {

ChunkCache::Chunk Bytes(std::size_t count) {
  return std::make_shared<const std::string>(count, 'x');
}

TEST(ChunkCacheTest, KeepsChunksUntilTheirPlanesHavePassed) {
  ChunkCache cache(/*plane_axis=*/1, 100);
  cache.Insert(1, {.begin = {0, 0, 0}, .end = {1, 4, 4}}, Bytes(40));
  cache.Insert(2, {.begin = {0, 4, 0}, .end = {1, 8, 4}}, Bytes(40));
  EXPECT_NE(cache.Find(1), nullptr);
  cache.KeepPlanesOf({.begin = {0, 3, 0}, .end = {1, 5, 9}});
  EXPECT_NE(cache.Find(1), nullptr);
  EXPECT_NE(cache.Find(2), nullptr);
  cache.KeepPlanesOf({.begin = {0, 4, 0}, .end = {1, 5, 9}});
  EXPECT_EQ(cache.Find(1), nullptr);
  EXPECT_EQ(cache.size_bytes(), 40);
  cache.KeepPlanesOf({.begin = {0, 0, 0}, .end = {1, 4, 9}});  // another pass
  EXPECT_EQ(cache.Find(2), nullptr);
  EXPECT_EQ(cache.size_bytes(), 0);
}

TEST(ChunkCacheTest, KeepsWhatItHasWhenItIsFull) {
  ChunkCache cache(0, 100);
  const ChunkBox box{.begin = {0}, .end = {9}};
  cache.Insert(1, box, Bytes(60));
  cache.Insert(2, box, Bytes(60));
  cache.Insert(3, box, Bytes(40));
  cache.Insert(3, box, Bytes(1));
  EXPECT_NE(cache.Find(1), nullptr);
  EXPECT_EQ(cache.Find(2), nullptr);
  EXPECT_EQ(cache.Find(3)->size(), 40U);
  EXPECT_EQ(cache.size_bytes(), 100);
}

}  // namespace
}  // namespace isoscope::source
