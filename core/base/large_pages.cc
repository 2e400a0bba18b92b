#include "core/base/large_pages.h"

#include <algorithm>

#include <sys/mman.h>

namespace isoscope::base {

void* AllocateInLargePages(std::size_t bytes) {
  if (bytes < kLargePageBytes) {
    return std::malloc(std::max<std::size_t>(bytes, 1));
  }
  // Whole large pages: what shares one with other data could not be large.
  const std::size_t rounded = (bytes + kLargePageBytes - 1) / kLargePageBytes * kLargePageBytes;
  void* memory = std::aligned_alloc(kLargePageBytes, rounded);
  if (memory != nullptr) {
    ::madvise(memory, rounded, MADV_HUGEPAGE);  // a wish: small pages do as well
  }
  return memory;
}

}  // namespace isoscope::base
