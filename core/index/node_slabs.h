// The geometry of a node, shared by both builders: where the slabs are cut, which slabs an interval
// reaches into and covers, and which slabs share a window list.
//
// Example: cuts 10, 20, 30 make the slabs 0 = (-inf, 10], 1 = (10, 20], 2 = (20, 30], 3 = (30,
// inf].
//
//   interval   first  last  covers          goes to
//   (5, 25]      0      2   slab 1          left list of 0, window list of 1, right list of 2
//   (10, 25]     1      2   slab 1          window list of 1, right list of 2
//   (10, 20]     1      1   slab 1          window list of 1
//   (12, 20]     1      1   none            down to slab 1: its leaf list or child node
//
// Definitions, and the proof that cuts at these endpoints bound the intervals that go down:
// docs/format/interval_tree.md, "What lies where".

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

// The number of slabs of a node of `count` > B intervals, before equal cuts are dropped.
std::int64_t SlabCount(std::int64_t count);
// The position of cut i among the 2 * count sorted endpoints of a node's intervals.
// REQUIRES: 0 < i < SlabCount(count).
std::int64_t CutPosition(std::int64_t i, std::int64_t count);
// Appends the next cut to the lower bounds, unless it equals the last one or is infinite.
void AddCut(double cut, std::vector<double>* lower);

// The slabs of a node that an interval reaches into, and whether it covers the outer two.
struct SlabExtent {
  std::uint8_t first_slab = 0;  // first and last slab that it reaches into
  std::uint8_t last_slab = 0;
  bool covers_first = false;
  bool covers_last = false;

  [[nodiscard]] bool goes_down() const {
    return first_slab == last_slab && !(covers_first && covers_last);
  }
  [[nodiscard]] bool in_left_list() const { return !covers_first; }
  [[nodiscard]] bool in_right_list() const { return !covers_last; }
  [[nodiscard]] bool in_windows() const { return first_covered() <= last_covered(); }
  // The slabs that the interval covers; none if first > last.
  [[nodiscard]] int first_covered() const { return first_slab + (covers_first ? 0 : 1); }
  [[nodiscard]] int last_covered() const { return last_slab - (covers_last ? 0 : 1); }
};

// lower: of the node's slabs. REQUIRES: interval.span.min < interval.span.max. O(log slabs).
SlabExtent ExtentOf(const BlockInterval& interval, std::span<const double> lower);

// Consecutive slabs [first, last] that share a window list.
struct Window {
  int first = 0;
  int last = 0;
  std::int64_t size = 0;  // intervals that cover at least one of the slabs
};

// Counts how many kept intervals cover each slab: where their coverage begins and where it ends.
// Thread-compatible.
class Coverage {
 public:
  explicit Coverage(std::size_t slab_count) : begins_(slab_count + 1), ends_(slab_count + 1) {}

  void Add(const SlabExtent& extent);

  // Groups slabs greedily, from slab 0 on: a slab joins the window before it if that then has at
  // most 2 m + B intervals, where m is the fewest that cover one slab of the window. O(slabs).
  [[nodiscard]] std::vector<Window> ChooseWindows() const;

 private:
  std::vector<std::int64_t> begins_;
  std::vector<std::int64_t> ends_;
};

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_NODE_SLABS_H_
