// Encodes the pages of one node: the entry run, and the page with its header and slab records.

#ifndef ISOSCOPE_CORE_INDEX_NODE_WRITER_H_
#define ISOSCOPE_CORE_INDEX_NODE_WRITER_H_

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "absl/status/status.h"

#include "core/index/interval_tree.h"
#include "core/index/interval_tree_format.h"
#include "core/io/page_file.h"

namespace isoscope::index {

// Writes the entry run of one node: pages of B entries, the last one with fewer. Thread-compatible.
class EntryRunWriter {
 public:
  // `pages` outlives the writer; nothing else is appended to it before Finish.
  explicit EntryRunWriter(io::PageFileWriter* pages) : pages_(pages) { StartPage(); }

  absl::Status Append(const BlockInterval& interval);
  // Writes the last page, if it has entries. Errors of both: those of `pages`.
  absl::Status Finish();

  // The number of entries appended, which is the position of the next one.
  [[nodiscard]] std::uint32_t entry_count() const { return entry_count_; }

 private:
  void StartPage();

  io::PageFileWriter* pages_;
  std::string payload_;
  std::int64_t page_entry_count_ = 0;
  std::uint32_t entry_count_ = 0;
};

// The header and slab records of a node, filled in as its lists are written.
struct NodeRecords {
  std::vector<format::SlabRecord> slabs;
  format::NodeHeader header;

  // lower: lower bound of each slab, ascending; 1 to kMaxSlabs
  explicit NodeRecords(std::span<const double> lower);

  // Returns the payload of the node's page.
  [[nodiscard]] std::string Encode() const;
};

}  // namespace isoscope::index

#endif  // ISOSCOPE_CORE_INDEX_NODE_WRITER_H_
