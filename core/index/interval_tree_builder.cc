// Builds a node at a time, from the root down:
//
//   1. choose the slabs' bounds from the sorted endpoints;
//   2. give every interval its part: passed down to a slab, or kept in left, right, window lists;
//   3. write the node's page (a placeholder) and its run: left, right, window and leaf lists;
//   4. build the child nodes, then write the node's page for good.
//
// Intervals are in canonical order from the start and every step keeps it, so that the bytes
// depend on the set only. Based on: Arge and Vitter 2003, section 2; Chiang and Silva 1997,
// section 3; Chazelle 1986 (window lists).

#include "core/index/interval_tree_builder.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <span>
#include <string>
#include <tuple>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/crc32c.h"
#include "core/base/page_file.h"
#include "core/base/status_macros.h"
#include "core/index/interval_tree_format.h"

namespace isoscope::index {
namespace {

using format::kEntriesPerPage;
using format::kMaxSlabs;

bool CanonicalLess(const BlockInterval& a, const BlockInterval& b) {
  return std::tie(a.span.min, a.span.max, a.block_id, a.ordinal) <
         std::tie(b.span.min, b.span.max, b.block_id, b.ordinal);
}

// Drops intervals that are never active, makes negative zeros positive, and sorts.
void Canonicalize(std::vector<BlockInterval>* intervals) {
  // NaN fails every comparison and is dropped as well.
  intervals->erase(std::remove_if(intervals->begin(), intervals->end(),
                                  [](const BlockInterval& interval) {
                                    return !(interval.span.min < interval.span.max);
                                  }),
                   intervals->end());
  for (BlockInterval& interval : *intervals) {
    interval.span.min += 0.0;
    interval.span.max += 0.0;
  }
  std::sort(intervals->begin(), intervals->end(), CanonicalLess);
}

std::uint32_t Fingerprint(std::span<const BlockInterval> intervals) {
  std::uint32_t crc = 0;
  for (const BlockInterval& interval : intervals) {
    char bytes[format::kEntryBytes];
    format::EncodeEntry(interval, bytes);
    crc = base::ExtendCrc32c(crc, bytes, sizeof(bytes));
  }
  return crc;
}

// Writes the entries of one run to full pages. Thread-compatible.
class RunWriter {
 public:
  explicit RunWriter(base::PageFileWriter* pages) : pages_(pages) { StartPage(); }

  absl::Status Append(const BlockInterval& interval) {
    char bytes[format::kEntryBytes];
    format::EncodeEntry(interval, bytes);
    payload_.append(bytes, sizeof(bytes));
    ++entry_count_;
    return ++page_entry_count_ == kEntriesPerPage ? Finish() : absl::OkStatus();
  }

  // Writes the last page, if it has entries.
  absl::Status Finish() {
    if (page_entry_count_ == 0) {
      return absl::OkStatus();
    }
    base::StoreLittleEndian(static_cast<std::uint16_t>(page_entry_count_), &payload_[2]);
    ISOSCOPE_RETURN_IF_ERROR(pages_->Append(payload_).status());
    StartPage();
    return absl::OkStatus();
  }

  // Entries so far: the position of the next one.
  [[nodiscard]] std::uint32_t entry_count() const { return entry_count_; }

 private:
  void StartPage() {
    payload_.assign(format::kEntryPageHeaderBytes, '\0');
    base::StoreLittleEndian(format::kEntryPageKind, payload_.data());
    page_entry_count_ = 0;
  }

  base::PageFileWriter* pages_;
  std::string payload_;
  std::int64_t page_entry_count_ = 0;
  std::uint32_t entry_count_ = 0;
};

// Pass 1: the lower bounds of the slabs, ascending; -infinity for slab 0.
std::vector<double> ChooseSlabs(std::span<const BlockInterval> intervals) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  std::vector<double> lower = {-kInfinity};
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
  const std::int64_t slab_count =
      std::min(kMaxSlabs, (2 * count + kEntriesPerPage - 1) / kEntriesPerPage);
  for (std::int64_t i = 1; i < slab_count; ++i) {
    const double cut = endpoints[static_cast<std::size_t>(i * 2 * count / slab_count)];
    if (cut > lower.back() && cut < kInfinity) {
      lower.push_back(cut);
    }
  }
  return lower;
}

// The part that an interval plays at a node.
struct Part {
  std::uint32_t interval_index = 0;
  std::uint8_t first_slab = 0;  // that it reaches into
  std::uint8_t last_slab = 0;
  bool covers_first = false;
  bool covers_last = false;

  [[nodiscard]] bool goes_down() const {
    return first_slab == last_slab && !(covers_first && covers_last);
  }
  [[nodiscard]] bool in_left_list() const { return !covers_first; }
  [[nodiscard]] bool in_right_list() const { return !covers_last; }
  // The slabs that it covers; none if first > last.
  [[nodiscard]] int first_covered() const { return first_slab + (covers_first ? 0 : 1); }
  [[nodiscard]] int last_covered() const { return last_slab - (covers_last ? 0 : 1); }
};

Part PartOf(const BlockInterval& interval, std::span<const double> lower) {
  // lower[0] is -infinity: never above lo, always below hi.
  const auto first = std::upper_bound(lower.begin() + 1, lower.end(), interval.span.min) - 1;
  const auto last = std::lower_bound(lower.begin() + 1, lower.end(), interval.span.max) - 1;
  const double upper = last + 1 == lower.end() ? std::numeric_limits<double>::infinity() : last[1];
  Part part;
  part.first_slab = static_cast<std::uint8_t>(first - lower.begin());
  part.last_slab = static_cast<std::uint8_t>(last - lower.begin());
  part.covers_first = interval.span.min == *first;
  part.covers_last = interval.span.max == upper;
  return part;
}

// Consecutive slabs [first, last] that share a list.
struct Window {
  int first = 0;
  int last = 0;
};

// Groups slabs greedily while a window has at most 2 * (its least crowded slab) + B intervals.
std::vector<Window> ChooseWindows(std::span<const Part> kept, int slab_count) {
  std::vector<std::int64_t> begins(static_cast<std::size_t>(slab_count) + 1, 0);
  std::vector<std::int64_t> ends(static_cast<std::size_t>(slab_count) + 1, 0);
  for (const Part& part : kept) {
    if (part.first_covered() <= part.last_covered()) {
      ++begins[static_cast<std::size_t>(part.first_covered())];
      ++ends[static_cast<std::size_t>(part.last_covered()) + 1];
    }
  }
  std::vector<Window> windows;
  std::int64_t covering = 0;  // the current slab
  std::int64_t distinct = 0;  // in the current window
  std::int64_t least = 0;
  for (int slab = 0; slab < slab_count; ++slab) {
    const auto at = static_cast<std::size_t>(slab);
    covering += begins[at] - ends[at];
    distinct += begins[at];
    least = std::min(least, covering);
    if (!windows.empty() && distinct <= 2 * least + kEntriesPerPage) {
      windows.back().last = slab;
    } else {
      windows.push_back({slab, slab});
      distinct = covering;
      least = covering;
    }
  }
  return windows;
}

class Builder {
 public:
  Builder(std::span<BlockInterval> intervals, base::PageFileWriter* pages) : pages_(pages) {
    scratch_.reserve(intervals.size());
  }

  // Writes the subtree of `intervals`, in canonical order on entry; reorders them.
  absl::StatusOr<base::PageNumber> BuildNode(std::span<BlockInterval> intervals);

 private:
  // A node while it is built.
  struct Node {
    std::vector<format::SlabRecord> slabs;
    std::vector<std::span<BlockInterval>> down;  // by slab
    format::NodeHeader header;
  };

  // Passes 1 and 2: fills `node->down` and returns the parts of the intervals that stay, whose
  // indices refer to `kept_intervals`.
  std::vector<Part> Distribute(std::span<BlockInterval> intervals, Node* node,
                               std::span<BlockInterval>* kept_intervals);
  // Pass 3.
  absl::Status WriteRun(std::span<const BlockInterval> intervals, std::span<Part> kept, Node* node);
  static absl::Status WriteLeftLists(std::span<const BlockInterval> intervals,
                                     std::span<const Part> kept, Node* node, RunWriter* run);
  static absl::Status WriteRightLists(std::span<const BlockInterval> intervals,
                                      std::span<const Part> kept, Node* node, RunWriter* run);
  static absl::Status WriteWindowLists(std::span<const BlockInterval> intervals,
                                       std::span<const Part> kept, Node* node, RunWriter* run);
  static absl::Status WriteLeafLists(Node* node, RunWriter* run);

  base::PageFileWriter* pages_;
  std::vector<BlockInterval> scratch_;
};

std::vector<Part> Builder::Distribute(std::span<BlockInterval> intervals, Node* node,
                                      std::span<BlockInterval>* kept_intervals) {
  const std::vector<double> lower = ChooseSlabs(intervals);
  const std::size_t slab_count = lower.size();
  node->slabs.resize(slab_count);
  node->down.resize(slab_count);
  for (std::size_t slab = 0; slab < slab_count; ++slab) {
    node->slabs[slab].lower = lower[slab];
  }

  // A stable counting sort by slab; those that stay come last.
  std::vector<std::size_t> begin(slab_count + 2, 0);
  std::vector<std::uint8_t> bucket_of(intervals.size());
  std::vector<Part> kept;
  const bool fits_leaf = static_cast<std::int64_t>(intervals.size()) <= kEntriesPerPage;
  for (std::size_t i = 0; i < intervals.size(); ++i) {
    Part part = PartOf(intervals[i], lower);
    std::size_t bucket = part.first_slab;
    if (!part.goes_down() && !fits_leaf) {
      bucket = slab_count;
      part.interval_index = static_cast<std::uint32_t>(kept.size());
      kept.push_back(part);
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

absl::Status Builder::WriteLeftLists(std::span<const BlockInterval> intervals,
                                     std::span<const Part> kept, Node* node, RunWriter* run) {
  // Canonical order is ascending by lo, and so by slab.
  std::size_t next = 0;
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].left_begin = run->entry_count();
    for (; next < kept.size() && kept[next].first_slab == slab; ++next) {
      if (kept[next].in_left_list()) {
        ISOSCOPE_RETURN_IF_ERROR(run->Append(intervals[kept[next].interval_index]));
      }
    }
  }
  node->header.left_end = run->entry_count();
  return absl::OkStatus();
}

absl::Status Builder::WriteRightLists(std::span<const BlockInterval> intervals,
                                      std::span<const Part> kept, Node* node, RunWriter* run) {
  std::vector<Part> right;
  std::copy_if(kept.begin(), kept.end(), std::back_inserter(right),
               [](const Part& part) { return part.in_right_list(); });
  std::sort(right.begin(), right.end(), [intervals](const Part& a, const Part& b) {
    const double a_max = intervals[a.interval_index].span.max;
    const double b_max = intervals[b.interval_index].span.max;
    // Ascending by slab, descending by hi, then canonical.
    return std::tie(a.last_slab, b_max, a.interval_index) <
           std::tie(b.last_slab, a_max, b.interval_index);
  });
  std::size_t next = 0;
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].right_begin = run->entry_count();
    for (; next < right.size() && right[next].last_slab == slab; ++next) {
      ISOSCOPE_RETURN_IF_ERROR(run->Append(intervals[right[next].interval_index]));
    }
  }
  node->header.right_end = run->entry_count();
  return absl::OkStatus();
}

absl::Status Builder::WriteWindowLists(std::span<const BlockInterval> intervals,
                                       std::span<const Part> kept, Node* node, RunWriter* run) {
  // Canonical order is also ascending by the first covered slab, so a sweep meets each interval
  // when the first window that it reaches does.
  std::vector<Part> open;
  std::size_t next = 0;
  for (const Window& window : ChooseWindows(kept, static_cast<int>(node->slabs.size()))) {
    open.erase(
        std::remove_if(open.begin(), open.end(),
                       [&window](const Part& part) { return part.last_covered() < window.first; }),
        open.end());
    for (; next < kept.size() && kept[next].first_covered() <= window.last; ++next) {
      if (kept[next].first_covered() <= kept[next].last_covered()) {
        open.push_back(kept[next]);
      }
    }
    for (int slab = window.first; slab <= window.last; ++slab) {
      format::SlabRecord& record = node->slabs[static_cast<std::size_t>(slab)];
      record.window_begin = run->entry_count();
      record.window_size = static_cast<std::uint32_t>(open.size());
    }
    for (const Part& part : open) {
      ISOSCOPE_RETURN_IF_ERROR(run->Append(intervals[part.interval_index]));
    }
  }
  node->header.window_end = run->entry_count();
  return absl::OkStatus();
}

absl::Status Builder::WriteLeafLists(Node* node, RunWriter* run) {
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].leaf_begin = run->entry_count();
    if (static_cast<std::int64_t>(node->down[slab].size()) <= kEntriesPerPage) {
      for (const BlockInterval& interval : node->down[slab]) {
        ISOSCOPE_RETURN_IF_ERROR(run->Append(interval));
      }
      node->down[slab] = {};
    }
  }
  node->header.leaf_end = run->entry_count();
  return absl::OkStatus();
}

absl::Status Builder::WriteRun(std::span<const BlockInterval> intervals, std::span<Part> kept,
                               Node* node) {
  RunWriter run(pages_);
  ISOSCOPE_RETURN_IF_ERROR(WriteLeftLists(intervals, kept, node, &run));
  ISOSCOPE_RETURN_IF_ERROR(WriteRightLists(intervals, kept, node, &run));
  ISOSCOPE_RETURN_IF_ERROR(WriteWindowLists(intervals, kept, node, &run));
  ISOSCOPE_RETURN_IF_ERROR(WriteLeafLists(node, &run));
  return run.Finish();
}

absl::StatusOr<base::PageNumber> Builder::BuildNode(std::span<BlockInterval> intervals) {
  ISOSCOPE_ASSIGN_OR_RETURN(const base::PageNumber page, pages_->Append(""));
  Node node;
  {
    std::span<BlockInterval> kept_intervals;
    std::vector<Part> kept = Distribute(intervals, &node, &kept_intervals);
    ISOSCOPE_RETURN_IF_ERROR(WriteRun(kept_intervals, kept, &node));
  }
  node.header.slab_count = static_cast<std::uint16_t>(node.slabs.size());

  std::string payload(format::SlabRecordOffset(static_cast<std::int64_t>(node.slabs.size())), '\0');
  format::EncodeNodeHeader(node.header, payload.data());
  for (std::size_t slab = 0; slab < node.slabs.size(); ++slab) {
    if (!node.down[slab].empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(node.slabs[slab].child_page, BuildNode(node.down[slab]));
    }
    format::EncodeSlabRecord(node.slabs[slab],
                             &payload[format::SlabRecordOffset(static_cast<std::int64_t>(slab))]);
  }
  ISOSCOPE_RETURN_IF_ERROR(pages_->Overwrite(page, payload));
  return page;
}

}  // namespace

absl::Status BuildIntervalTree(std::vector<BlockInterval> intervals, base::WritableFile* file) {
  if (static_cast<std::int64_t>(intervals.size()) > format::kMaxIntervalCount) {
    return absl::InvalidArgumentError(
        absl::StrCat("interval tree: ", intervals.size(), " intervals, expected at most ",
                     format::kMaxIntervalCount, "; cut the volume into more shards"));
  }
  Canonicalize(&intervals);
  base::PageFileWriter pages(file, Fingerprint(intervals));
  ISOSCOPE_RETURN_IF_ERROR(pages.Append("").status());
  format::Header header;
  header.interval_count = intervals.size();
  if (!intervals.empty()) {
    Builder builder(intervals, &pages);
    ISOSCOPE_ASSIGN_OR_RETURN(header.root_page, builder.BuildNode(intervals));
  }
  header.page_count = static_cast<std::uint32_t>(pages.page_count());
  // Last: a file that was not finished has no header.
  std::string payload(format::kHeaderBytes, '\0');
  format::EncodeHeader(header, payload.data());
  ISOSCOPE_RETURN_IF_ERROR(pages.Overwrite(0, payload));
  return file->Close();
}

}  // namespace isoscope::index
