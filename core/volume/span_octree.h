// An 8-fold tree of spans over the range table of a volume. It finds the active blocks of a surface
// without a pass over the whole table: a node whose span is not active has no active block.
//
//        level 0       blocks                             in pages, loaded where work goes
//        level 4       pages: 16 x 16 x 16 blocks         kept; the first level of the tree
//        level 5 ...   eight nodes of the level below     kept, up to one node: the volume
//
// For 2.4 x 10^8 blocks of 16-bit samples the table takes 980 MB, and the levels from 4 on 270 KB.
// Pages come from a table in memory, or from a file (core/store/span_tree_file.h).
//
// Exactness: a node's min is the least of its blocks', its max the greatest; empty spans and NaN do
// not count. If a block is active by a rule (volume::InsideRule), so is each node above it: the rules
// compare with the two ends alone, and a wider span passes every comparison that the block's passes.

#ifndef ISOSCOPE_CORE_VOLUME_SPAN_OCTREE_H_
#define ISOSCOPE_CORE_VOLUME_SPAN_OCTREE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/math/vec.h"
#include "core/volume/block_layout.h"
#include "core/volume/block_tree.h"
#include "core/volume/inside_rule.h"
#include "core/volume/range_table.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

namespace isoscope::volume {

// How the blocks of a volume lie in pages. A page is 4 x 4 x 4 bricks of a BlockTree, x fastest,
// each of 64 blocks, x fastest; what lies outside the volume is an empty span. Pages count x fastest.
struct SpanPageLayout {
  static constexpr int kBricksOnSide = 4;
  static constexpr std::int64_t kPageSide = kBricksOnSide * BlockTree::kBrickSide;  // blocks
  static constexpr std::int64_t kPageSpans = kPageSide * kPageSide * kPageSide;

  explicit SpanPageLayout(const math::Index3& block_dims);

  [[nodiscard]] std::int64_t page_count() const { return math::Volume(page_dims); }
  [[nodiscard]] static std::size_t PageBytes(ScalarType type) {
    return 2 * SizeOf(type) * static_cast<std::size_t>(kPageSpans);
  }
  // The page of a block, and the index of its span there.
  struct Place {
    std::int64_t page = 0;
    std::int64_t span = 0;
  };
  // REQUIRES: within block_dims.
  [[nodiscard]] Place PlaceOf(const math::Index3& block_index) const;
  // Returns the block index of the first block of a page.
  [[nodiscard]] math::Index3 BeginOf(std::int64_t page) const;

  math::Index3 block_dims;
  math::Index3 page_dims;
};

// Returns the bytes of a page of a table, as RangeTable::bytes() in the order of the page.
// REQUIRES: the table has Volume(layout.block_dims) blocks.
std::string SpanPageOf(const RangeTable& table, const SpanPageLayout& layout, std::int64_t page);

// Where pages come from. Thread-safe.
class SpanPages {
 public:
  virtual ~SpanPages() = default;
  // Returns the bytes of a page: SpanPageLayout::PageBytes of them. DATA_LOSS and the like if it
  // can't be read.
  virtual absl::StatusOr<std::shared_ptr<const std::string>> Load(std::int64_t page) = 0;
  // The bytes that it holds at most.
  [[nodiscard]] virtual std::size_t size_bytes() const = 0;
};

// The pages of a table in memory, which must outlive them.
std::unique_ptr<SpanPages> PagesOfTable(const math::Index3& block_dims, const RangeTable& table);

// Immutable; thread-safe.
class SpanOctree {
 public:
  // Makes the tree over pages whose spans, in the order of pages, are `page_spans`. O(pages).
  // REQUIRES: page_spans.block_count() is the number of pages; `pages` is not null.
  SpanOctree(const math::Index3& block_dims, RangeTable page_spans,
             std::shared_ptr<SpanPages> pages);
  // Makes the tree of a table in memory, which must outlive it. O(blocks).
  static SpanOctree OfTable(const math::Index3& block_dims, const RangeTable& table);

  [[nodiscard]] const SpanPageLayout& layout() const { return layout_; }
  // The spans of pages.
  [[nodiscard]] const RangeTable& page_spans() const { return levels_.front().spans; }
  // Returns the span of the whole volume.
  [[nodiscard]] ScalarSpan Total() const { return levels_.back().spans.Get(0); }
  // As SpanPages::Load. REQUIRES: the page exists.
  [[nodiscard]] absl::StatusOr<std::shared_ptr<const std::string>> LoadPage(
      std::int64_t page) const {
    return pages_->Load(page);
  }
  // Returns the span of a block. Errors are those of SpanPages::Load. REQUIRES: it exists.
  [[nodiscard]] absl::StatusOr<ScalarSpan> SpanOf(BlockId id) const;

  // Returns the active blocks: RangeTable::ActiveBlocks. Loads a page at a time, and only pages that
  // may have some. Errors are those of SpanPages::Load. O(active pages + bricks of the volume).
  [[nodiscard]] absl::StatusOr<BlockTree> ActiveBlocks(const InsideRule& rule) const;

  // The kept levels and the pages.
  [[nodiscard]] std::size_t size_bytes() const;

 private:
  struct Level {
    math::Index3 dims;
    RangeTable spans;  // by node, x fastest
  };

  // Appends the active pages under a node of a level, in the order of the tree.
  void FindActivePages(std::size_t level, const math::Index3& node, const InsideRule& rule,
                       std::vector<std::int64_t>* pages) const;

  SpanPageLayout layout_;
  std::shared_ptr<SpanPages> pages_;
  std::vector<Level> levels_;  // the first has a node for each page, the last one node
};

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_SPAN_OCTREE_H_
