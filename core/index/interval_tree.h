// The external interval tree of a shard: finds the blocks whose span contains an isovalue.
//
// A query reads O(log_B N + T / B) pages for N intervals, T of them active, B = 170 to a page.
// Nothing but the header and a page cache of bounded size stays in memory. It is step 0 of a frame
// (docs/architecture.md, "Life of a frame"). The head of interval_tree.cc describes a query.
// Source: Arge and Vitter 1996/2003; Chiang and Silva 1997 (references.bib).

#ifndef ISOSCOPE_CORE_INDEX_INTERVAL_TREE_H_
#define ISOSCOPE_CORE_INDEX_INTERVAL_TREE_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/file.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_span.h"

namespace isoscope::index {

// The span of one block.
struct BlockInterval {
  volume::ScalarSpan span;
  volume::BlockId block_id = 0;
  std::uint32_t ordinal = 0;  // of the block in its shard

  friend bool operator==(const BlockInterval&, const BlockInterval&) = default;
};

struct QueryResult {
  std::vector<BlockInterval> active;  // ascending by ordinal
  std::int64_t page_read_count = 0;   // pages the query asked for
  std::int64_t read_bytes = 0;        // bytes that came from the file, not from the page cache
};

// Immutable after Open; Query is thread-safe.
class IntervalTree {
 public:
  // Opens a tree and verifies its header. At most `page_cache_bytes` of pages stay in memory.
  // DATA_LOSS if the header is damaged or contradicts the file's size, FAILED_PRECONDITION if the
  // file has another version.
  static absl::StatusOr<std::unique_ptr<IntervalTree>> Open(
      std::unique_ptr<io::RandomAccessFile> file, std::int64_t page_cache_bytes);
  ~IntervalTree();

  // Returns all intervals with IsActive(span, isovalue). Reads at most
  // MaxPageReads(interval_count(), active.size()) pages. INVALID_ARGUMENT unless isovalue is
  // finite; DATA_LOSS, naming file and page, if a page is damaged.
  [[nodiscard]] absl::StatusOr<QueryResult> Query(double isovalue) const;

  [[nodiscard]] std::int64_t interval_count() const;

  // The bound on page reads, proved in docs/format/interval_tree.md: 0 for N = 0, 2 for N <= B,
  // else 8 L(N) + 2 + floor(2 T / B), where L(N) <= 1 + log_63(N / B) counts the levels of nodes.
  static std::int64_t MaxPageReads(std::int64_t interval_count, std::int64_t active_count);

 private:
  class Impl;
  explicit IntervalTree(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_INTERVAL_TREE_H_
