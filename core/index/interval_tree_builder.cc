// Sorts the intervals, then builds the tree node by node from the root:
//
//   1. Add: leave out intervals that are never active, make negative zeros positive, and pass the
//      others to a sorter, which spills sorted runs to disk when its memory is full.
//   2. Finish: merge them into canonical order, (lo, hi, block id, ordinal), and compute the file
//      tag on the way: the CRC-32C of all encoded entries.
//   3. Write a placeholder for the header page, then the nodes in preorder: for each its page
//      (again a placeholder), its entry run, its child nodes, and then its page for good.
//      in_memory_node_builder.cc does that with arrays; external_node_builder.cc does the same with
//      scratch files while a node has more intervals than fit.
//   4. Write the header last: a file that was not finished is no tree.
//
//        page 0   1     2 ...            p        p+1 ...          q
//        header | root | its entry run | child 0 | its entry run | child 1 | ...
//
// Invariant: every step keeps the canonical order, so the bytes depend on the set of intervals
// alone, not on the order of Add or on the memory.
//
// Based on: Arge and Vitter 2003, section 2 (references.bib: arge-vitter); Chiang and Silva 1997,
// section 3 (chiang-silva); Chazelle 1986 (chazelle-filtering: window lists).

#include "core/index/interval_tree_builder.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <tuple>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "core/base/crc32c.h"
#include "core/base/status_macros.h"
#include "core/index/external_node_builder.h"
#include "core/index/in_memory_node_builder.h"
#include "core/index/interval_tree_format.h"
#include "core/io/external_sorter.h"
#include "core/io/page_file.h"
#include "core/io/scratch_file.h"
#include "core/io/scratch_records.h"

namespace isoscope::index {
namespace {

struct CanonicalLess {
  bool operator()(const BlockInterval& a, const BlockInterval& b) const {
    return std::tie(a.span.min, a.span.max, a.block_id, a.ordinal) <
           std::tie(b.span.min, b.span.max, b.block_id, b.ordinal);
  }
};

// False for NaN too, which fails every comparison.
bool IsEverActive(const BlockInterval& interval) { return interval.span.min < interval.span.max; }

// Makes negative zeros positive.
void NormalizeZeros(BlockInterval* interval) {
  interval->span.min += 0.0;
  interval->span.max += 0.0;
}

// Extends the CRC-32C of all entries so far by `interval`.
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

// Writes a whole tree file. `build_root(pages)` writes the nodes and returns the page of the root.
template <typename BuildRoot>
absl::Status WriteTree(std::int64_t interval_count, std::uint32_t fingerprint,
                       io::WritableFile* file, const BuildRoot& build_root) {
  io::PageFileWriter pages(file, fingerprint);
  ISOSCOPE_RETURN_IF_ERROR(pages.Append("").status());
  format::Header header;
  header.interval_count = static_cast<std::uint64_t>(interval_count);
  if (interval_count > 0) {
    ISOSCOPE_ASSIGN_OR_RETURN(header.root_page, build_root(&pages));
  }
  header.page_count = static_cast<std::uint32_t>(pages.page_count());
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

// REQUIRES: `intervals` are in canonical order.
absl::Status WriteTreeInMemory(std::vector<BlockInterval>* intervals, io::WritableFile* file) {
  return WriteTree(static_cast<std::int64_t>(intervals->size()), Fingerprint(*intervals), file,
                   [&](io::PageFileWriter* pages) { return BuildNodeInMemory(*intervals, pages); });
}

}  // namespace

class IntervalTreeBuilder::Impl {
 public:
  using Sorter = io::ExternalSorter<BlockInterval, CanonicalLess>;

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

  absl::Status Finish(io::WritableFile* file) {
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
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::ScratchFile> sorted,
                              io::ScratchFile::Create(options_.scratch_directory));
    io::RecordWriter<BlockInterval> writer(sorted.get(), 0, plan_.sequence_bytes);
    std::uint32_t fingerprint = 0;
    ISOSCOPE_RETURN_IF_ERROR(ForEachSorted([&](const BlockInterval& interval) {
      fingerprint = ExtendFingerprint(fingerprint, interval);
      return writer.Append(interval);
    }));
    ISOSCOPE_RETURN_IF_ERROR(writer.Flush());
    return WriteTree(count, fingerprint, file, [&](io::PageFileWriter* pages) {
      return BuildNodeExternally(*sorted, {.offset = 0, .count = count}, options_, pages);
    });
  }

 private:
  // Calls visit(interval) for each interval in canonical order, then frees the sorter.
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

absl::Status IntervalTreeBuilder::Finish(io::WritableFile* file) { return impl_->Finish(file); }

}  // namespace isoscope::index
