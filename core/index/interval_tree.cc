// A query walks one path of nodes from the root, and reads up to four lists at each.
//
// A node cuts the axis into slabs (s_j, s_(j+1)]; the isovalue v lies in exactly one of them, say
// j. An interval (lo, hi] that is kept at the node lies to slab j in one of these ways:
//
//            s_j                 s_(j+1)
//             |       lo ===========|=====     begins in j, ends later     left list of j
//        =====|=========== hi       |          began before, ends in j     right list of j
//        =====|=====================|=====     covers j                    window list of j
//        ===  |                     |  ===     does not meet j             none
//
// That is why three lists suffice. In the left list hi > s_(j+1) >= v for every interval: it is
// active iff lo < v, so in ascending order of lo the active ones come first. In the right list
// lo < s_j < v: it is active iff hi >= v, so in descending order of hi the active ones come first.
// Reading either list ends at the first inactive entry. Intervals that cover j are active for every
// v in it. Neighbouring slabs share a window list as long as it has at most 2 m + B entries, where
// m is the fewest that cover one of these slabs: apart from B entries, at least half of what is
// read is reported (filtering search).
//
// An interval that begins and ends in slab j without covering it is not kept at the node. At most B
// = 170 such intervals are in the slab's leaf list; more are in its child node, which the walk
// visits next.
//
// Example: bounds 10, 20, 30 make the slabs (-inf, 10], (10, 20], (20, 30], (30, inf]. The interval
// (5, 25] is in the left list of slab 0, the window list of slab 1 and the right list of slab 2.
// v = 7 finds it in the first (5 < 7), v = 15 in the second, v = 25 in the third (25 >= 25). v = 30
// also reads the third list, and stops there (25 < 30).
//
// Invariant: positions, page numbers and levels of the file are checked before they are used.
//
// Layout, proof of the bound: docs/format/interval_tree.md. Source: Arge and Vitter 2003, section 2
// (references.bib: arge-vitter), with the window lists of Chazelle 1986 (chazelle-filtering).

#include "core/index/interval_tree.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/base/status_macros.h"
#include "core/index/interval_tree_format.h"
#include "core/io/page_file.h"

namespace isoscope::index {
namespace {

using format::kEntriesPerPage;

// Below this size a comparison sort is faster than a radix sort.
constexpr std::size_t kRadixSortMinSize = 2048;

// Stable. At most three counting passes, where std::sort takes 20 comparisons an element.
void SortByOrdinal(std::vector<BlockInterval>* intervals) {
  if (intervals->size() < kRadixSortMinSize) {
    std::stable_sort(
        intervals->begin(), intervals->end(),
        [](const BlockInterval& a, const BlockInterval& b) { return a.ordinal < b.ordinal; });
    return;
  }
  constexpr unsigned kDigitBits = 11;
  constexpr std::uint32_t kDigitCount = 1u << kDigitBits;
  std::uint32_t greatest = 0;
  for (const BlockInterval& interval : *intervals) {
    greatest = std::max(greatest, interval.ordinal);
  }
  std::vector<BlockInterval> sorted(intervals->size());
  for (unsigned shift = 0; shift < 32 && (greatest >> shift) != 0; shift += kDigitBits) {
    const auto digit_of = [shift](const BlockInterval& interval) {
      return (interval.ordinal >> shift) & (kDigitCount - 1);
    };
    std::array<std::size_t, kDigitCount + 1> next{};
    for (const BlockInterval& interval : *intervals) {
      ++next[digit_of(interval) + 1];
    }
    for (std::size_t digit = 1; digit < next.size(); ++digit) {
      next[digit] += next[digit - 1];
    }
    for (const BlockInterval& interval : *intervals) {
      sorted[next[digit_of(interval)]++] = interval;
    }
    intervals->swap(sorted);
  }
}

// L(N): how many nodes the longest path of a tree has; 0 for N <= B.
std::int64_t MaxTreeLevels(std::int64_t interval_count) {
  constexpr std::int64_t kHalfSlabs = format::kMaxSlabs / 2;
  std::int64_t tree_levels = 0;
  for (std::int64_t count = interval_count; count > kEntriesPerPage; ++tree_levels) {
    count = (count + kHalfSlabs - 1) / kHalfSlabs - 1;
  }
  return tree_levels;
}

}  // namespace

class IntervalTree::Impl {
 public:
  explicit Impl(std::unique_ptr<io::PageFile> pages) : pages_(std::move(pages)) {}

  absl::Status ReadHeader();
  [[nodiscard]] absl::StatusOr<QueryResult> Query(double isovalue) const;
  [[nodiscard]] std::int64_t interval_count() const {
    return static_cast<std::int64_t>(header_.interval_count);
  }

 private:
  // Carried from node to node by one query.
  struct QueryState {
    double isovalue = 0.0;
    io::PageReadCost cost;
    std::vector<BlockInterval> active;
    // The last entry page that was read: neighbouring lists share pages.
    std::optional<io::PageFile::Page> page;
    io::PageNumber page_number = 0;
  };

  // Positions [begin, end) of a node's entry run.
  struct Range {
    std::uint32_t begin = 0;
    std::uint32_t end = 0;
  };

  // One node as a query sees it: the lists of the isovalue's slab.
  struct NodeVisit {
    io::PageNumber entry_run_page = 0;  // first page of the entry run
    std::uint32_t entry_run_size = 0;   // entries
    volume::ScalarSpan slab;            // its bounds
    Range left;
    Range right;
    Range window;
    Range leaf;
    io::PageNumber child_page = 0;
  };

  // Decides which entries of a list are reported.
  enum class ListKind {
    kSorted,  // the active ones, which come first: reading ends with the first inactive entry
    kWindow,  // those that cover the slab: any other active one is in its left or right list
    kLeaf,    // the active ones
  };

  // Reads a node and picks the isovalue's slab. DATA_LOSS unless everything is in range.
  [[nodiscard]] absl::StatusOr<NodeVisit> VisitNode(io::PageNumber page, QueryState* state) const;
  [[nodiscard]] absl::Status CheckVisit(io::PageNumber page, const format::NodeHeader& header,
                                        const NodeVisit& visit) const;
  // Appends the active intervals of a list to `state->active`. In the lists of one slab each
  // interval is reported once.
  [[nodiscard]] absl::Status ReadList(const NodeVisit& visit, Range range, ListKind kind,
                                      QueryState* state) const;
  // Makes page `page_in_entry_run` of the entry run the current one: `state->page`.
  [[nodiscard]] absl::Status LoadEntryPage(const NodeVisit& visit, std::uint32_t page_in_entry_run,
                                           QueryState* state) const;

  std::unique_ptr<io::PageFile> pages_;
  format::Header header_;
};

absl::Status IntervalTree::Impl::ReadHeader() {
  io::PageReadCost cost;
  ISOSCOPE_ASSIGN_OR_RETURN(const io::PageFile::Page page, pages_->Read(0, &cost));
  const absl::string_view payload = page.payload();
  if (payload.substr(0, format::kMagicBytes) !=
      absl::string_view(format::kMagic, format::kMagicBytes)) {
    return pages_->PageError(0, "does not begin with ISOTREE1: not an interval tree");
  }
  header_ = format::DecodeHeader(payload.data());
  if (header_.version != format::kVersion) {
    return absl::FailedPreconditionError(
        absl::StrCat(pages_->path(), ": interval tree of version ", header_.version,
                     ", this program reads version ", format::kVersion,
                     "; partition the volume again or use the program that wrote it"));
  }
  if (header_.page_bytes != io::kPageBytes || header_.entry_bytes != format::kEntryBytes ||
      header_.max_slabs != static_cast<std::uint32_t>(format::kMaxSlabs)) {
    return pages_->PageError(
        0, absl::StrCat("pages of ", header_.page_bytes, " bytes, entries of ", header_.entry_bytes,
                        " and ", header_.max_slabs, " slabs, expected ", io::kPageBytes, ", ",
                        format::kEntryBytes, " and ", format::kMaxSlabs));
  }
  if (static_cast<std::int64_t>(header_.page_count) != pages_->page_count()) {
    return pages_->PageError(0, absl::StrCat("header says ", header_.page_count,
                                             " pages, the file has ", pages_->page_count()));
  }
  const bool is_empty = header_.interval_count == 0;
  if (header_.interval_count > static_cast<std::uint64_t>(format::kMaxIntervalCount) ||
      is_empty != (header_.root_page == 0) || is_empty != (header_.page_count == 1) ||
      header_.root_page >= header_.page_count) {
    return pages_->PageError(
        0, absl::StrCat("root page ", header_.root_page, " of ", header_.page_count, " pages for ",
                        header_.interval_count, " intervals is impossible"));
  }
  return absl::OkStatus();
}

absl::StatusOr<QueryResult> IntervalTree::Impl::Query(double isovalue) const {
  if (!std::isfinite(isovalue)) {
    return absl::InvalidArgumentError(
        absl::StrCat(pages_->path(), ": isovalue ", isovalue, ", expected a finite number"));
  }
  QueryState state;
  state.isovalue = isovalue;
  int tree_level = 0;
  for (io::PageNumber page = header_.root_page; page != 0; ++tree_level) {
    if (tree_level == format::kMaxTreeLevels) {
      return pages_->PageError(
          page, absl::StrCat("is a node below ", tree_level, " others, expected fewer"));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const NodeVisit visit, VisitNode(page, &state));
    ISOSCOPE_RETURN_IF_ERROR(ReadList(visit, visit.left, ListKind::kSorted, &state));
    ISOSCOPE_RETURN_IF_ERROR(ReadList(visit, visit.right, ListKind::kSorted, &state));
    ISOSCOPE_RETURN_IF_ERROR(ReadList(visit, visit.window, ListKind::kWindow, &state));
    ISOSCOPE_RETURN_IF_ERROR(ReadList(visit, visit.leaf, ListKind::kLeaf, &state));
    page = visit.child_page;
  }
  SortByOrdinal(&state.active);
  return QueryResult{.active = std::move(state.active),
                     .page_read_count = state.cost.page_read_count,
                     .read_bytes = state.cost.read_bytes};
}

absl::StatusOr<IntervalTree::Impl::NodeVisit> IntervalTree::Impl::VisitNode(
    io::PageNumber page, QueryState* state) const {
  ISOSCOPE_ASSIGN_OR_RETURN(const io::PageFile::Page node, pages_->Read(page, &state->cost));
  const char* payload = node.payload().data();
  const auto kind = base::LoadLittleEndian<std::uint16_t>(payload);
  const format::NodeHeader header = format::DecodeNodeHeader(payload);
  if (kind != format::kNodeKind || header.slab_count < 1 || header.slab_count > format::kMaxSlabs) {
    return pages_->PageError(page, absl::StrCat("kind ", kind, " with ", header.slab_count,
                                                " slabs, expected a node (kind ", format::kNodeKind,
                                                ") with 1 to ", format::kMaxSlabs));
  }
  // The last slab that begins below the isovalue.
  std::int64_t slab = 0;
  for (std::int64_t end = header.slab_count; end - slab > 1;) {
    const std::int64_t middle = (slab + end) / 2;
    const auto lower = base::LoadLittleEndian<double>(payload + format::SlabRecordOffset(middle));
    (lower < state->isovalue ? slab : end) = middle;
  }
  const format::SlabRecord record =
      format::DecodeSlabRecord(payload + format::SlabRecordOffset(slab));
  format::SlabRecord next{.lower = std::numeric_limits<double>::infinity(),
                          .left_begin = header.left_end,
                          .right_begin = header.right_end,
                          .leaf_begin = header.leaf_end};
  if (slab + 1 < header.slab_count) {
    next = format::DecodeSlabRecord(payload + format::SlabRecordOffset(slab + 1));
  }
  NodeVisit visit;
  visit.entry_run_page = page + 1;
  visit.entry_run_size = header.leaf_end;
  visit.slab = {.min = record.lower, .max = next.lower};
  visit.left = {record.left_begin, next.left_begin};
  visit.right = {record.right_begin, next.right_begin};
  // Wraps around if damaged, and is then refused.
  visit.window = {record.window_begin, record.window_begin + record.window_size};
  visit.leaf = {record.leaf_begin, next.leaf_begin};
  visit.child_page = record.child_page;
  ISOSCOPE_RETURN_IF_ERROR(CheckVisit(page, header, visit));
  return visit;
}

absl::Status IntervalTree::Impl::CheckVisit(io::PageNumber page, const format::NodeHeader& header,
                                            const NodeVisit& visit) const {
  const auto within = [](Range range, std::uint32_t begin, std::uint32_t end) {
    return begin <= range.begin && range.begin <= range.end && range.end <= end;
  };
  if (!within(visit.left, 0, header.left_end) ||
      !within(visit.right, header.left_end, header.right_end) ||
      !within(visit.window, header.right_end, header.window_end) ||
      !within(visit.leaf, header.window_end, header.leaf_end)) {
    return pages_->PageError(
        page, absl::StrCat("lists [", visit.left.begin, ", ", visit.left.end, "), [",
                           visit.right.begin, ", ", visit.right.end, "), [", visit.window.begin,
                           ", ", visit.window.end, "), [", visit.leaf.begin, ", ", visit.leaf.end,
                           ") are not within their sections, which end at ", header.left_end, ", ",
                           header.right_end, ", ", header.window_end, ", ", header.leaf_end));
  }
  const std::int64_t run_end =
      std::int64_t{page} + 1 +
      (std::int64_t{visit.entry_run_size} + kEntriesPerPage - 1) / kEntriesPerPage;
  if (run_end > pages_->page_count() ||
      (visit.child_page != 0 && (std::int64_t{visit.child_page} < run_end ||
                                 std::int64_t{visit.child_page} >= pages_->page_count()))) {
    return pages_->PageError(
        page,
        absl::StrCat("entry pages end at page ", run_end, ", child node at page ", visit.child_page,
                     ", expected them in this order and below page ", pages_->page_count()));
  }
  return absl::OkStatus();
}

absl::Status IntervalTree::Impl::ReadList(const NodeVisit& visit, Range range, ListKind kind,
                                          QueryState* state) const {
  constexpr auto kPerPage = static_cast<std::uint32_t>(kEntriesPerPage);
  for (std::uint32_t position = range.begin; position < range.end;) {
    const std::uint32_t page_in_entry_run = position / kPerPage;
    ISOSCOPE_RETURN_IF_ERROR(LoadEntryPage(visit, page_in_entry_run, state));
    const char* entries = state->page->payload().data() + format::kEntryPageHeaderBytes;
    const std::uint32_t in_page_end = std::min(range.end - page_in_entry_run * kPerPage, kPerPage);
    for (std::uint32_t i = position - page_in_entry_run * kPerPage; i < in_page_end; ++i) {
      const BlockInterval interval = format::DecodeEntry(entries + i * format::kEntryBytes);
      const bool covers_slab =
          interval.span.min <= visit.slab.min && visit.slab.max <= interval.span.max;
      if (!volume::IsActive(interval.span, state->isovalue)) {
        if (kind == ListKind::kSorted) {
          return absl::OkStatus();
        }
      } else if (kind != ListKind::kWindow || covers_slab) {
        state->active.push_back(interval);
      }
    }
    position = page_in_entry_run * kPerPage + in_page_end;
  }
  return absl::OkStatus();
}

absl::Status IntervalTree::Impl::LoadEntryPage(const NodeVisit& visit,
                                               std::uint32_t page_in_entry_run,
                                               QueryState* state) const {
  const io::PageNumber page = visit.entry_run_page + page_in_entry_run;
  if (state->page.has_value() && state->page_number == page) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(state->page, pages_->Read(page, &state->cost));
  state->page_number = page;
  const char* payload = state->page->payload().data();
  const auto kind = base::LoadLittleEndian<std::uint16_t>(payload);
  const auto count = base::LoadLittleEndian<std::uint16_t>(payload + 2);
  const std::int64_t expected_count = std::min(
      std::int64_t{visit.entry_run_size} - std::int64_t{page_in_entry_run} * kEntriesPerPage,
      kEntriesPerPage);
  if (kind != format::kEntryPageKind || std::int64_t{count} != expected_count) {
    return pages_->PageError(
        page, absl::StrCat("kind ", kind, " with ", count, " entries, expected kind ",
                           format::kEntryPageKind, " with ", expected_count));
  }
  return absl::OkStatus();
}

IntervalTree::IntervalTree(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
IntervalTree::~IntervalTree() = default;

absl::StatusOr<std::unique_ptr<IntervalTree>> IntervalTree::Open(
    std::unique_ptr<io::RandomAccessFile> file, std::int64_t page_cache_bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(auto pages, io::PageFile::Open(std::move(file), page_cache_bytes));
  auto impl = std::make_unique<Impl>(std::move(pages));
  ISOSCOPE_RETURN_IF_ERROR(impl->ReadHeader());
  return std::unique_ptr<IntervalTree>(new IntervalTree(std::move(impl)));
}

absl::StatusOr<QueryResult> IntervalTree::Query(double isovalue) const {
  return impl_->Query(isovalue);
}

std::int64_t IntervalTree::interval_count() const { return impl_->interval_count(); }

std::int64_t IntervalTree::MaxPageReads(std::int64_t interval_count, std::int64_t active_count) {
  if (interval_count <= kEntriesPerPage) {
    return interval_count > 0 ? 2 : 0;
  }
  return 8 * MaxTreeLevels(interval_count) + 2 + 2 * active_count / kEntriesPerPage;
}

}  // namespace isoscope::index
