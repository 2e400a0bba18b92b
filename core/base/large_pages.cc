#include "core/base/large_pages.h"

#include <cstdint>

#include <sys/mman.h>

#include "core/base/check.h"

namespace isoscope::base {
namespace {

constexpr std::size_t kSmallPageBytes = 4096;  // or a part of one, to which the kernel rounds up

std::size_t WholePages(std::size_t bytes) {
  return (bytes + kSmallPageBytes - 1) / kSmallPageBytes * kSmallPageBytes;
}

}  // namespace

void* MapLargePages(std::size_t bytes) {
  const std::size_t size = WholePages(bytes);
  // There is room to cut out an aligned part, because a large page must be aligned to its size.
  void* const mapped = ::mmap(nullptr, size + kLargePageBytes, PROT_READ | PROT_WRITE,
                              MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (mapped == MAP_FAILED) {
    return nullptr;
  }
  char* const begin = static_cast<char*>(mapped);
  const std::size_t misaligned = reinterpret_cast<std::uintptr_t>(begin) % kLargePageBytes;
  const std::size_t head = misaligned == 0 ? 0 : kLargePageBytes - misaligned;
  if (head > 0) {
    ::munmap(begin, head);
  }
  ::munmap(begin + head + size, kLargePageBytes - head);
  // Advice: small pages work as well. The rest has small ones, so that it takes no more than it is.
  ::madvise(begin + head, size / kLargePageBytes * kLargePageBytes, MADV_HUGEPAGE);
  return begin + head;
}

void UnmapLargePages(void* memory, std::size_t bytes) {
  ISOSCOPE_CHECK_EQ(::munmap(memory, WholePages(bytes)), 0);
}

}  // namespace isoscope::base
