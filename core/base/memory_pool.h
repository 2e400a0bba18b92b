// Chunks of memory of one size, backed by large pages where the kernel has them, and taken from it
// before they are needed: the first touch of a page costs more than filling it.

#ifndef ISOSCOPE_CORE_BASE_MEMORY_POOL_H_
#define ISOSCOPE_CORE_BASE_MEMORY_POOL_H_

#include <cstddef>
#include <memory>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"

namespace isoscope::base {

// Thread-safe.
class MemoryPool : public std::enable_shared_from_this<MemoryPool> {
 public:
  static constexpr std::size_t kChunkBytes = std::size_t{1} << 20;

  static std::shared_ptr<MemoryPool> Make();
  ~MemoryPool();
  MemoryPool(const MemoryPool&) = delete;
  MemoryPool& operator=(const MemoryPool&) = delete;

  // Takes so many bytes from the kernel and touches them. Blocks.
  void Populate(std::size_t bytes);

  // A chunk, aligned to 64 bytes, its content undefined. It goes back to the pool, which outlives
  // it, when the last reference is dropped. Memory that the pool has taken is never returned to the
  // kernel before the pool's end.
  std::shared_ptr<char[]> Take();

 private:
  // Chunks come from the kernel so many at a time.
  static constexpr std::size_t kRegionBytes = 32 * kChunkBytes;

  MemoryPool() = default;
  void AddRegion() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void Return(char* chunk);

  Mutex mutex_;
  std::vector<char*> regions_ ABSL_GUARDED_BY(mutex_);
  std::vector<char*> free_chunks_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MEMORY_POOL_H_
