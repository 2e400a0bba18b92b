#include "core/index/node_slabs.h"

#include <algorithm>

#include "core/index/interval_tree_format.h"

namespace isoscope::index {
namespace {

using format::kEntriesPerPage;
using format::kMaxSlabs;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

std::int64_t SlabCount(std::int64_t count) {
  return std::min(kMaxSlabs, (2 * count + kEntriesPerPage - 1) / kEntriesPerPage);
}

std::int64_t CutPosition(std::int64_t i, std::int64_t count) {
  return i * 2 * count / SlabCount(count);
}

void AddCut(double cut, std::vector<double>* lower) {
  if (cut > lower->back() && cut < kInfinity) {
    lower->push_back(cut);
  }
}

SlabExtent ExtentOf(const BlockInterval& interval, std::span<const double> lower) {
  // lower[0] is -infinity: never above lo, always below hi. The searches leave it out.
  const auto first = std::upper_bound(lower.begin() + 1, lower.end(), interval.span.min) - 1;
  const auto last = std::lower_bound(lower.begin() + 1, lower.end(), interval.span.max) - 1;
  double upper = kInfinity;
  if (last + 1 != lower.end()) {
    upper = last[1];
  }
  SlabExtent extent;
  extent.first_slab = static_cast<std::uint8_t>(first - lower.begin());
  extent.last_slab = static_cast<std::uint8_t>(last - lower.begin());
  extent.covers_first = interval.span.min == *first;
  extent.covers_last = interval.span.max == upper;
  return extent;
}

void Coverage::Add(const SlabExtent& extent) {
  if (extent.in_windows()) {
    ++begins_[static_cast<std::size_t>(extent.first_covered())];
    ++ends_[static_cast<std::size_t>(extent.last_covered()) + 1];
  }
}

std::vector<Window> Coverage::ChooseWindows() const {
  std::vector<Window> windows;
  std::int64_t covering = 0;  // intervals that cover the current slab
  std::int64_t least = 0;     // the fewest that cover one slab of the current window
  for (std::size_t at = 0; at + 1 < begins_.size(); ++at) {
    const auto slab = static_cast<int>(at);
    covering += begins_[at] - ends_[at];
    least = std::min(least, covering);
    if (!windows.empty() && windows.back().size + begins_[at] <= 2 * least + kEntriesPerPage) {
      windows.back().last = slab;
      windows.back().size += begins_[at];
    } else {
      windows.push_back({slab, slab, covering});
      least = covering;
    }
  }
  return windows;
}

}  // namespace isoscope::index
