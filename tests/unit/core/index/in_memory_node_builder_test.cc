// Compares every page of a tree with docs/format/interval_tree.md, "What lies where":
//
// 1. Build a tree of a shape of intervals, and read its pages.
// 2. Compute the bounds of the slabs and the lists of a node by the document's definitions.
// 3. Compare the node's page and its entry run, then do the same for its children (ExpectSubtree).

#include "core/index/in_memory_node_builder.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <tuple>
#include <vector>

#include "gtest/gtest.h"

#include "core/index/interval_tree.h"
#include "core/index/interval_tree_format.h"
#include "core/io/page_file.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/index/interval_sets.h"

namespace isoscope::index {
namespace {

using ::isoscope::testing::MemoryReadFile;
using ::isoscope::testing::MemoryWriteFile;
using Intervals = std::vector<BlockInterval>;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr std::int64_t kB = 170;

// The intervals of a shape that are ever active, in canonical order.
Intervals CanonicalIntervals(Shape shape, std::size_t count) {
  Intervals intervals;
  for (const BlockInterval& interval : MakeIntervals(shape, count, count)) {
    if (interval.span.min < interval.span.max) {
      intervals.push_back(interval);
    }
  }
  std::sort(intervals.begin(), intervals.end(), [](const BlockInterval& a, const BlockInterval& b) {
    return std::tie(a.span.min, a.span.max, a.block_id, a.ordinal) <
           std::tie(b.span.min, b.span.max, b.block_id, b.ordinal);
  });
  return intervals;
}

// The bounds s_0 to s_k.
std::vector<double> ExpectedBounds(const Intervals& intervals) {
  std::vector<double> bounds = {-kInfinity};
  const auto n = static_cast<std::int64_t>(intervals.size());
  if (n > kB) {
    std::vector<double> endpoints;
    for (const BlockInterval& interval : intervals) {
      endpoints.push_back(interval.span.min);
      endpoints.push_back(interval.span.max);
    }
    std::sort(endpoints.begin(), endpoints.end());
    const std::int64_t k = std::min<std::int64_t>(126, (2 * n + kB - 1) / kB);
    for (std::int64_t i = 1; i < k; ++i) {
      const double cut = endpoints[static_cast<std::size_t>(i * 2 * n / k)];
      if (cut != bounds.back() && cut != kInfinity) {
        bounds.push_back(cut);
      }
    }
  }
  bounds.push_back(kInfinity);
  return bounds;
}

// The lists of a node, by slab.
struct Lists {
  std::vector<Intervals> left, right, down;
  std::vector<std::size_t> window_of_slab;
  std::vector<Intervals> windows;
};

bool Covers(const BlockInterval& interval, double begin, double end) {
  return interval.span.min <= begin && end <= interval.span.max;
}

void ExpectWindows(const Intervals& kept, const std::vector<double>& bounds, Lists* lists) {
  std::vector<bool> in_window;
  std::int64_t least = 0;
  for (std::size_t slab = 0; slab + 1 < bounds.size(); ++slab) {
    std::vector<bool> covering(kept.size());
    std::vector<bool> joined = in_window;
    joined.resize(kept.size());
    for (std::size_t i = 0; i < kept.size(); ++i) {
      covering[i] = Covers(kept[i], bounds[slab], bounds[slab + 1]);
      joined[i] = joined[i] || covering[i];
    }
    const std::int64_t here = std::count(covering.begin(), covering.end(), true);
    const std::int64_t least_joined = std::min(least, here);
    const bool joins =
        slab > 0 && std::count(joined.begin(), joined.end(), true) <= 2 * least_joined + kB;
    in_window = joins ? joined : covering;
    least = joins ? least_joined : here;
    if (!joins) {
      lists->windows.emplace_back();
    }
    lists->window_of_slab.push_back(lists->windows.size() - 1);
    lists->windows.back().clear();
    for (std::size_t i = 0; i < kept.size(); ++i) {
      if (in_window[i]) {
        lists->windows.back().push_back(kept[i]);
      }
    }
  }
}

Lists ExpectedLists(const Intervals& intervals, const std::vector<double>& bounds) {
  const std::size_t slab_count = bounds.size() - 1;
  Lists lists;
  lists.left.resize(slab_count);
  lists.right.resize(slab_count);
  lists.down.resize(slab_count);
  Intervals kept;
  const bool is_leaf = static_cast<std::int64_t>(intervals.size()) <= kB;
  for (const BlockInterval& interval : intervals) {
    std::size_t a = 0;
    while (!(bounds[a] <= interval.span.min && interval.span.min < bounds[a + 1])) {
      ++a;
    }
    std::size_t b = 0;
    while (!(bounds[b] < interval.span.max && interval.span.max <= bounds[b + 1])) {
      ++b;
    }
    if (is_leaf || (a == b && !Covers(interval, bounds[a], bounds[a + 1]))) {
      lists.down[a].push_back(interval);
      continue;
    }
    kept.push_back(interval);
    if (interval.span.min > bounds[a]) {
      lists.left[a].push_back(interval);
    }
    if (interval.span.max < bounds[b + 1]) {
      lists.right[b].push_back(interval);
    }
  }
  for (Intervals& right : lists.right) {
    std::stable_sort(
        right.begin(), right.end(),
        [](const BlockInterval& x, const BlockInterval& y) { return x.span.max > y.span.max; });
  }
  ExpectWindows(kept, bounds, &lists);
  return lists;
}

// Checks the subtree at `*page`, and sets `*page` to the page behind it.
void ExpectSubtree(const io::PageFile& pages, const Intervals& intervals, io::PageNumber* page) {
  const std::vector<double> bounds = ExpectedBounds(intervals);
  const Lists lists = ExpectedLists(intervals, bounds);
  io::PageReadCost cost;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto node, pages.Read((*page)++, &cost));
  const char* payload = node.payload().data();
  const format::NodeHeader header = format::DecodeNodeHeader(payload);
  ASSERT_EQ(header.slab_count, bounds.size() - 1);
  std::vector<format::SlabRecord> slabs;
  for (std::int64_t slab = 0; slab < header.slab_count; ++slab) {
    slabs.push_back(format::DecodeSlabRecord(payload + format::SlabRecordOffset(slab)));
    ASSERT_EQ(slabs.back().lower, bounds[static_cast<std::size_t>(slab)]);
  }

  Intervals run;
  const auto append = [&run](const Intervals& list) {
    const auto begin = static_cast<std::uint32_t>(run.size());
    run.insert(run.end(), list.begin(), list.end());
    return begin;
  };
  for (std::size_t slab = 0; slab < slabs.size(); ++slab) {
    ASSERT_EQ(slabs[slab].left_begin, append(lists.left[slab]));
  }
  ASSERT_EQ(header.left_end, run.size());
  for (std::size_t slab = 0; slab < slabs.size(); ++slab) {
    ASSERT_EQ(slabs[slab].right_begin, append(lists.right[slab]));
  }
  ASSERT_EQ(header.right_end, run.size());
  std::vector<std::uint32_t> window_begins;
  for (const Intervals& window : lists.windows) {
    window_begins.push_back(append(window));
  }
  ASSERT_EQ(header.window_end, run.size());
  for (std::size_t slab = 0; slab < slabs.size(); ++slab) {
    const std::size_t window = lists.window_of_slab[slab];
    ASSERT_EQ(slabs[slab].window_begin, window_begins[window]);
    ASSERT_EQ(slabs[slab].window_size, lists.windows[window].size());
    const bool is_leaf = static_cast<std::int64_t>(lists.down[slab].size()) <= kB;
    ASSERT_EQ(slabs[slab].leaf_begin, append(is_leaf ? lists.down[slab] : Intervals()));
  }
  ASSERT_EQ(header.leaf_end, run.size());

  for (std::size_t begin = 0; begin < run.size(); begin += static_cast<std::size_t>(kB)) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto entries, pages.Read((*page)++, &cost));
    for (std::size_t i = begin; i < std::min(begin + static_cast<std::size_t>(kB), run.size());
         ++i) {
      ASSERT_EQ(format::DecodeEntry(entries.payload().data() + format::kEntryPageHeaderBytes +
                                    (i - begin) * format::kEntryBytes),
                run[i]);
    }
  }
  for (std::size_t slab = 0; slab < slabs.size(); ++slab) {
    if (static_cast<std::int64_t>(lists.down[slab].size()) <= kB) {
      ASSERT_EQ(slabs[slab].child_page, 0u);
    } else {
      ASSERT_EQ(slabs[slab].child_page, *page);
      ASSERT_NO_FATAL_FAILURE(ExpectSubtree(pages, lists.down[slab], page));
    }
  }
}

class InMemoryNodeBuilderTest : public ::testing::TestWithParam<Shape> {};

TEST_P(InMemoryNodeBuilderTest, SubtreeIsTheDocumentedOne) {
  // One leaf list; the fewest slabs; some; the most slabs and child nodes.
  for (const std::size_t count : {170u, 171u, 1700u, 12000u}) {
    SCOPED_TRACE(count);
    const Intervals intervals = CanonicalIntervals(GetParam(), count);
    std::string bytes;
    MemoryWriteFile file(&bytes);
    io::PageFileWriter writer(&file, 0);
    ISOSCOPE_ASSERT_OK(writer.Append(""));
    Intervals input = intervals;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(io::PageNumber page, BuildNodeInMemory(input, &writer));
    EXPECT_EQ(page, 1u);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pages,
                                  io::PageFile::Open(std::make_unique<MemoryReadFile>(bytes), 0));
    ASSERT_NO_FATAL_FAILURE(ExpectSubtree(*pages, intervals, &page));
    EXPECT_EQ(page, writer.page_count());
  }
}

INSTANTIATE_TEST_SUITE_P(AllShapes, InMemoryNodeBuilderTest, ::testing::ValuesIn(kShapes),
                         [](const ::testing::TestParamInfo<Shape>& param) {
                           return std::string(kShapeNames[static_cast<int>(param.param)]);
                         });

}  // namespace
}  // namespace isoscope::index
