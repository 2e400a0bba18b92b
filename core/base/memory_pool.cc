#include "core/base/memory_pool.h"

#include <algorithm>
#include <cstdint>
#include <new>

#include <sys/mman.h>

namespace isoscope::base {
namespace {

constexpr std::size_t kHugePageBytes = std::size_t{2} << 20;
constexpr std::size_t kPageBytes = 4096;

}  // namespace

std::shared_ptr<MemoryPool> MemoryPool::Make() {
  return std::shared_ptr<MemoryPool>(new MemoryPool());
}

MemoryPool::~MemoryPool() {
  for (char* region : regions_) {
    ::munmap(region, kRegionBytes);
  }
}

void MemoryPool::AddRegion() {
  // Mapped with room to cut out an aligned part: only whole large pages can be large.
  const std::size_t mapped_bytes = kRegionBytes + kHugePageBytes;
  void* mapped =
      ::mmap(nullptr, mapped_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (mapped == MAP_FAILED) {
    throw std::bad_alloc();
  }
  char* const begin = static_cast<char*>(mapped);
  const std::size_t misaligned = reinterpret_cast<std::uintptr_t>(begin) % kHugePageBytes;
  const std::size_t head = misaligned == 0 ? 0 : kHugePageBytes - misaligned;
  if (head > 0) {
    ::munmap(begin, head);
  }
  ::munmap(begin + head + kRegionBytes, kHugePageBytes - head);
  char* const region = begin + head;
  ::madvise(region, kRegionBytes, MADV_HUGEPAGE);  // a wish: small pages do as well
  regions_.push_back(region);
  for (std::size_t offset = kRegionBytes; offset > 0; offset -= kChunkBytes) {
    free_chunks_.push_back(region + offset - kChunkBytes);
  }
}

void MemoryPool::Populate(std::size_t bytes) {
  for (std::size_t done = 0; done < bytes; done += kRegionBytes) {
    absl::MutexLock lock(&mutex_);
    AddRegion();
    char* const region = regions_.back();
    // Chunks are taken from its beginning on.
    const std::size_t end = std::min(kRegionBytes, bytes - done);
    for (std::size_t offset = 0; offset < end; offset += kPageBytes) {
      static_cast<volatile char*>(region)[offset] = 0;
    }
  }
}

std::shared_ptr<char[]> MemoryPool::Take() {
  char* chunk = nullptr;
  {
    absl::MutexLock lock(&mutex_);
    if (free_chunks_.empty()) {
      AddRegion();
    }
    chunk = free_chunks_.back();
    free_chunks_.pop_back();
  }
  return {chunk, [pool = shared_from_this()](char* returned) { pool->Return(returned); }};
}

void MemoryPool::Return(char* chunk) {
  absl::MutexLock lock(&mutex_);
  free_chunks_.push_back(chunk);
}

}  // namespace isoscope::base
