// Builds a node at a time, from the root down:
//
//   1. choose the slabs' bounds from the sorted endpoints;
//   2. give every interval its part: passed down to a slab, or kept in left, right, window lists;
//   3. write the node's page (a placeholder) and its run: left, right, window and leaf lists;
//   4. build the child nodes, then write the node's page for good.
//
// Intervals are in canonical order from the start and every step keeps it, so that the bytes
// depend on the set only. A node whose intervals do not fit into memory goes through the same steps
// with scratch files in the place of arrays (ExternalBuilder); its children are built either way.
// Based on: Arge and Vitter 2003, section 2; Chiang and Silva 1997,
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

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/types/span.h"

#include "core/base/crc32c.h"
#include "core/base/external_sorter.h"
#include "core/base/page_file.h"
#include "core/base/scratch_file.h"
#include "core/base/scratch_records.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/index/interval_tree_format.h"

namespace isoscope::index {
namespace {

using format::kEntriesPerPage;
using format::kMaxSlabs;

struct CanonicalLess {
  bool operator()(const BlockInterval& a, const BlockInterval& b) const {
    return std::tie(a.span.min, a.span.max, a.block_id, a.ordinal) <
           std::tie(b.span.min, b.span.max, b.block_id, b.ordinal);
  }
};

// NaN fails every comparison: never active as well.
bool IsEverActive(const BlockInterval& interval) { return interval.span.min < interval.span.max; }

// Makes negative zeros positive.
void NormalizeZeros(BlockInterval* interval) {
  interval->span.min += 0.0;
  interval->span.max += 0.0;
}

// Drops intervals that are never active, makes negative zeros positive, and sorts.
void Canonicalize(std::vector<BlockInterval>* intervals) {
  intervals->erase(
      std::remove_if(intervals->begin(), intervals->end(),
                     [](const BlockInterval& interval) { return !IsEverActive(interval); }),
      intervals->end());
  std::for_each(intervals->begin(), intervals->end(),
                [](BlockInterval& interval) { NormalizeZeros(&interval); });
  std::sort(intervals->begin(), intervals->end(), CanonicalLess());
}

// The CRC-32C of all entries so far and `interval`.
std::uint32_t ExtendFingerprint(std::uint32_t crc, const BlockInterval& interval) {
  char bytes[format::kEntryBytes];
  format::EncodeEntry(interval, bytes);
  return base::ExtendCrc32c(crc, bytes, sizeof(bytes));
}

std::uint32_t Fingerprint(std::span<const BlockInterval> intervals) {
  std::uint32_t crc = 0;
  for (const BlockInterval& interval : intervals) {
    crc = ExtendFingerprint(crc, interval);
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

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Slabs that a node of `count` > B intervals is cut into, before equal cuts are dropped.
std::int64_t SlabCount(std::int64_t count) {
  return std::min(kMaxSlabs, (2 * count + kEntriesPerPage - 1) / kEntriesPerPage);
}

// Where the i-th cut is among the sorted endpoints of `count` intervals.
std::int64_t CutPosition(std::int64_t i, std::int64_t count) {
  return i * 2 * count / SlabCount(count);
}

void AddCut(double cut, std::vector<double>* lower) {
  if (cut > lower->back() && cut < kInfinity) {
    lower->push_back(cut);
  }
}

// Pass 1: the lower bounds of the slabs, ascending; -infinity for slab 0.
std::vector<double> ChooseSlabs(std::span<const BlockInterval> intervals) {
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
  for (std::int64_t i = 1; i < SlabCount(count); ++i) {
    AddCut(endpoints[static_cast<std::size_t>(CutPosition(i, count))], &lower);
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
  [[nodiscard]] bool in_windows() const { return first_covered() <= last_covered(); }
  // The slabs that it covers; none if first > last.
  [[nodiscard]] int first_covered() const { return first_slab + (covers_first ? 0 : 1); }
  [[nodiscard]] int last_covered() const { return last_slab - (covers_last ? 0 : 1); }
};

Part PartOf(const BlockInterval& interval, std::span<const double> lower) {
  // lower[0] is -infinity: never above lo, always below hi.
  const auto first = std::upper_bound(lower.begin() + 1, lower.end(), interval.span.min) - 1;
  const auto last = std::lower_bound(lower.begin() + 1, lower.end(), interval.span.max) - 1;
  const double upper = last + 1 == lower.end() ? kInfinity : last[1];
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
  std::int64_t size = 0;  // intervals that cover one of them
};

// How many kept intervals begin and end to cover slabs, by slab.
class Coverage {
 public:
  explicit Coverage(std::size_t slab_count) : begins_(slab_count + 1), ends_(slab_count + 1) {}

  void Add(const Part& part) {
    if (part.in_windows()) {
      ++begins_[static_cast<std::size_t>(part.first_covered())];
      ++ends_[static_cast<std::size_t>(part.last_covered()) + 1];
    }
  }

  // Groups slabs greedily while a window has at most 2 * (its least crowded slab) + B intervals.
  [[nodiscard]] std::vector<Window> ChooseWindows() const {
    std::vector<Window> windows;
    std::int64_t covering = 0;  // the current slab
    std::int64_t least = 0;     // in the current window
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

 private:
  std::vector<std::int64_t> begins_;
  std::vector<std::int64_t> ends_;
};

// A node while it is built.
struct NodeRecords {
  std::vector<format::SlabRecord> slabs;
  format::NodeHeader header;

  explicit NodeRecords(std::span<const double> lower) : slabs(lower.size()) {
    for (std::size_t slab = 0; slab < lower.size(); ++slab) {
      slabs[slab].lower = lower[slab];
    }
    header.slab_count = static_cast<std::uint16_t>(lower.size());
  }

  [[nodiscard]] std::string Encode() const {
    std::string payload(format::SlabRecordOffset(static_cast<std::int64_t>(slabs.size())), '\0');
    format::EncodeNodeHeader(header, payload.data());
    for (std::size_t slab = 0; slab < slabs.size(); ++slab) {
      format::EncodeSlabRecord(slabs[slab],
                               &payload[format::SlabRecordOffset(static_cast<std::int64_t>(slab))]);
    }
    return payload;
  }
};

class Builder {
 public:
  Builder(std::span<BlockInterval> intervals, base::PageFileWriter* pages) : pages_(pages) {
    scratch_.reserve(intervals.size());
  }

  // Writes the subtree of `intervals`, in canonical order on entry; reorders them.
  absl::StatusOr<base::PageNumber> BuildNode(std::span<BlockInterval> intervals);

 private:
  struct Node : NodeRecords {
    using NodeRecords::NodeRecords;
    std::vector<std::span<BlockInterval>> down;  // by slab
  };

  // Pass 2: fills `node->down` and returns the parts of the intervals that stay, whose indices
  // refer to `kept_intervals`.
  std::vector<Part> Distribute(std::span<BlockInterval> intervals, std::span<const double> lower,
                               Node* node, std::span<BlockInterval>* kept_intervals);
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

std::vector<Part> Builder::Distribute(std::span<BlockInterval> intervals,
                                      std::span<const double> lower, Node* node,
                                      std::span<BlockInterval>* kept_intervals) {
  const std::size_t slab_count = lower.size();
  node->down.resize(slab_count);

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
  Coverage coverage(node->slabs.size());
  std::for_each(kept.begin(), kept.end(), [&](const Part& part) { coverage.Add(part); });
  std::vector<Part> open;
  std::size_t next = 0;
  for (const Window& window : coverage.ChooseWindows()) {
    open.erase(
        std::remove_if(open.begin(), open.end(),
                       [&window](const Part& part) { return part.last_covered() < window.first; }),
        open.end());
    for (; next < kept.size() && kept[next].first_covered() <= window.last; ++next) {
      if (kept[next].in_windows()) {
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
  const std::vector<double> lower = ChooseSlabs(intervals);
  Node node(lower);
  {
    std::span<BlockInterval> kept_intervals;
    std::vector<Part> kept = Distribute(intervals, lower, &node, &kept_intervals);
    ISOSCOPE_RETURN_IF_ERROR(WriteRun(kept_intervals, kept, &node));
  }
  for (std::size_t slab = 0; slab < node.slabs.size(); ++slab) {
    if (!node.down[slab].empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(node.slabs[slab].child_page, BuildNode(node.down[slab]));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(pages_->Overwrite(page, node.Encode()));
  return page;
}

// Intervals in the place of the in-memory builder's largest arrays, for each: the sorted input,
// a copy, two endpoints, two parts, and their lists.
constexpr std::int64_t kBytesPerInterval = 128;

// How the memory of an external build is divided. The phases follow each other; in each there are
// at most one sorter, one set of buckets and two sequences.
struct MemoryPlan {
  explicit MemoryPlan(std::int64_t memory_bytes)
      : sorter_bytes(memory_bytes / 2),
        bucket_bytes(memory_bytes / 4 / (kMaxSlabs + 1)),
        sequence_bytes(std::min(memory_bytes / 8, base::kMiB)),
        in_memory_count(std::max(memory_bytes / kBytesPerInterval, kEntriesPerPage)) {}

  std::int64_t sorter_bytes;
  std::int64_t bucket_bytes;
  std::int64_t sequence_bytes;
  std::int64_t in_memory_count;  // intervals that the in-memory builder takes
};

// Deals intervals to buckets of known sizes, which lie one after the other in a scratch file. Each
// keeps the order in which its intervals come. Thread-compatible.
class Buckets {
 public:
  static absl::StatusOr<Buckets> Create(const std::string& directory,
                                        const std::vector<std::int64_t>& sizes,
                                        std::int64_t buffer_bytes) {
    Buckets buckets;
    ISOSCOPE_ASSIGN_OR_RETURN(buckets.file_, base::ScratchFile::Create(directory));
    base::ScratchRange range;
    for (const std::int64_t size : sizes) {
      range.count = size;
      buckets.ranges_.push_back(range);
      buckets.writers_.emplace_back(buckets.file_.get(), range.offset, buffer_bytes);
      range.offset += size * static_cast<std::int64_t>(sizeof(BlockInterval));
    }
    return buckets;
  }

  absl::Status Append(std::size_t bucket, const BlockInterval& interval) {
    return writers_[bucket].Append(interval);
  }
  // Ends dealing, and frees the buffers.
  absl::Status Finish() {
    for (auto& writer : writers_) {
      ISOSCOPE_RETURN_IF_ERROR(writer.Flush());
    }
    writers_.clear();
    return absl::OkStatus();
  }

  [[nodiscard]] const base::ScratchFile& file() const { return *file_; }
  [[nodiscard]] const base::ScratchRange& range(std::size_t bucket) const {
    return ranges_[bucket];
  }

 private:
  std::unique_ptr<base::ScratchFile> file_;
  std::vector<base::ScratchRange> ranges_;
  std::vector<base::RecordWriter<BlockInterval>> writers_;
};

// An interval of the right lists, and the slab whose list it is in.
struct RightEntry {
  BlockInterval interval;
  std::uint64_t slab = 0;
};
struct RightLess {
  bool operator()(const RightEntry& a, const RightEntry& b) const {
    // Ascending by slab, descending by hi, then canonical.
    return std::tie(a.slab, b.interval.span.max, a.interval.span.min, a.interval.block_id,
                    a.interval.ordinal) < std::tie(b.slab, a.interval.span.max, b.interval.span.min,
                                                   b.interval.block_id, b.interval.ordinal);
  }
};

// Builds a subtree of intervals that lie, in canonical order, in a scratch file.
class ExternalBuilder {
 public:
  ExternalBuilder(const IntervalTreeBuilder::Options& options, base::PageFileWriter* pages)
      : options_(options), plan_(options.memory_bytes), pages_(pages) {}

  absl::StatusOr<base::PageNumber> BuildNode(const base::ScratchFile& file,
                                             const base::ScratchRange& range);

 private:
  // What pass 2 learns of a node's intervals before it deals them out.
  struct Census {
    explicit Census(std::size_t slab_count) : down_counts(slab_count), coverage(slab_count) {}

    std::vector<std::int64_t> down_counts;  // by slab
    std::int64_t kept_count = 0;
    Coverage coverage;
  };

  // Calls visit(interval) for each of the range, in order, until it returns an error.
  template <typename Visit>  // absl::Status(const BlockInterval&)
  absl::Status ForEach(const base::ScratchFile& file, const base::ScratchRange& range,
                       const Visit& visit) const {
    base::RecordReader<BlockInterval> reader(&file, range, plan_.sequence_bytes);
    while (true) {
      if (options_.cancellation != nullptr) {
        ISOSCOPE_RETURN_IF_ERROR(options_.cancellation->Check());
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const absl::Span<const BlockInterval> intervals, reader.Next());
      if (intervals.empty()) {
        return absl::OkStatus();
      }
      for (const BlockInterval& interval : intervals) {
        ISOSCOPE_RETURN_IF_ERROR(visit(interval));
      }
    }
  }

  absl::StatusOr<base::PageNumber> BuildInMemory(const base::ScratchFile& file,
                                                 const base::ScratchRange& range) const;
  // Pass 1.
  absl::StatusOr<std::vector<double>> ChooseSlabs(const base::ScratchFile& file,
                                                  const base::ScratchRange& range) const;
  // Pass 2: a bucket for each slab, and a last one of the intervals that stay.
  absl::StatusOr<Buckets> Distribute(const base::ScratchFile& file, const base::ScratchRange& range,
                                     std::span<const double> lower, const Census& census) const;
  // Pass 3.
  absl::Status WriteRun(const Buckets& buckets, std::span<const double> lower, const Census& census,
                        NodeRecords* node) const;
  absl::Status WriteLeftLists(const base::ScratchFile& file, const base::ScratchRange& kept,
                              std::span<const double> lower, NodeRecords* node,
                              RunWriter* run) const;
  absl::Status WriteRightLists(const base::ScratchFile& file, const base::ScratchRange& kept,
                               std::span<const double> lower, NodeRecords* node,
                               RunWriter* run) const;
  absl::Status WriteWindowLists(const base::ScratchFile& file, const base::ScratchRange& kept,
                                std::span<const double> lower, const Coverage& coverage,
                                NodeRecords* node, RunWriter* run) const;
  absl::Status WriteLeafLists(const Buckets& buckets, NodeRecords* node, RunWriter* run) const;

  const IntervalTreeBuilder::Options& options_;
  const MemoryPlan plan_;
  base::PageFileWriter* pages_;
};

absl::StatusOr<base::PageNumber> ExternalBuilder::BuildInMemory(
    const base::ScratchFile& file, const base::ScratchRange& range) const {
  std::vector<BlockInterval> intervals;
  intervals.reserve(static_cast<std::size_t>(range.count));
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, range, [&](const BlockInterval& interval) {
    intervals.push_back(interval);
    return absl::OkStatus();
  }));
  Builder builder(intervals, pages_);
  return builder.BuildNode(intervals);
}

absl::StatusOr<std::vector<double>> ExternalBuilder::ChooseSlabs(
    const base::ScratchFile& file, const base::ScratchRange& range) const {
  // The lower ends are in order already.
  base::ExternalSorter<double> upper(options_.scratch_directory, plan_.sorter_bytes);
  ISOSCOPE_RETURN_IF_ERROR(ForEach(
      file, range, [&](const BlockInterval& interval) { return upper.Add(interval.span.max); }));
  ISOSCOPE_RETURN_IF_ERROR(upper.Finish());
  std::vector<double> lower = {-kInfinity};
  std::int64_t cut_index = 1;
  std::int64_t position = 0;  // in the merge of both
  const auto take = [&](double endpoint) {
    if (cut_index < SlabCount(range.count) && position == CutPosition(cut_index, range.count)) {
      AddCut(endpoint, &lower);
      ++cut_index;
    }
    ++position;
  };
  const auto take_lower = [&](const BlockInterval& interval) {
    while (!upper.is_at_end() && upper.current() < interval.span.min) {
      take(upper.current());
      ISOSCOPE_RETURN_IF_ERROR(upper.Advance());
    }
    take(interval.span.min);
    return absl::Status();
  };
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, range, take_lower));
  for (; !upper.is_at_end() && cut_index < SlabCount(range.count);) {
    take(upper.current());
    ISOSCOPE_RETURN_IF_ERROR(upper.Advance());
  }
  return lower;
}

absl::StatusOr<Buckets> ExternalBuilder::Distribute(const base::ScratchFile& file,
                                                    const base::ScratchRange& range,
                                                    std::span<const double> lower,
                                                    const Census& census) const {
  std::vector<std::int64_t> sizes = census.down_counts;
  sizes.push_back(census.kept_count);
  ISOSCOPE_ASSIGN_OR_RETURN(Buckets buckets,
                            Buckets::Create(options_.scratch_directory, sizes, plan_.bucket_bytes));
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, range, [&](const BlockInterval& interval) {
    const Part part = PartOf(interval, lower);
    return buckets.Append(part.goes_down() ? part.first_slab : lower.size(), interval);
  }));
  ISOSCOPE_RETURN_IF_ERROR(buckets.Finish());
  return buckets;
}

absl::Status ExternalBuilder::WriteLeftLists(const base::ScratchFile& file,
                                             const base::ScratchRange& kept,
                                             std::span<const double> lower, NodeRecords* node,
                                             RunWriter* run) const {
  // Canonical order is ascending by lo, and so by slab.
  std::size_t begun = 0;  // slabs whose list has begun
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, kept, [&](const BlockInterval& interval) {
    const Part part = PartOf(interval, lower);
    for (; begun <= part.first_slab; ++begun) {
      node->slabs[begun].left_begin = run->entry_count();
    }
    return part.in_left_list() ? run->Append(interval) : absl::OkStatus();
  }));
  for (; begun < node->slabs.size(); ++begun) {
    node->slabs[begun].left_begin = run->entry_count();
  }
  node->header.left_end = run->entry_count();
  return absl::OkStatus();
}

absl::Status ExternalBuilder::WriteRightLists(const base::ScratchFile& file,
                                              const base::ScratchRange& kept,
                                              std::span<const double> lower, NodeRecords* node,
                                              RunWriter* run) const {
  base::ExternalSorter<RightEntry, RightLess> sorter(options_.scratch_directory,
                                                     plan_.sorter_bytes);
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, kept, [&](const BlockInterval& interval) {
    const Part part = PartOf(interval, lower);
    return part.in_right_list() ? sorter.Add({interval, part.last_slab}) : absl::OkStatus();
  }));
  ISOSCOPE_RETURN_IF_ERROR(sorter.Finish());
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].right_begin = run->entry_count();
    while (!sorter.is_at_end() && sorter.current().slab == slab) {
      ISOSCOPE_RETURN_IF_ERROR(run->Append(sorter.current().interval));
      ISOSCOPE_RETURN_IF_ERROR(sorter.Advance());
    }
  }
  node->header.right_end = run->entry_count();
  return absl::OkStatus();
}

absl::Status ExternalBuilder::WriteWindowLists(const base::ScratchFile& file,
                                               const base::ScratchRange& kept,
                                               std::span<const double> lower,
                                               const Coverage& coverage, NodeRecords* node,
                                               RunWriter* run) const {
  const std::vector<Window> windows = coverage.ChooseWindows();
  std::vector<std::size_t> window_of_slab(node->slabs.size());
  std::vector<std::int64_t> sizes;
  for (std::size_t window = 0; window < windows.size(); ++window) {
    sizes.push_back(windows[window].size);
    std::fill(window_of_slab.begin() + windows[window].first,
              window_of_slab.begin() + windows[window].last + 1, window);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(Buckets lists,
                            Buckets::Create(options_.scratch_directory, sizes, plan_.bucket_bytes));
  const auto append = [&](const BlockInterval& interval) {
    const Part part = PartOf(interval, lower);
    if (part.in_windows()) {
      const std::size_t last = window_of_slab[static_cast<std::size_t>(part.last_covered())];
      for (std::size_t window = window_of_slab[static_cast<std::size_t>(part.first_covered())];
           window <= last; ++window) {
        ISOSCOPE_RETURN_IF_ERROR(lists.Append(window, interval));
      }
    }
    return absl::Status();
  };
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, kept, append));
  ISOSCOPE_RETURN_IF_ERROR(lists.Finish());
  for (std::size_t window = 0; window < windows.size(); ++window) {
    for (int slab = windows[window].first; slab <= windows[window].last; ++slab) {
      format::SlabRecord& record = node->slabs[static_cast<std::size_t>(slab)];
      record.window_begin = run->entry_count();
      record.window_size = static_cast<std::uint32_t>(windows[window].size);
    }
    ISOSCOPE_RETURN_IF_ERROR(
        ForEach(lists.file(), lists.range(window),
                [&](const BlockInterval& interval) { return run->Append(interval); }));
  }
  node->header.window_end = run->entry_count();
  return absl::OkStatus();
}

absl::Status ExternalBuilder::WriteLeafLists(const Buckets& buckets, NodeRecords* node,
                                             RunWriter* run) const {
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].leaf_begin = run->entry_count();
    if (buckets.range(slab).count <= kEntriesPerPage) {
      ISOSCOPE_RETURN_IF_ERROR(
          ForEach(buckets.file(), buckets.range(slab),
                  [&](const BlockInterval& interval) { return run->Append(interval); }));
    }
  }
  node->header.leaf_end = run->entry_count();
  return absl::OkStatus();
}

absl::Status ExternalBuilder::WriteRun(const Buckets& buckets, std::span<const double> lower,
                                       const Census& census, NodeRecords* node) const {
  const base::ScratchRange& kept = buckets.range(lower.size());
  RunWriter run(pages_);
  ISOSCOPE_RETURN_IF_ERROR(WriteLeftLists(buckets.file(), kept, lower, node, &run));
  ISOSCOPE_RETURN_IF_ERROR(WriteRightLists(buckets.file(), kept, lower, node, &run));
  ISOSCOPE_RETURN_IF_ERROR(
      WriteWindowLists(buckets.file(), kept, lower, census.coverage, node, &run));
  ISOSCOPE_RETURN_IF_ERROR(WriteLeafLists(buckets, node, &run));
  return run.Finish();
}

absl::StatusOr<base::PageNumber> ExternalBuilder::BuildNode(const base::ScratchFile& file,
                                                            const base::ScratchRange& range) {
  if (range.count <= plan_.in_memory_count) {
    return BuildInMemory(file, range);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const base::PageNumber page, pages_->Append(""));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> lower, ChooseSlabs(file, range));
  Census census(lower.size());
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, range, [&](const BlockInterval& interval) {
    const Part part = PartOf(interval, lower);
    if (part.goes_down()) {
      ++census.down_counts[part.first_slab];
    } else {
      ++census.kept_count;
      census.coverage.Add(part);
    }
    return absl::OkStatus();
  }));
  ISOSCOPE_ASSIGN_OR_RETURN(const Buckets buckets, Distribute(file, range, lower, census));
  NodeRecords node(lower);
  ISOSCOPE_RETURN_IF_ERROR(WriteRun(buckets, lower, census, &node));
  for (std::size_t slab = 0; slab < lower.size(); ++slab) {
    if (buckets.range(slab).count > kEntriesPerPage) {
      ISOSCOPE_ASSIGN_OR_RETURN(node.slabs[slab].child_page,
                                BuildNode(buckets.file(), buckets.range(slab)));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(pages_->Overwrite(page, node.Encode()));
  return page;
}

// Writes a whole tree file: `build_root(pages)` writes the nodes and returns the root's page.
template <typename BuildRoot>
absl::Status WriteTree(std::int64_t interval_count, std::uint32_t fingerprint,
                       base::WritableFile* file, const BuildRoot& build_root) {
  base::PageFileWriter pages(file, fingerprint);
  ISOSCOPE_RETURN_IF_ERROR(pages.Append("").status());
  format::Header header;
  header.interval_count = static_cast<std::uint64_t>(interval_count);
  if (interval_count > 0) {
    ISOSCOPE_ASSIGN_OR_RETURN(header.root_page, build_root(&pages));
  }
  header.page_count = static_cast<std::uint32_t>(pages.page_count());
  // Last: a file that was not finished has no header.
  std::string payload(format::kHeaderBytes, '\0');
  format::EncodeHeader(header, payload.data());
  ISOSCOPE_RETURN_IF_ERROR(pages.Overwrite(0, payload));
  return file->Close();
}

absl::Status CheckIntervalCount(std::int64_t count) {
  if (count > format::kMaxIntervalCount) {
    return absl::InvalidArgumentError(
        absl::StrCat("interval tree: ", count, " intervals, expected at most ",
                     format::kMaxIntervalCount, "; cut the volume into more shards"));
  }
  return absl::OkStatus();
}

// REQUIRES: in canonical order.
absl::Status WriteTreeInMemory(std::vector<BlockInterval>* intervals, base::WritableFile* file) {
  return WriteTree(static_cast<std::int64_t>(intervals->size()), Fingerprint(*intervals), file,
                   [&](base::PageFileWriter* pages) {
                     Builder builder(*intervals, pages);
                     return builder.BuildNode(*intervals);
                   });
}

}  // namespace

absl::Status BuildIntervalTree(std::vector<BlockInterval> intervals, base::WritableFile* file) {
  ISOSCOPE_RETURN_IF_ERROR(CheckIntervalCount(static_cast<std::int64_t>(intervals.size())));
  Canonicalize(&intervals);
  return WriteTreeInMemory(&intervals, file);
}

class IntervalTreeBuilder::Impl {
 public:
  using Sorter = base::ExternalSorter<BlockInterval, CanonicalLess>;

  explicit Impl(const Options& options)
      : options_(options),
        plan_(options.memory_bytes),
        sorter_(std::make_unique<Sorter>(
            options.scratch_directory,
            std::max(plan_.sorter_bytes,
                     plan_.in_memory_count * static_cast<std::int64_t>(sizeof(BlockInterval))))) {}

  absl::Status Add(BlockInterval interval) {
    if (!IsEverActive(interval)) {
      return absl::OkStatus();
    }
    NormalizeZeros(&interval);
    return sorter_->Add(interval);
  }

  absl::Status Finish(base::WritableFile* file) {
    const std::int64_t count = sorter_->count();
    ISOSCOPE_RETURN_IF_ERROR(CheckIntervalCount(count));
    ISOSCOPE_RETURN_IF_ERROR(sorter_->Finish());
    if (count <= plan_.in_memory_count) {
      std::vector<BlockInterval> intervals;
      intervals.reserve(static_cast<std::size_t>(count));
      ISOSCOPE_RETURN_IF_ERROR(ForEachSorted([&](const BlockInterval& interval) {
        intervals.push_back(interval);
        return absl::OkStatus();
      }));
      return WriteTreeInMemory(&intervals, file);
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<base::ScratchFile> sorted,
                              base::ScratchFile::Create(options_.scratch_directory));
    base::RecordWriter<BlockInterval> writer(sorted.get(), 0, plan_.sequence_bytes);
    std::uint32_t fingerprint = 0;
    ISOSCOPE_RETURN_IF_ERROR(ForEachSorted([&](const BlockInterval& interval) {
      fingerprint = ExtendFingerprint(fingerprint, interval);
      return writer.Append(interval);
    }));
    ISOSCOPE_RETURN_IF_ERROR(writer.Flush());
    return WriteTree(count, fingerprint, file, [&](base::PageFileWriter* pages) {
      return ExternalBuilder(options_, pages).BuildNode(*sorted, {.offset = 0, .count = count});
    });
  }

 private:
  // Empties the sorter, and frees it.
  template <typename Visit>
  absl::Status ForEachSorted(const Visit& visit) {
    constexpr std::int64_t kIntervalsBetweenChecks = 1 << 16;
    for (std::int64_t i = 0; !sorter_->is_at_end(); ++i) {
      if (options_.cancellation != nullptr && i % kIntervalsBetweenChecks == 0) {
        ISOSCOPE_RETURN_IF_ERROR(options_.cancellation->Check());
      }
      ISOSCOPE_RETURN_IF_ERROR(visit(sorter_->current()));
      ISOSCOPE_RETURN_IF_ERROR(sorter_->Advance());
    }
    sorter_.reset();
    return absl::OkStatus();
  }

  const Options options_;
  const MemoryPlan plan_;
  std::unique_ptr<Sorter> sorter_;
};

std::int64_t IntervalTreeBuilder::MemoryBytes(std::int64_t interval_count) {
  return std::min(Options().memory_bytes, kBytesPerInterval * interval_count);
}

IntervalTreeBuilder::IntervalTreeBuilder(const Options& options)
    : impl_(std::make_unique<Impl>(options)) {}
IntervalTreeBuilder::~IntervalTreeBuilder() = default;

absl::Status IntervalTreeBuilder::Add(const BlockInterval& interval) {
  return impl_->Add(interval);
}

absl::Status IntervalTreeBuilder::Finish(base::WritableFile* file) { return impl_->Finish(file); }

}  // namespace isoscope::index
