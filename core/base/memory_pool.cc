#include "core/base/memory_pool.h"

#include <algorithm>
#include <bit>
#include <new>

#include "core/base/check.h"
#include "core/base/large_pages.h"

namespace isoscope::base {
namespace {

constexpr std::size_t kPageBytes = 4096;
static_assert(kLargePageBytes % MemoryPool::kChunkBytes == 0, "a page is taken as whole chunks");

// Makes room for `count` elements. Grows by factors, as push_back does.
void ReserveFor(std::size_t count, std::vector<char*>* pages) {
  if (count > pages->capacity()) {
    pages->reserve(std::max(count, 2 * pages->capacity()));
  }
}

}  // namespace

std::shared_ptr<MemoryPool> MemoryPool::Make(std::size_t chunk_bytes) {
  ISOSCOPE_CHECK(std::has_single_bit(chunk_bytes) && chunk_bytes >= kPageBytes &&
                 chunk_bytes <= kChunkBytes);
  return std::shared_ptr<MemoryPool>(new MemoryPool(chunk_bytes));
}

MemoryPool::~MemoryPool() {
  for (char* region : regions_) {
    UnmapLargePages(region, kRegionBytes);
  }
}

char* MemoryPool::TakeFreshPage() {
  if (fresh_pages_.empty()) {
    // Return may not throw. So the list has room for all chunks before a region is added.
    const std::size_t region_count = regions_.size() + 1;
    ReserveFor(region_count, &regions_);
    ReserveFor(kRegionBytes / kLargePageBytes, &fresh_pages_);
    ReserveFor(region_count * (kRegionBytes / chunk_bytes_), &free_chunks_);
    char* const region = static_cast<char*>(MapLargePages(kRegionBytes));
    if (region == nullptr) {
      throw std::bad_alloc();
    }
    regions_.push_back(region);
    for (std::size_t offset = kRegionBytes; offset > 0; offset -= kLargePageBytes) {
      fresh_pages_.push_back(region + offset - kLargePageBytes);
    }
  }
  char* const page = fresh_pages_.back();
  fresh_pages_.pop_back();
  return page;
}

void MemoryPool::Populate(std::size_t bytes) {
  for (std::size_t done = 0; done < bytes; done += kLargePageBytes) {
    char* page = nullptr;
    {
      MutexLock lock(&mutex_);
      page = TakeFreshPage();
    }
    // The kernel may have small pages only.
    for (std::size_t offset = 0; offset < kLargePageBytes; offset += kPageBytes) {
      static_cast<volatile char*>(page)[offset] = 0;
    }
    MutexLock lock(&mutex_);
    AddChunksOf(page);
  }
}

void MemoryPool::AddChunksOf(char* page) {
  const std::size_t count = kLargePageBytes / chunk_bytes_;
  free_chunks_.insert(free_chunks_.begin(), count, nullptr);
  for (std::size_t i = 0; i < count; ++i) {
    free_chunks_[count - 1 - i] = page + i * chunk_bytes_;
  }
}

std::size_t MemoryPool::touched_free_bytes() const {
  MutexLock lock(&mutex_);
  return free_chunks_.size() * chunk_bytes_;
}

std::shared_ptr<char[]> MemoryPool::Take() {
  char* chunk = nullptr;
  {
    MutexLock lock(&mutex_);
    if (free_chunks_.empty()) {
      // Whoever fills the first chunk of a large page touches all of it.
      AddChunksOf(TakeFreshPage());
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
