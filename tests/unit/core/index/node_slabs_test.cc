#include "core/index/node_slabs.h"

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "gtest/gtest.h"

#include "core/index/interval_tree.h"
#include "core/index/interval_tree_format.h"

namespace isoscope::index {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

TEST(NodeSlabsTest, IntervalPlaysExactlyOnePartInEachSlabThatItReaches) {
  const std::vector<double> lower = {-kInfinity, 1, 2, 3};
  const std::vector<double> upper = {1, 2, 3, kInfinity};
  // Both ends of the axis, every cut, and between them.
  const std::vector<double> ends = {-kInfinity, 0,    0.5, 1, 1.25, 1.5,
                                    2,          2.25, 2.5, 3, 4,    kInfinity};
  for (const double lo : ends) {
    for (const double hi : ends) {
      if (!(lo < hi)) {
        continue;
      }
      SCOPED_TRACE(::testing::Message() << lo << " to " << hi);
      const SlabExtent extent = ExtentOf({.span = {lo, hi}}, lower);
      for (std::size_t slab = 0; slab < lower.size(); ++slab) {
        const double begin = lower[slab];
        const double end = upper[slab];
        // Queries of the slab are in (begin, end], those that report the interval in (lo, hi].
        const bool reaches = lo < end && begin < hi;
        const bool covers = lo <= begin && end <= hi;
        const bool is_first = reaches && begin <= lo;
        const bool is_last = reaches && hi <= end;
        const auto at = static_cast<int>(slab);
        const bool goes_down = extent.goes_down() && extent.first_slab == at;
        const bool in_left =
            !extent.goes_down() && extent.in_left_list() && extent.first_slab == at;
        const bool in_right =
            !extent.goes_down() && extent.in_right_list() && extent.last_slab == at;
        const bool in_window = extent.first_covered() <= at && at <= extent.last_covered();
        EXPECT_EQ(goes_down, is_first && is_last && !covers) << slab;
        EXPECT_EQ(in_left, is_first && !is_last && !covers) << slab;
        EXPECT_EQ(in_right, is_last && !is_first && !covers) << slab;
        EXPECT_EQ(in_window, covers) << slab;
        EXPECT_EQ(goes_down + in_left + in_right + in_window, reaches ? 1 : 0) << slab;
      }
    }
  }
}

// Returns the windows of three slabs: 10 intervals cover all three, and `more` cover the second one
// only.
std::vector<Window> WindowsOf(std::int64_t more) {
  Coverage coverage(3);
  const std::vector<double> lower = {-kInfinity, 1, 2};
  for (int i = 0; i < 10; ++i) {
    coverage.Add(ExtentOf({.span = {-kInfinity, kInfinity}}, lower));
  }
  for (std::int64_t i = 0; i < more; ++i) {
    coverage.Add(ExtentOf({.span = {1, 2}}, lower));
  }
  return coverage.ChooseWindows();
}

TEST(NodeSlabsTest, WindowHoldsTwiceItsLeastCrowdedSlabAndAPageMore) {
  const std::vector<Window> one = WindowsOf(10 + format::kEntriesPerPage);
  ASSERT_EQ(one.size(), 1u);
  EXPECT_EQ(one[0].last, 2);
  EXPECT_EQ(one[0].size, 20 + format::kEntriesPerPage);

  // One too many for the first window; the third slab's 10 leave the second one alone as well.
  const std::vector<Window> three = WindowsOf(11 + format::kEntriesPerPage);
  ASSERT_EQ(three.size(), 3u);
  EXPECT_EQ(three[0].size, 10);
  EXPECT_EQ(three[1].first, 1);
  EXPECT_EQ(three[1].size, 21 + format::kEntriesPerPage);
  EXPECT_EQ(three[2].first, 2);
  EXPECT_EQ(three[2].size, 10);
}

}  // namespace
}  // namespace isoscope::index
