// See arena_threads.h.

#ifndef ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_BLOCKED_RANGE_H_
#define ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_BLOCKED_RANGE_H_

#include <cstddef>

#include "oneapi/tbb/partitioner.h"

namespace tbb {
inline namespace stand_in {

template <typename Value>
class blocked_range {
 public:
  using const_iterator = Value;

  blocked_range(Value begin, Value end, std::size_t grainsize = 1)
      : begin_(begin), end_(end), grainsize_(grainsize) {}
  // Takes the second half of `other`.
  blocked_range(blocked_range& other, split /*tag*/)
      : begin_(other.begin_ + (other.end_ - other.begin_) / 2),
        end_(other.end_),
        grainsize_(other.grainsize_) {
    other.end_ = begin_;
  }

  [[nodiscard]] Value begin() const { return begin_; }
  [[nodiscard]] Value end() const { return end_; }
  [[nodiscard]] std::size_t size() const { return static_cast<std::size_t>(end_ - begin_); }
  [[nodiscard]] std::size_t grainsize() const { return grainsize_; }
  [[nodiscard]] bool empty() const { return !(begin_ < end_); }
  [[nodiscard]] bool is_divisible() const { return !empty() && grainsize_ < size(); }

 private:
  Value begin_;
  Value end_;
  std::size_t grainsize_;
};

}  // namespace stand_in
}  // namespace tbb

#endif  // ISOSCOPE_TESTS_SUPPORT_TSAN_TBB_ONEAPI_TBB_BLOCKED_RANGE_H_
