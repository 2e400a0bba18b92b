// Chunks of memory of one size, in large pages where the kernel has them. They are taken from the
// kernel before they are needed, because the first touch of a page costs more than filling it.

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
  static constexpr std::size_t kChunkBytes = std::size_t{1} << 20;  // the largest, and the default

  // chunk_bytes: a power of two, from 4096 to kChunkBytes
  static std::shared_ptr<MemoryPool> Make(std::size_t chunk_bytes = kChunkBytes);
  ~MemoryPool();
  MemoryPool(const MemoryPool&) = delete;
  MemoryPool& operator=(const MemoryPool&) = delete;

  [[nodiscard]] std::size_t chunk_bytes() const { return chunk_bytes_; }

  // Takes `bytes` from the kernel and touches them. Blocks; others may take chunks meanwhile.
  void Populate(std::size_t bytes);

  // Returns the bytes of the free chunks whose pages have been touched. Take prefers those.
  [[nodiscard]] std::size_t touched_free_bytes() const;

  // Returns a chunk, aligned to 64 bytes, with undefined content. May throw std::bad_alloc. The
  // chunk goes back to the pool when its last reference is dropped, and keeps the pool alive until
  // then. The pool returns no memory to the kernel before its own end.
  std::shared_ptr<char[]> Take();

 private:
  // The pool takes this much at a time from the kernel.
  static constexpr std::size_t kRegionBytes = 32 * kChunkBytes;

  explicit MemoryPool(std::size_t chunk_bytes) : chunk_bytes_(chunk_bytes) {}
  // Returns a large page that nobody has touched. free_chunks_ has room for its chunks.
  char* TakeFreshPage() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Puts the chunks of a page below the free ones, so that its first chunk is taken first of them.
  void AddChunksOf(char* page) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Allocates nothing: destructors call it.
  void Return(char* chunk);

  const std::size_t chunk_bytes_;
  mutable Mutex mutex_;
  std::vector<char*> regions_ ABSL_GUARDED_BY(mutex_);
  std::vector<char*> fresh_pages_ ABSL_GUARDED_BY(mutex_);  // taken from the back
  // Touched; taken from the back. Its capacity is enough for all chunks.
  std::vector<char*> free_chunks_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MEMORY_POOL_H_
