#include "core/volume/span_octree.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/volume/active_spans.h"

namespace isoscope::volume {
namespace {

std::int64_t DivideUp(std::int64_t value, std::int64_t divisor) {
  return (value + divisor - 1) / divisor;
}

math::Index3 DividedUp(const math::Index3& dims, std::int64_t divisor) {
  return {DivideUp(dims.x, divisor), DivideUp(dims.y, divisor), DivideUp(dims.z, divisor)};
}

// Widens `total` by a span. Empty spans and NaN do not count.
void Widen(const ScalarSpan& span, ScalarSpan* total) {
  if (span.min <= span.max) {
    total->min = std::min(total->min, span.min);
    total->max = std::max(total->max, span.max);
  }
}

// Calls fn(row offset in the page, id of the first block, blocks) for each row of up to 4 blocks of
// a page that lies in the volume.
template <typename Fn>
void ForEachRow(const SpanPageLayout& layout, std::int64_t page, const Fn& fn) {
  const math::Index3 begin = layout.BeginOf(page);
  const math::Index3& dims = layout.block_dims;
  constexpr std::int64_t kSide = SpanPageLayout::kPageSide;
  for (std::int64_t z = begin.z; z < std::min(begin.z + kSide, dims.z); ++z) {
    for (std::int64_t y = begin.y; y < std::min(begin.y + kSide, dims.y); ++y) {
      for (std::int64_t x = begin.x; x < std::min(begin.x + kSide, dims.x);
           x += BlockTree::kBrickSide) {
        fn(layout.PlaceOf({x, y, z}).span, x + dims.x * (y + dims.y * z),
           std::min(BlockTree::kBrickSide, dims.x - x));
      }
    }
  }
}

class TablePages final : public SpanPages {
 public:
  TablePages(const math::Index3& block_dims, const RangeTable& table)
      : layout_(block_dims), table_(table) {}

  absl::StatusOr<std::shared_ptr<const std::string>> Load(std::int64_t page) override {
    return std::make_shared<const std::string>(SpanPageOf(table_, layout_, page));
  }
  [[nodiscard]] std::size_t size_bytes() const override { return table_.bytes().size(); }

 private:
  const SpanPageLayout layout_;
  const RangeTable& table_;
};

}  // namespace

SpanPageLayout::SpanPageLayout(const math::Index3& dims)
    : block_dims(dims), page_dims(DividedUp(dims, kPageSide)) {}

SpanPageLayout::Place SpanPageLayout::PlaceOf(const math::Index3& index) const {
  const auto in_page = [](std::int64_t at) { return at % kPageSide / BlockTree::kBrickSide; };
  const auto in_brick = [](std::int64_t at) { return at % BlockTree::kBrickSide; };
  const std::int64_t brick =
      in_page(index.x) + kBricksOnSide * (in_page(index.y) + kBricksOnSide * in_page(index.z));
  return {index.x / kPageSide +
              page_dims.x * (index.y / kPageSide + page_dims.y * (index.z / kPageSide)),
          brick * 64 + in_brick(index.x) + 4 * in_brick(index.y) + 16 * in_brick(index.z)};
}

math::Index3 SpanPageLayout::BeginOf(std::int64_t page) const {
  const std::int64_t row = page / page_dims.x;
  return {page % page_dims.x * kPageSide, row % page_dims.y * kPageSide,
          row / page_dims.y * kPageSide};
}

std::string SpanPageOf(const RangeTable& table, const SpanPageLayout& layout, std::int64_t page) {
  ISOSCOPE_CHECK_EQ(table.block_count(), math::Volume(layout.block_dims));
  const math::Index3 begin = layout.BeginOf(page);
  bool is_whole = true;
  for (int axis = 0; axis < 3; ++axis) {
    is_whole = is_whole && begin[axis] + SpanPageLayout::kPageSide <= layout.block_dims[axis];
  }
  std::string bytes = is_whole ? std::string(SpanPageLayout::PageBytes(table.type()), '\0')
                               : RangeTable(table.type(), SpanPageLayout::kPageSpans).bytes();
  const std::size_t span_bytes = 2 * SizeOf(table.type());
  ForEachRow(layout, page, [&](std::int64_t offset, std::int64_t id, std::int64_t count) {
    std::memcpy(bytes.data() + static_cast<std::size_t>(offset) * span_bytes,
                table.bytes().data() + static_cast<std::size_t>(id) * span_bytes,
                static_cast<std::size_t>(count) * span_bytes);
  });
  return bytes;
}

std::unique_ptr<SpanPages> PagesOfTable(const math::Index3& block_dims, const RangeTable& table) {
  return std::make_unique<TablePages>(block_dims, table);
}

SpanOctree::SpanOctree(const math::Index3& block_dims, RangeTable page_spans,
                       std::shared_ptr<SpanPages> pages)
    : layout_(block_dims), pages_(std::move(pages)) {
  ISOSCOPE_CHECK_EQ(page_spans.block_count(), layout_.page_count());
  ISOSCOPE_CHECK(pages_ != nullptr);
  const ScalarType type = page_spans.type();
  levels_.push_back({layout_.page_dims, std::move(page_spans)});
  while (math::Volume(levels_.back().dims) > 1) {
    const Level& fine = levels_.back();
    Level coarse{DividedUp(fine.dims, 2), {}};
    std::vector<ScalarSpan> spans(static_cast<std::size_t>(math::Volume(coarse.dims)));
    BlockId from = 0;
    for (std::int64_t z = 0; z < fine.dims.z; ++z) {
      for (std::int64_t y = 0; y < fine.dims.y; ++y) {
        for (std::int64_t x = 0; x < fine.dims.x; ++x) {
          const std::int64_t to = x / 2 + coarse.dims.x * (y / 2 + coarse.dims.y * (z / 2));
          Widen(fine.spans.Get(from++), &spans[static_cast<std::size_t>(to)]);
        }
      }
    }
    coarse.spans = RangeTable(type, math::Volume(coarse.dims));
    for (std::size_t i = 0; i < spans.size(); ++i) {
      coarse.spans.Set(static_cast<BlockId>(i), spans[i]);
    }
    levels_.push_back(std::move(coarse));
  }
}

SpanOctree SpanOctree::OfTable(const math::Index3& block_dims, const RangeTable& table) {
  const SpanPageLayout layout(block_dims);
  ISOSCOPE_CHECK_EQ(table.block_count(), math::Volume(block_dims));
  RangeTable page_spans(table.type(), layout.page_count());
  for (std::int64_t page = 0; page < layout.page_count(); ++page) {
    ScalarSpan total;
    ForEachRow(layout, page, [&](std::int64_t, std::int64_t id, std::int64_t count) {
      for (std::int64_t i = 0; i < count; ++i) {
        Widen(table.Get(static_cast<BlockId>(id + i)), &total);
      }
    });
    page_spans.Set(static_cast<BlockId>(page), total);
  }
  return SpanOctree(block_dims, std::move(page_spans), PagesOfTable(block_dims, table));
}

absl::StatusOr<ScalarSpan> SpanOctree::SpanOf(BlockId id) const {
  const math::Index3& dims = layout_.block_dims;
  ISOSCOPE_CHECK_LT(std::int64_t{id}, math::Volume(dims));
  const std::int64_t row = id / dims.x;
  const SpanPageLayout::Place place = layout_.PlaceOf({id % dims.x, row % dims.y, row / dims.y});
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const std::string> bytes,
                            pages_->Load(place.page));
  return SpanAt(page_spans().type(), *bytes, place.span);
}

void SpanOctree::FindActivePages(std::size_t level, const math::Index3& node,
                                 const InsideRule& rule, std::vector<std::int64_t>* pages) const {
  const math::Index3& dims = levels_[level].dims;
  const std::int64_t index = node.x + dims.x * (node.y + dims.y * node.z);
  if (!rule.IsActive(levels_[level].spans.Get(static_cast<BlockId>(index)))) {
    return;
  }
  if (level == 0) {
    pages->push_back(index);
    return;
  }
  const math::Index3& finer = levels_[level - 1].dims;
  for (std::int64_t z = 2 * node.z; z < std::min(2 * node.z + 2, finer.z); ++z) {
    for (std::int64_t y = 2 * node.y; y < std::min(2 * node.y + 2, finer.y); ++y) {
      for (std::int64_t x = 2 * node.x; x < std::min(2 * node.x + 2, finer.x); ++x) {
        FindActivePages(level - 1, {x, y, z}, rule, pages);
      }
    }
  }
}

absl::StatusOr<BlockTree> SpanOctree::ActiveBlocks(const InsideRule& rule) const {
  std::vector<std::int64_t> active_pages;
  FindActivePages(levels_.size() - 1, {}, rule, &active_pages);
  constexpr std::size_t kPageBricks =
      SpanPageLayout::kBricksOnSide * SpanPageLayout::kBricksOnSide * SpanPageLayout::kBricksOnSide;
  const math::Index3 brick_dims = DividedUp(layout_.block_dims, BlockTree::kBrickSide);
  std::vector<BlockTree::Brick> bricks;
  for (const std::int64_t page : active_pages) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const std::string> bytes, pages_->Load(page));
    ISOSCOPE_CHECK_EQ(bytes->size(), SpanPageLayout::PageBytes(page_spans().type()));
    std::uint64_t words[kPageBricks] = {};
    FindActiveSpans(page_spans().type(), *bytes, rule, words);
    const math::Index3 begin = layout_.BeginOf(page);
    for (std::size_t i = 0; i < kPageBricks; ++i) {
      if (words[i] != 0) {
        const auto in_page = static_cast<std::int64_t>(i);
        const std::int64_t x = begin.x / BlockTree::kBrickSide + in_page % 4;
        const std::int64_t y = begin.y / BlockTree::kBrickSide + in_page / 4 % 4;
        const std::int64_t z = begin.z / BlockTree::kBrickSide + in_page / 16;
        bricks.push_back(
            {static_cast<std::uint32_t>(x + brick_dims.x * (y + brick_dims.y * z)), words[i]});
      }
    }
  }
  return BlockTree(layout_.block_dims, bricks);
}

std::size_t SpanOctree::size_bytes() const {
  std::size_t bytes = pages_->size_bytes();
  for (const Level& level : levels_) {
    bytes += level.spans.bytes().capacity();
  }
  return bytes;
}

}  // namespace isoscope::volume
