// The spans of a volume's blocks, and the active sets and trees computed from them. All open shards
// of the volume in a process share one copy.

#ifndef ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_
#define ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_

#include <atomic>
#include <cstddef>
#include <functional>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"

#include "core/base/mutex.h"
#include "core/math/vec.h"
#include "core/volume/block_set.h"
#include "core/volume/block_spans.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"
#include "core/volume/range_table.h"
#include "core/volume/scalar_span.h"
#include "core/volume/span_octree.h"

namespace isoscope::store {

// Either a table in memory, or a span_tree.bin whose table is read only if somebody asks for it.
// Thread-safe.
class VolumeRanges {
 public:
  using LoadTable = std::function<absl::StatusOr<volume::RangeTable>()>;

  // Returns the ranges with an equal table that this process holds already; else those of `table`.
  // REQUIRES: the table has Volume(block_dims) blocks.
  static std::shared_ptr<VolumeRanges> Share(const math::Index3& block_dims,
                                             volume::RangeTable table);
  // Returns the ranges with this key that this process holds already; else those of `octree`.
  //
  // key:        equal for equal tables; not empty
  // load_table: reads the table
  static std::shared_ptr<VolumeRanges> Share(const std::string& key, volume::SpanOctree octree,
                                             LoadTable load_table);

  // Returns the bytes that the ranges of this process may take later, beside what they hold once
  // they are open: trees and pages of volumes with more than volume::kMaxDenseBlocks blocks.
  static std::size_t LaterBytes();

  VolumeRanges(const math::Index3& block_dims, volume::RangeTable table)
      : table_(std::move(table)), block_dims_(block_dims) {}
  VolumeRanges(std::string key, volume::SpanOctree octree, LoadTable load_table);
  VolumeRanges(const VolumeRanges&) = delete;
  VolumeRanges& operator=(const VolumeRanges&) = delete;

  [[nodiscard]] const std::string& key() const { return key_; }
  [[nodiscard]] const math::Index3& block_dims() const { return block_dims_; }
  // Returns the table. With a file, the first call reads all of it, and it is kept. If it can't be
  // read, the error is logged, and all spans are the widest that the type has: they are used to leave
  // work out, so there is more work, and pictures and meshes stay right.
  [[nodiscard]] const volume::RangeTable& table() const ABSL_LOCKS_EXCLUDED(table_mutex_);
  // True if table() would read, or has read, the table.
  [[nodiscard]] bool is_in_file() const { return load_table_ != nullptr; }
  // Returns the spans of single blocks, without reading the table. This must outlive them.
  [[nodiscard]] volume::BlockSpans Spans() const {
    return is_in_file() ? volume::BlockSpans(*file_octree_) : volume::BlockSpans(table_);
  }
  // Returns the span of a block, without reading the table. Errors are those of a page.
  [[nodiscard]] absl::StatusOr<volume::ScalarSpan> SpanOf(volume::BlockId id) const;
  // Returns the number of pages whose span an isovalue meets. REQUIRES: is_in_file().
  [[nodiscard]] std::int64_t CountActivePages(double isovalue) const {
    return file_octree_->page_spans().ActiveBlocks(isovalue).Count();
  }

  // Returns table().ActiveBlocks(rule). Keeps the sets of the last rules, one bit for each block of
  // the volume: kMinSets of them, and up to kMaxSets that take at most kMaxBytes.
  // REQUIRES: isovalues are finite.
  [[nodiscard]] std::shared_ptr<const volume::BlockSet> ActiveBlocks(const volume::InsideRule& rule)
      ABSL_LOCKS_EXCLUDED(mutex_);

  // Returns the same as a tree, found by an octree of spans: that of the file, or one that is built at
  // the first call. Keeps the trees of the last rules: one, and up to kMaxSets that take at most
  // kMaxTreeBytes together. Errors are those of pages of a file.
  [[nodiscard]] absl::StatusOr<std::shared_ptr<const volume::BlockTree>> ActiveTree(
      const volume::InsideRule& rule) ABSL_LOCKS_EXCLUDED(mutex_);

  static constexpr std::size_t kMaxTreeBytes = std::size_t{32} << 20;
  static constexpr std::size_t kMinSets = 16;
  static constexpr std::size_t kMaxSets = 128;  // as many as a frame has surfaces
  static constexpr std::size_t kMaxBytes = std::size_t{4} << 20;

 private:
  struct Entry {
    volume::InsideRule rule;
    std::shared_ptr<const volume::BlockSet> active;
  };
  struct TreeEntry {
    volume::InsideRule rule;
    std::shared_ptr<const volume::BlockTree> active;
  };

  [[nodiscard]] std::size_t later_bytes() const;
  // Returns the octree; builds it if there is none.
  const volume::SpanOctree& Octree() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  // Written once, under the mutex, if it is read from a file.
  mutable volume::RangeTable table_;
  const math::Index3 block_dims_;
  const std::string key_;
  const LoadTable load_table_;  // null: the table is in memory
  const std::optional<volume::SpanOctree> file_octree_;
  mutable base::Mutex table_mutex_;
  mutable std::atomic<bool> has_table_{false};  // read from the file

  base::Mutex mutex_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);    // the last used first
  std::list<TreeEntry> trees_ ABSL_GUARDED_BY(mutex_);  // the last used first
  std::optional<volume::SpanOctree> table_octree_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_VOLUME_RANGES_H_
