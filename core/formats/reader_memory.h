// Bounds the memory that readers keep from one read to the next.

#ifndef ISOSCOPE_CORE_FORMATS_READER_MEMORY_H_
#define ISOSCOPE_CORE_FORMATS_READER_MEMORY_H_

#include <cstddef>

namespace isoscope::source {

// From now on the indexes of Zarr shards that this process keeps take at most so many bytes
// (core/source/chunks/shard_indexes.h). Thread-safe.
void BoundShardIndexes(std::size_t max_bytes);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_READER_MEMORY_H_
