// Builds a subtree, node by node from its root, with all intervals in one array. For each node:
//
//   1. ChooseSlabs: sort the 2n endpoints and cut at every (2n / k)-th of them. A node of
//      n <= B = 170 intervals is one slab.
//   2. Distribute: a stable counting sort groups the node's piece of the array in place:
//
//        | slab 0 | slab 1 | ... | slab k-1 | kept at this node |
//
//   3. WriteEntryRun: the left, right and window lists of the kept intervals, and a leaf list for
//      each slab that has at most B.
//   4. BuildNode for each slab that has more, on its piece of the array.
//   5. Write the node's page, which was reserved before its entry run, now that the pages of its
//      children are known.
//
// Invariant: each piece is in canonical order (lo, hi, block id, ordinal) whenever BuildNode
// begins, because the counting sort is stable. So the kept intervals are in order of their first
// slab too, and the left and window lists need no sort; only the right lists do. The bytes depend
// on the set of intervals alone.
//
// Example: 400 intervals (i, i + 1], i = 0 .. 399, have 800 endpoints and get
// k = ceil(800 / 170) = 5 slabs, cut at positions 160, 320, 480 and 640 of the sorted endpoints,
// which are 0, 1, 1, 2, 2, ...: at 80, 160, 240 and 320. (79, 80] ends where slab 0 does: each
// interval lies within one slab, none is kept, and the five leaf lists hold 80 each.

#include "core/index/in_memory_node_builder.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <tuple>
#include <vector>

#include "absl/status/status.h"

#include "core/base/status_macros.h"
#include "core/index/interval_tree_format.h"
#include "core/index/node_slabs.h"
#include "core/index/node_writer.h"

namespace isoscope::index {
namespace {

using format::kEntriesPerPage;

// Step 1: returns the lower bounds of the slabs, ascending; -infinity for slab 0.
std::vector<double> ChooseSlabs(std::span<const BlockInterval> intervals) {
  std::vector<double> lower = {kFirstLowerBound};
  const auto count = static_cast<std::int64_t>(intervals.size());
  if (count <= kEntriesPerPage) {
    return lower;
  }
  std::vector<double> endpoints;
  endpoints.reserve(2 * intervals.size());
  for (const BlockInterval& interval : intervals) {
    endpoints.push_back(interval.span.min);
    endpoints.push_back(interval.span.max);
  }
  std::sort(endpoints.begin(), endpoints.end());
  for (std::int64_t i = 1; i < SlabCount(count); ++i) {
    AddCut(endpoints[static_cast<std::size_t>(CutPosition(i, count))], &lower);
  }
  return lower;
}

// The slabs of an interval that is kept at its node.
struct KeptExtent : SlabExtent {
  std::uint32_t interval_index = 0;  // into the kept intervals
};

class InMemoryNodeBuilder {
 public:
  InMemoryNodeBuilder(std::span<BlockInterval> intervals, io::PageFileWriter* pages)
      : pages_(pages) {
    scratch_.reserve(intervals.size());
  }

  absl::StatusOr<io::PageNumber> BuildNode(std::span<BlockInterval> intervals);

 private:
  struct Node : NodeRecords {
    using NodeRecords::NodeRecords;
    std::vector<std::span<BlockInterval>> down;  // by slab
  };

  // Step 2: fills `node->down` and `kept_intervals`, both pieces of `intervals`, and returns the
  // slabs of each kept interval.
  std::vector<KeptExtent> Distribute(std::span<BlockInterval> intervals,
                                     std::span<const double> lower, Node* node,
                                     std::span<BlockInterval>* kept_intervals);
  // Step 3; `intervals` are the kept ones.
  absl::Status WriteEntryRun(std::span<const BlockInterval> intervals, std::span<KeptExtent> kept,
                             Node* node);
  static absl::Status WriteLeftLists(std::span<const BlockInterval> intervals,
                                     std::span<const KeptExtent> kept, Node* node,
                                     EntryRunWriter* entry_run);
  static absl::Status WriteRightLists(std::span<const BlockInterval> intervals,
                                      std::span<const KeptExtent> kept, Node* node,
                                      EntryRunWriter* entry_run);
  static absl::Status WriteWindowLists(std::span<const BlockInterval> intervals,
                                       std::span<const KeptExtent> kept, Node* node,
                                       EntryRunWriter* entry_run);
  static absl::Status WriteLeafLists(Node* node, EntryRunWriter* entry_run);

  io::PageFileWriter* pages_;
  std::vector<BlockInterval> scratch_;
};

std::vector<KeptExtent> InMemoryNodeBuilder::Distribute(std::span<BlockInterval> intervals,
                                                        std::span<const double> lower, Node* node,
                                                        std::span<BlockInterval>* kept_intervals) {
  const std::size_t slab_count = lower.size();
  node->down.resize(slab_count);

  // A stable counting sort by slab; the kept intervals come last.
  std::vector<std::size_t> begin(slab_count + 2, 0);
  std::vector<std::uint8_t> bucket_of(intervals.size());
  std::vector<KeptExtent> kept;
  const bool fits_leaf = static_cast<std::int64_t>(intervals.size()) <= kEntriesPerPage;
  for (std::size_t i = 0; i < intervals.size(); ++i) {
    const SlabExtent extent = ExtentOf(intervals[i], lower);
    std::size_t bucket = extent.first_slab;
    if (!extent.goes_down() && !fits_leaf) {
      bucket = slab_count;
      kept.push_back({extent, static_cast<std::uint32_t>(kept.size())});
    }
    bucket_of[i] = static_cast<std::uint8_t>(bucket);
    ++begin[bucket + 1];
  }
  for (std::size_t bucket = 1; bucket < begin.size(); ++bucket) {
    begin[bucket] += begin[bucket - 1];
  }
  scratch_.assign(intervals.begin(), intervals.end());
  std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
  for (std::size_t i = 0; i < scratch_.size(); ++i) {
    intervals[next[bucket_of[i]]++] = scratch_[i];
  }
  for (std::size_t slab = 0; slab < slab_count; ++slab) {
    node->down[slab] = intervals.subspan(begin[slab], begin[slab + 1] - begin[slab]);
  }
  *kept_intervals = intervals.subspan(begin[slab_count]);
  return kept;
}

absl::Status InMemoryNodeBuilder::WriteLeftLists(std::span<const BlockInterval> intervals,
                                                 std::span<const KeptExtent> kept, Node* node,
                                                 EntryRunWriter* entry_run) {
  // Canonical order is ascending by lo, and so by slab.
  std::size_t next = 0;
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].left_begin = entry_run->entry_count();
    for (; next < kept.size() && kept[next].first_slab == slab; ++next) {
      if (kept[next].in_left_list()) {
        ISOSCOPE_RETURN_IF_ERROR(entry_run->Append(intervals[kept[next].interval_index]));
      }
    }
  }
  node->header.left_end = entry_run->entry_count();
  return absl::OkStatus();
}

absl::Status InMemoryNodeBuilder::WriteRightLists(std::span<const BlockInterval> intervals,
                                                  std::span<const KeptExtent> kept, Node* node,
                                                  EntryRunWriter* entry_run) {
  std::vector<KeptExtent> right;
  std::copy_if(kept.begin(), kept.end(), std::back_inserter(right),
               [](const KeptExtent& extent) { return extent.in_right_list(); });
  std::sort(right.begin(), right.end(), [intervals](const KeptExtent& a, const KeptExtent& b) {
    const double a_max = intervals[a.interval_index].span.max;
    const double b_max = intervals[b.interval_index].span.max;
    // Ascending by slab, descending by hi, then canonical.
    return std::tie(a.last_slab, b_max, a.interval_index) <
           std::tie(b.last_slab, a_max, b.interval_index);
  });
  std::size_t next = 0;
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].right_begin = entry_run->entry_count();
    for (; next < right.size() && right[next].last_slab == slab; ++next) {
      ISOSCOPE_RETURN_IF_ERROR(entry_run->Append(intervals[right[next].interval_index]));
    }
  }
  node->header.right_end = entry_run->entry_count();
  return absl::OkStatus();
}

absl::Status InMemoryNodeBuilder::WriteWindowLists(std::span<const BlockInterval> intervals,
                                                   std::span<const KeptExtent> kept, Node* node,
                                                   EntryRunWriter* entry_run) {
  // Canonical order is also ascending by first covered slab. So one sweep over the windows opens
  // each interval at the first window that it reaches, and closes it after the last.
  Coverage coverage(node->slabs.size());
  std::for_each(kept.begin(), kept.end(), [&](const KeptExtent& extent) { coverage.Add(extent); });
  std::vector<KeptExtent> open;
  std::size_t next = 0;
  for (const Window& window : coverage.ChooseWindows()) {
    open.erase(std::remove_if(open.begin(), open.end(),
                              [&window](const KeptExtent& extent) {
                                return extent.last_covered() < window.first;
                              }),
               open.end());
    for (; next < kept.size() && kept[next].first_covered() <= window.last; ++next) {
      if (kept[next].in_windows()) {
        open.push_back(kept[next]);
      }
    }
    for (int slab = window.first; slab <= window.last; ++slab) {
      format::SlabRecord& record = node->slabs[static_cast<std::size_t>(slab)];
      record.window_begin = entry_run->entry_count();
      record.window_size = static_cast<std::uint32_t>(open.size());
    }
    for (const KeptExtent& extent : open) {
      ISOSCOPE_RETURN_IF_ERROR(entry_run->Append(intervals[extent.interval_index]));
    }
  }
  node->header.window_end = entry_run->entry_count();
  return absl::OkStatus();
}

absl::Status InMemoryNodeBuilder::WriteLeafLists(Node* node, EntryRunWriter* entry_run) {
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].leaf_begin = entry_run->entry_count();
    if (static_cast<std::int64_t>(node->down[slab].size()) <= kEntriesPerPage) {
      for (const BlockInterval& interval : node->down[slab]) {
        ISOSCOPE_RETURN_IF_ERROR(entry_run->Append(interval));
      }
      node->down[slab] = {};
    }
  }
  node->header.leaf_end = entry_run->entry_count();
  return absl::OkStatus();
}

absl::Status InMemoryNodeBuilder::WriteEntryRun(std::span<const BlockInterval> intervals,
                                                std::span<KeptExtent> kept, Node* node) {
  EntryRunWriter entry_run(pages_);
  ISOSCOPE_RETURN_IF_ERROR(WriteLeftLists(intervals, kept, node, &entry_run));
  ISOSCOPE_RETURN_IF_ERROR(WriteRightLists(intervals, kept, node, &entry_run));
  ISOSCOPE_RETURN_IF_ERROR(WriteWindowLists(intervals, kept, node, &entry_run));
  ISOSCOPE_RETURN_IF_ERROR(WriteLeafLists(node, &entry_run));
  return entry_run.Finish();
}

absl::StatusOr<io::PageNumber> InMemoryNodeBuilder::BuildNode(std::span<BlockInterval> intervals) {
  ISOSCOPE_ASSIGN_OR_RETURN(const io::PageNumber page, pages_->Append(""));
  const std::vector<double> lower = ChooseSlabs(intervals);
  Node node(lower);
  {
    std::span<BlockInterval> kept_intervals;
    std::vector<KeptExtent> kept = Distribute(intervals, lower, &node, &kept_intervals);
    ISOSCOPE_RETURN_IF_ERROR(WriteEntryRun(kept_intervals, kept, &node));
  }
  for (std::size_t slab = 0; slab < node.slabs.size(); ++slab) {
    if (!node.down[slab].empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(node.slabs[slab].child_page, BuildNode(node.down[slab]));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(pages_->Overwrite(page, node.Encode()));
  return page;
}

}  // namespace

absl::StatusOr<io::PageNumber> BuildNodeInMemory(std::span<BlockInterval> intervals,
                                                 io::PageFileWriter* pages) {
  return InMemoryNodeBuilder(intervals, pages).BuildNode(intervals);
}

}  // namespace isoscope::index
