// Vectors of many megabytes, in large pages where the kernel has them: faults are what their first
// touch costs most.

#ifndef ISOSCOPE_CORE_BASE_LARGE_PAGES_H_
#define ISOSCOPE_CORE_BASE_LARGE_PAGES_H_

#include <cstddef>
#include <cstdlib>
#include <new>
#include <vector>

namespace isoscope::base {

inline constexpr std::size_t kLargePageBytes = std::size_t{2} << 20;

// From std::malloc's family: std::free gives it back. Null if there is no memory.
void* AllocateInLargePages(std::size_t bytes);

// What is smaller than a large page is allocated as always.
template <typename T>
struct LargePageAllocator {
  using value_type = T;

  LargePageAllocator() = default;
  template <typename U>
  LargePageAllocator(const LargePageAllocator<U>& /*other*/) {}  // NOLINT: converts, as allocators

  T* allocate(std::size_t count) {
    void* memory = count > static_cast<std::size_t>(-1) / 2 / sizeof(T)
                       ? nullptr
                       : AllocateInLargePages(count * sizeof(T));
    if (memory == nullptr) {
      throw std::bad_alloc();
    }
    return static_cast<T*>(memory);
  }
  void deallocate(T* memory, std::size_t /*count*/) { std::free(memory); }

  friend bool operator==(const LargePageAllocator&, const LargePageAllocator&) { return true; }
};

template <typename T>
using LargePageVector = std::vector<T, LargePageAllocator<T>>;

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_LARGE_PAGES_H_
