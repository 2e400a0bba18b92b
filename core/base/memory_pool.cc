#include "core/base/memory_pool.h"

#include <algorithm>
#include <new>

#include "core/base/large_pages.h"

namespace isoscope::base {
namespace {

constexpr std::size_t kPageBytes = 4096;

}  // namespace

std::shared_ptr<MemoryPool> MemoryPool::Make() {
  return std::shared_ptr<MemoryPool>(new MemoryPool());
}

MemoryPool::~MemoryPool() {
  for (char* region : regions_) {
    UnmapLargePages(region, kRegionBytes);
  }
}

void MemoryPool::AddRegion() {
  char* const region = static_cast<char*>(MapLargePages(kRegionBytes));
  if (region == nullptr) {
    throw std::bad_alloc();
  }
  regions_.push_back(region);
  for (std::size_t offset = kRegionBytes; offset > 0; offset -= kChunkBytes) {
    free_chunks_.push_back(region + offset - kChunkBytes);
  }
}

void MemoryPool::Populate(std::size_t bytes) {
  for (std::size_t done = 0; done < bytes; done += kRegionBytes) {
    MutexLock lock(&mutex_);
    AddRegion();
    char* const region = regions_.back();
    // Chunks are taken from the beginning of the region on.
    const std::size_t end = std::min(kRegionBytes, bytes - done);
    for (std::size_t offset = 0; offset < end; offset += kPageBytes) {
      static_cast<volatile char*>(region)[offset] = 0;
    }
  }
}

std::shared_ptr<char[]> MemoryPool::Take() {
  char* chunk = nullptr;
  {
    MutexLock lock(&mutex_);
    if (free_chunks_.empty()) {
      AddRegion();
    }
    chunk = free_chunks_.back();
    free_chunks_.pop_back();
  }
  return {chunk, [pool = shared_from_this()](char* returned) { pool->Return(returned); }};
}

void MemoryPool::Return(char* chunk) {
  MutexLock lock(&mutex_);
  free_chunks_.push_back(chunk);
}

}  // namespace isoscope::base
