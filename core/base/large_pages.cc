#include "core/base/large_pages.h"

#include <unistd.h>

#include <cstdint>

#include <sys/mman.h>

#include "core/base/check.h"

namespace isoscope::base {
namespace {

// Some kernels of arm64 have pages of 64 KiB, and unmap nothing that begins within one.
std::size_t WholePages(std::size_t bytes) {
  static const auto page_bytes = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  return (bytes + page_bytes - 1) / page_bytes * page_bytes;
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
