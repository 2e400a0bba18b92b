#include "core/formats/reader_memory.h"

#include <cstdint>

#include "core/source/chunks/shard_indexes.h"

namespace isoscope::source {

void BoundShardIndexes(std::size_t max_bytes) {
  ShardIndexes::OfProcess().SetMaxBytes(static_cast<std::int64_t>(max_bytes));
}

}  // namespace isoscope::source
