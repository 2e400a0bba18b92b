// The in-memory builder's steps, as sequential passes over scratch files. For a node of n
// intervals, more than fit into memory:
//
//   1. ChooseSlabs: merge the lower ends, which the canonical order has sorted, with the upper
//      ends, sorted on disk, and take the endpoint at every cut position.
//   2. TakeCensus: one pass counts how many intervals go down to each slab, how many are kept, and
//      where the kept ones begin and end to cover slabs.
//   3. Distribute: a second pass deals the intervals to buckets, one for each slab and one for the
//      kept ones. The census gives the sizes, so all buckets share one file:
//
//        | slab 0 | slab 1 | ... | slab k-1 | kept |
//
//   4. WriteEntryRun, from the bucket of the kept intervals: left lists in the order of the bucket;
//      right lists from a sort on disk by (slab, descending hi); window lists dealt to one bucket
//      for each window. Then the leaf lists, from the slabs' buckets that have at most B = 170
//      intervals.
//   5. BuildNode for each slab that has more, or the in-memory builder as soon as its bucket fits.
//   6. Write the node's page, which was reserved before its entry run.
//
// Invariants: every bucket keeps the canonical order (lo, hi, block id, ordinal), so the bytes
// equal those of the in-memory builder. At any time there are at most one sorter, one set of
// buckets and two sequences: MemoryPlan gives them M / 2, M / 4 and 2 * min(M / 8, 1 MiB).
//
// Example: M = 24 MiB gives the sorter 12 MiB, each of 127 buckets a buffer of 48.4 KiB and each
// sequence 1 MiB; nodes of up to 196 608 intervals are built in memory. A tree of 1 million
// intervals passes at most ceil(n / 63) - 1 = 15 873 to each slab: one node is built from files.
//
// Sources: those of interval_tree_builder.cc.

#include "core/index/external_node_builder.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "absl/status/status.h"
#include "absl/types/span.h"

#include "core/base/cancellation.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/index/in_memory_node_builder.h"
#include "core/index/interval_tree.h"
#include "core/index/interval_tree_format.h"
#include "core/index/node_slabs.h"
#include "core/index/node_writer.h"
#include "core/io/external_sorter.h"

namespace isoscope::index {
namespace {

using format::kEntriesPerPage;
using format::kMaxSlabs;

// Deals intervals to buckets of known sizes, one after the other in a scratch file. Each bucket
// keeps the order in which its intervals come. Thread-compatible.
class Buckets {
 public:
  static absl::StatusOr<Buckets> Create(const std::string& directory,
                                        const std::vector<std::int64_t>& sizes,
                                        std::int64_t buffer_bytes) {
    Buckets buckets;
    ISOSCOPE_ASSIGN_OR_RETURN(buckets.file_, io::ScratchFile::Create(directory));
    io::ScratchRange range;
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

  [[nodiscard]] const io::ScratchFile& file() const { return *file_; }
  [[nodiscard]] const io::ScratchRange& range(std::size_t bucket) const { return ranges_[bucket]; }

 private:
  std::unique_ptr<io::ScratchFile> file_;
  std::vector<io::ScratchRange> ranges_;
  std::vector<io::RecordWriter<BlockInterval>> writers_;
};

// An interval in the right lists.
struct RightEntry {
  BlockInterval interval;
  std::uint64_t slab = 0;  // the slab that has this right list
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
class ExternalNodeBuilder {
 public:
  ExternalNodeBuilder(const IntervalTreeBuilder::Options& options, io::PageFileWriter* pages)
      : options_(options), plan_(options.memory_bytes), pages_(pages) {}

  absl::StatusOr<io::PageNumber> BuildNode(const io::ScratchFile& file,
                                           const io::ScratchRange& range);

 private:
  // Counts of a node's intervals, taken before they are dealt out.
  struct Census {
    explicit Census(std::size_t slab_count) : down_counts(slab_count), coverage(slab_count) {}

    std::vector<std::int64_t> down_counts;  // intervals that go down, by slab
    std::int64_t kept_count = 0;
    Coverage coverage;  // of the kept intervals
  };

  // Calls visit(interval) for each interval of the range, in order, until it returns an error.
  template <typename Visit>  // absl::Status(const BlockInterval&)
  absl::Status ForEach(const io::ScratchFile& file, const io::ScratchRange& range,
                       const Visit& visit) const {
    io::RecordReader<BlockInterval> reader(&file, range, plan_.sequence_bytes);
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

  absl::StatusOr<io::PageNumber> BuildInMemory(const io::ScratchFile& file,
                                               const io::ScratchRange& range) const;
  // Step 1: returns the lower bounds of the slabs.
  absl::StatusOr<std::vector<double>> ChooseSlabs(const io::ScratchFile& file,
                                                  const io::ScratchRange& range) const;
  // Step 2.
  absl::StatusOr<Census> TakeCensus(const io::ScratchFile& file, const io::ScratchRange& range,
                                    std::span<const double> lower) const;
  // Step 3: returns a bucket for each slab, and a last one with the kept intervals.
  absl::StatusOr<Buckets> Distribute(const io::ScratchFile& file, const io::ScratchRange& range,
                                     std::span<const double> lower, const Census& census) const;
  // Step 4.
  absl::Status WriteEntryRun(const Buckets& buckets, std::span<const double> lower,
                             const Census& census, NodeRecords* node) const;
  absl::Status WriteLeftLists(const io::ScratchFile& file, const io::ScratchRange& kept,
                              std::span<const double> lower, NodeRecords* node,
                              EntryRunWriter* entry_run) const;
  absl::Status WriteRightLists(const io::ScratchFile& file, const io::ScratchRange& kept,
                               std::span<const double> lower, NodeRecords* node,
                               EntryRunWriter* entry_run) const;
  absl::Status WriteWindowLists(const io::ScratchFile& file, const io::ScratchRange& kept,
                                std::span<const double> lower, const Coverage& coverage,
                                NodeRecords* node, EntryRunWriter* entry_run) const;
  absl::Status WriteLeafLists(const Buckets& buckets, NodeRecords* node,
                              EntryRunWriter* entry_run) const;

  const IntervalTreeBuilder::Options& options_;
  const MemoryPlan plan_;
  io::PageFileWriter* pages_;
};

absl::StatusOr<io::PageNumber> ExternalNodeBuilder::BuildInMemory(
    const io::ScratchFile& file, const io::ScratchRange& range) const {
  std::vector<BlockInterval> intervals;
  intervals.reserve(static_cast<std::size_t>(range.count));
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, range, [&](const BlockInterval& interval) {
    intervals.push_back(interval);
    return absl::OkStatus();
  }));
  return BuildNodeInMemory(intervals, pages_);
}

absl::StatusOr<std::vector<double>> ExternalNodeBuilder::ChooseSlabs(
    const io::ScratchFile& file, const io::ScratchRange& range) const {
  io::ExternalSorter<double> upper(options_.scratch_directory, plan_.sorter_bytes);
  ISOSCOPE_RETURN_IF_ERROR(ForEach(
      file, range, [&](const BlockInterval& interval) { return upper.Add(interval.span.max); }));
  ISOSCOPE_RETURN_IF_ERROR(upper.Finish());
  std::vector<double> lower = {kFirstLowerBound};
  std::int64_t cut_index = 1;
  std::int64_t position = 0;  // among the merged endpoints
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

absl::StatusOr<ExternalNodeBuilder::Census> ExternalNodeBuilder::TakeCensus(
    const io::ScratchFile& file, const io::ScratchRange& range,
    std::span<const double> lower) const {
  Census census(lower.size());
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, range, [&](const BlockInterval& interval) {
    const SlabExtent extent = ExtentOf(interval, lower);
    if (extent.goes_down()) {
      ++census.down_counts[extent.first_slab];
    } else {
      ++census.kept_count;
      census.coverage.Add(extent);
    }
    return absl::OkStatus();
  }));
  return census;
}

absl::StatusOr<Buckets> ExternalNodeBuilder::Distribute(const io::ScratchFile& file,
                                                        const io::ScratchRange& range,
                                                        std::span<const double> lower,
                                                        const Census& census) const {
  std::vector<std::int64_t> sizes = census.down_counts;
  sizes.push_back(census.kept_count);
  ISOSCOPE_ASSIGN_OR_RETURN(Buckets buckets,
                            Buckets::Create(options_.scratch_directory, sizes, plan_.bucket_bytes));
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, range, [&](const BlockInterval& interval) {
    const SlabExtent extent = ExtentOf(interval, lower);
    return buckets.Append(extent.goes_down() ? extent.first_slab : lower.size(), interval);
  }));
  ISOSCOPE_RETURN_IF_ERROR(buckets.Finish());
  return buckets;
}

absl::Status ExternalNodeBuilder::WriteLeftLists(const io::ScratchFile& file,
                                                 const io::ScratchRange& kept,
                                                 std::span<const double> lower, NodeRecords* node,
                                                 EntryRunWriter* entry_run) const {
  // Canonical order is ascending by lo, and so by slab.
  std::size_t begun = 0;  // number of slabs whose list has begun
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, kept, [&](const BlockInterval& interval) {
    const SlabExtent extent = ExtentOf(interval, lower);
    for (; begun <= extent.first_slab; ++begun) {
      node->slabs[begun].left_begin = entry_run->entry_count();
    }
    return extent.in_left_list() ? entry_run->Append(interval) : absl::OkStatus();
  }));
  for (; begun < node->slabs.size(); ++begun) {
    node->slabs[begun].left_begin = entry_run->entry_count();
  }
  node->header.left_end = entry_run->entry_count();
  return absl::OkStatus();
}

absl::Status ExternalNodeBuilder::WriteRightLists(const io::ScratchFile& file,
                                                  const io::ScratchRange& kept,
                                                  std::span<const double> lower, NodeRecords* node,
                                                  EntryRunWriter* entry_run) const {
  io::ExternalSorter<RightEntry, RightLess> sorter(options_.scratch_directory, plan_.sorter_bytes);
  ISOSCOPE_RETURN_IF_ERROR(ForEach(file, kept, [&](const BlockInterval& interval) {
    const SlabExtent extent = ExtentOf(interval, lower);
    return extent.in_right_list() ? sorter.Add({interval, extent.last_slab}) : absl::OkStatus();
  }));
  ISOSCOPE_RETURN_IF_ERROR(sorter.Finish());
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].right_begin = entry_run->entry_count();
    while (!sorter.is_at_end() && sorter.current().slab == slab) {
      ISOSCOPE_RETURN_IF_ERROR(entry_run->Append(sorter.current().interval));
      ISOSCOPE_RETURN_IF_ERROR(sorter.Advance());
    }
  }
  node->header.right_end = entry_run->entry_count();
  return absl::OkStatus();
}

absl::Status ExternalNodeBuilder::WriteWindowLists(const io::ScratchFile& file,
                                                   const io::ScratchRange& kept,
                                                   std::span<const double> lower,
                                                   const Coverage& coverage, NodeRecords* node,
                                                   EntryRunWriter* entry_run) const {
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
    const SlabExtent extent = ExtentOf(interval, lower);
    if (extent.in_windows()) {
      const std::size_t last = window_of_slab[static_cast<std::size_t>(extent.last_covered())];
      for (std::size_t window = window_of_slab[static_cast<std::size_t>(extent.first_covered())];
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
      record.window_begin = entry_run->entry_count();
      record.window_size = static_cast<std::uint32_t>(windows[window].size);
    }
    ISOSCOPE_RETURN_IF_ERROR(
        ForEach(lists.file(), lists.range(window),
                [&](const BlockInterval& interval) { return entry_run->Append(interval); }));
  }
  node->header.window_end = entry_run->entry_count();
  return absl::OkStatus();
}

absl::Status ExternalNodeBuilder::WriteLeafLists(const Buckets& buckets, NodeRecords* node,
                                                 EntryRunWriter* entry_run) const {
  for (std::size_t slab = 0; slab < node->slabs.size(); ++slab) {
    node->slabs[slab].leaf_begin = entry_run->entry_count();
    if (buckets.range(slab).count <= kEntriesPerPage) {
      ISOSCOPE_RETURN_IF_ERROR(
          ForEach(buckets.file(), buckets.range(slab),
                  [&](const BlockInterval& interval) { return entry_run->Append(interval); }));
    }
  }
  node->header.leaf_end = entry_run->entry_count();
  return absl::OkStatus();
}

absl::Status ExternalNodeBuilder::WriteEntryRun(const Buckets& buckets,
                                                std::span<const double> lower, const Census& census,
                                                NodeRecords* node) const {
  const io::ScratchRange& kept = buckets.range(lower.size());
  EntryRunWriter entry_run(pages_);
  ISOSCOPE_RETURN_IF_ERROR(WriteLeftLists(buckets.file(), kept, lower, node, &entry_run));
  ISOSCOPE_RETURN_IF_ERROR(WriteRightLists(buckets.file(), kept, lower, node, &entry_run));
  ISOSCOPE_RETURN_IF_ERROR(
      WriteWindowLists(buckets.file(), kept, lower, census.coverage, node, &entry_run));
  ISOSCOPE_RETURN_IF_ERROR(WriteLeafLists(buckets, node, &entry_run));
  return entry_run.Finish();
}

absl::StatusOr<io::PageNumber> ExternalNodeBuilder::BuildNode(const io::ScratchFile& file,
                                                              const io::ScratchRange& range) {
  if (range.count <= plan_.in_memory_count) {
    return BuildInMemory(file, range);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const io::PageNumber page, pages_->Append(""));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<double> lower, ChooseSlabs(file, range));
  ISOSCOPE_ASSIGN_OR_RETURN(const Census census, TakeCensus(file, range, lower));
  ISOSCOPE_ASSIGN_OR_RETURN(const Buckets buckets, Distribute(file, range, lower, census));
  NodeRecords node(lower);
  ISOSCOPE_RETURN_IF_ERROR(WriteEntryRun(buckets, lower, census, &node));
  for (std::size_t slab = 0; slab < lower.size(); ++slab) {
    if (buckets.range(slab).count > kEntriesPerPage) {
      ISOSCOPE_ASSIGN_OR_RETURN(node.slabs[slab].child_page,
                                BuildNode(buckets.file(), buckets.range(slab)));
    }
  }
  ISOSCOPE_RETURN_IF_ERROR(pages_->Overwrite(page, node.Encode()));
  return page;
}

}  // namespace

MemoryPlan::MemoryPlan(std::int64_t memory_bytes)
    : sorter_bytes(memory_bytes / 2),
      bucket_bytes(memory_bytes / 4 / (kMaxSlabs + 1)),
      sequence_bytes(std::min(memory_bytes / 8, base::kMiB)),
      in_memory_count(std::max(memory_bytes / kBytesPerInterval, kEntriesPerPage)) {}

absl::StatusOr<io::PageNumber> BuildNodeExternally(const io::ScratchFile& file,
                                                   const io::ScratchRange& range,
                                                   const IntervalTreeBuilder::Options& options,
                                                   io::PageFileWriter* pages) {
  return ExternalNodeBuilder(options, pages).BuildNode(file, range);
}

}  // namespace isoscope::index
