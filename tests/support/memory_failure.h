// Makes operator new fail, as if memory had run out. Link it into a test program of its own: it
// replaces operator new and delete of the whole program. Libraries that call malloc don't notice;
// TBB is one of them.

#ifndef ISOSCOPE_TESTS_SUPPORT_MEMORY_FAILURE_H_
#define ISOSCOPE_TESTS_SUPPORT_MEMORY_FAILURE_H_

#include <cstdint>
#include <functional>

namespace isoscope::testing {

// While it lives, the allocations of all threads are numbered from 1. One at a time.
class MemoryFailure {
 public:
  enum class Mode {
    kOnce,       // the `nth` allocation fails
    kFromThere,  // it and all later ones fail
  };
  MemoryFailure(std::int64_t nth, Mode mode);
  ~MemoryFailure();
  MemoryFailure(const MemoryFailure&) = delete;
  MemoryFailure& operator=(const MemoryFailure&) = delete;

  // Returns true if there were `nth` allocations.
  [[nodiscard]] bool has_come() const;
};

// While it lives, allocations of the calling thread neither count nor fail: those of the test.
class SparedFromFailure {
 public:
  SparedFromFailure();
  ~SparedFromFailure();
  SparedFromFailure(const SparedFromFailure&) = delete;
  SparedFromFailure& operator=(const SparedFromFailure&) = delete;
};

// Returns the number of allocations that were not freed yet.
std::int64_t LiveAllocationCount();

// Calls run(nth, mode) for both modes and nth = 1, 2, ... until it returns false: there were not so
// many allocations. Leaves out more and more of a long tail, unless the environment variable
// ISOSCOPE_EVERY_ALLOCATION is set. Returns the number of runs.
int ForEachFailure(const std::function<bool(std::int64_t nth, MemoryFailure::Mode mode)>& run);

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_MEMORY_FAILURE_H_
