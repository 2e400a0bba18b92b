#include "core/source/chunks/chunk_cache.h"

#include <utility>

namespace isoscope::source {

void ChunkCache::KeepPlanesOf(const ChunkBox& box) {
  const base::MutexLock lock(&mutex_);
  for (auto entry = entries_.begin(); entry != entries_.end();) {
    const bool is_used =
        entry->second.begin < box.end[plane_axis_] && entry->second.end > box.begin[plane_axis_];
    if (is_used) {
      ++entry;
    } else {
      size_bytes_ -= static_cast<std::int64_t>(entry->second.chunk->size());
      entry = entries_.erase(entry);
    }
  }
}

ChunkCache::Chunk ChunkCache::Find(std::int64_t number) const {
  const base::MutexLock lock(&mutex_);
  const auto found = entries_.find(number);
  return found == entries_.end() ? nullptr : found->second.chunk;
}

void ChunkCache::Insert(std::int64_t number, const ChunkBox& elements, Chunk chunk) {
  const auto size = static_cast<std::int64_t>(chunk->size());
  const base::MutexLock lock(&mutex_);
  if (size > capacity_bytes_ - size_bytes_ || entries_.contains(number)) {
    return;
  }
  entries_[number] = {.begin = elements.begin[plane_axis_],
                      .end = elements.end[plane_axis_],
                      .chunk = std::move(chunk)};
  size_bytes_ += size;
}

std::int64_t ChunkCache::size_bytes() const {
  const base::MutexLock lock(&mutex_);
  return size_bytes_;
}

}  // namespace isoscope::source
