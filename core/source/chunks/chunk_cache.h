// Decoded chunks for the next planes of a volume that is read plane after plane.

#ifndef ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_CACHE_H_
#define ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_CACHE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <unordered_map>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"
#include "core/source/chunks/chunk_box.h"

namespace isoscope::source {

// Planes are those of one axis of the array. A chunk stays until planes are asked for that it has
// no part of. While the cache is full, it takes nothing new: of a pass over more chunks than fit,
// those that it has are used in each plane. (The least recently used one would be dropped just
// before its next use.)
//
// Thread-safe.
class ChunkCache {
 public:
  ChunkCache(std::size_t plane_axis, std::int64_t capacity_bytes)
      : plane_axis_(plane_axis), capacity_bytes_(capacity_bytes) {}
  ChunkCache(const ChunkCache&) = delete;
  ChunkCache& operator=(const ChunkCache&) = delete;

  using Chunk = std::shared_ptr<const std::string>;

  // Drops the chunks that have no plane of the box.
  void KeepPlanesOf(const ChunkBox& box) ABSL_LOCKS_EXCLUDED(mutex_);
  // Null if it has none of that number.
  [[nodiscard]] Chunk Find(std::int64_t number) const ABSL_LOCKS_EXCLUDED(mutex_);
  void Insert(std::int64_t number, const ChunkBox& elements, Chunk chunk)
      ABSL_LOCKS_EXCLUDED(mutex_);
  [[nodiscard]] std::int64_t size_bytes() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Entry {
    std::int64_t begin = 0;  // planes
    std::int64_t end = 0;
    Chunk chunk{};
  };

  const std::size_t plane_axis_;
  const std::int64_t capacity_bytes_;
  mutable base::Mutex mutex_;
  std::unordered_map<std::int64_t, Entry> entries_ ABSL_GUARDED_BY(mutex_);  // by number
  std::int64_t size_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHUNKS_CHUNK_CACHE_H_
