#include "core/base/large_pages.h"

#include <cstdint>

#include <sys/mman.h>

#include "core/base/check.h"

namespace isoscope::base {
namespace {

std::size_t WholePages(std::size_t bytes) {
  return (bytes + kLargePageBytes - 1) / kLargePageBytes * kLargePageBytes;
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
  ::madvise(begin + head, size, MADV_HUGEPAGE);  // advice: small pages work as well
  return begin + head;
}

void UnmapLargePages(void* memory, std::size_t bytes) {
  ISOSCOPE_CHECK_EQ(::munmap(memory, WholePages(bytes)), 0);
}

}  // namespace isoscope::base
