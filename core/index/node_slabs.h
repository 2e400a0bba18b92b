// How a node cuts its intervals: slabs, the part of an interval, windows. What both builders share.

#ifndef ISOSCOPE_CORE_INDEX_NODE_SLABS_H_
#define ISOSCOPE_CORE_INDEX_NODE_SLABS_H_

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "core/index/interval_tree.h"

namespace isoscope::index {

// Slabs are given as their lower bounds, ascending. This is the first one.
inline constexpr double kFirstLowerBound = -std::numeric_limits<double>::infinity();

// Slabs that a node of `count` > B intervals is cut into, before equal cuts are dropped.
std::int64_t SlabCount(std::int64_t count);
// Where the i-th cut, 0 < i < SlabCount(count), is among the sorted endpoints of `count` intervals.
std::int64_t CutPosition(std::int64_t i, std::int64_t count);
// Appends the next cut, unless it equals the last one or is infinite.
void AddCut(double cut, std::vector<double>* lower);

// The part that an interval plays at a node.
struct Part {
  std::uint8_t first_slab = 0;  // that it reaches into
  std::uint8_t last_slab = 0;
  bool covers_first = false;
  bool covers_last = false;

  [[nodiscard]] bool goes_down() const {
    return first_slab == last_slab && !(covers_first && covers_last);
  }
  [[nodiscard]] bool in_left_list() const { return !covers_first; }
  [[nodiscard]] bool in_right_list() const { return !covers_last; }
  [[nodiscard]] bool in_windows() const { return first_covered() <= last_covered(); }
  // The slabs that it covers; none if first > last.
  [[nodiscard]] int first_covered() const { return first_slab + (covers_first ? 0 : 1); }
  [[nodiscard]] int last_covered() const { return last_slab - (covers_last ? 0 : 1); }
};

// REQUIRES: `interval` is active somewhere.
Part PartOf(const BlockInterval& interval, std::span<const double> lower);

// Consecutive slabs [first, last] that share a list.
struct Window {
  int first = 0;
  int last = 0;
  std::int64_t size = 0;  // intervals that cover one of them
};

// How many kept intervals begin and end to cover slabs, by slab.
class Coverage {
 public:
  explicit Coverage(std::size_t slab_count) : begins_(slab_count + 1), ends_(slab_count + 1) {}

  void Add(const Part& part);

  // Groups slabs greedily while a window has at most 2 * (its least crowded slab) + B intervals.
  [[nodiscard]] std::vector<Window> ChooseWindows() const;

 private:
  std::vector<std::int64_t> begins_;
  std::vector<std::int64_t> ends_;
};

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_NODE_SLABS_H_
