// Vectors of many megabytes, in large pages where the kernel has them. Page faults are most of the
// cost of their first touch.

#ifndef ISOSCOPE_CORE_BASE_LARGE_PAGES_H_
#define ISOSCOPE_CORE_BASE_LARGE_PAGES_H_

#include <cstddef>
#include <new>
#include <vector>

namespace isoscope::base {

inline constexpr std::size_t kLargePageBytes = std::size_t{2} << 20;

// Maps `bytes` of zeroed memory; a rest below a large page has small ones. Null if it fails.
void* MapLargePages(std::size_t bytes);
// Gives the memory back to the system. `bytes`: as in MapLargePages. Both are thread-safe.
void UnmapLargePages(void* memory, std::size_t bytes);

// Allocates less than a large page as std::allocator does, and maps anything larger. malloc would
// not reuse its free memory for aligned blocks, so the process would grow.
template <typename T>
struct LargePageAllocator {
  using value_type = T;

  LargePageAllocator() = default;
  template <typename U>
  LargePageAllocator(const LargePageAllocator<U>& /*other*/) {}  // NOLINT: converts, as allocators

  T* allocate(std::size_t count) {
    if (count > static_cast<std::size_t>(-1) / 2 / sizeof(T)) {
      throw std::bad_alloc();
    }
    const std::size_t bytes = count * sizeof(T);
    void* const memory = IsLarge(bytes) ? MapLargePages(bytes) : ::operator new(bytes);
    if (memory == nullptr) {
      throw std::bad_alloc();
    }
    return static_cast<T*>(memory);
  }
  void deallocate(T* memory, std::size_t count) {
    const std::size_t bytes = count * sizeof(T);
    if (IsLarge(bytes)) {
      UnmapLargePages(memory, bytes);
    } else {
      ::operator delete(memory);
    }
  }

  friend bool operator==(const LargePageAllocator&, const LargePageAllocator&) { return true; }

 private:
  static bool IsLarge(std::size_t bytes) { return bytes >= kLargePageBytes; }
};

template <typename T>
using LargePageVector = std::vector<T, LargePageAllocator<T>>;

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_LARGE_PAGES_H_
