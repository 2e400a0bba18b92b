#include "core/formats/reader_memory.h"

#include <cstddef>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/source/chunks/shard_indexes.h"

namespace isoscope::source {
namespace {

TEST(ReaderMemoryTest, IndexesThatAreKeptAlreadyCountToo) {
  constexpr std::size_t kMaxBytes = 4096;
  ShardIndexes& indexes = ShardIndexes::OfProcess();
  const std::int64_t array = indexes.NumberArray();
  for (int shard = 0; shard < 100; ++shard) {
    indexes.Keep(array, absl::StrCat(shard), nullptr);
  }
  EXPECT_GT(indexes.kept_bytes(), std::int64_t{kMaxBytes});
  BoundShardIndexes(kMaxBytes);
  EXPECT_LE(indexes.kept_bytes(), std::int64_t{kMaxBytes});
  indexes.Forget(array);
  BoundShardIndexes(std::size_t{ShardIndexes::kDefaultMaxBytes});
}

}  // namespace
}  // namespace isoscope::source
