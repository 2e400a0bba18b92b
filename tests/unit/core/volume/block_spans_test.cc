// Spans by pages are compared with those of the table: all sample types, volumes that do not fill
// their pages, any order of blocks. A page that can't be read must leave no work out.

#include "core/volume/block_spans.h"

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr ScalarType kTypes[] = {ScalarType::kUint8,   ScalarType::kInt8,   ScalarType::kUint16,
                                 ScalarType::kInt16,   ScalarType::kUint32, ScalarType::kInt32,
                                 ScalarType::kFloat32, ScalarType::kFloat64};

// Random spans, a few of them empty.
RangeTable NoiseTable(ScalarType type, const math::Index3& dims) {
  RangeTable table(type, math::Volume(dims));
  for (std::int64_t id = 0; id < math::Volume(dims); ++id) {
    const std::uint64_t bits = base::RandomBits(5, static_cast<std::uint64_t>(id));
    if (bits % 20 != 0) {
      const auto low = static_cast<double>(bits % 100);
      table.Set(static_cast<BlockId>(id), {low, low + static_cast<double>(bits >> 32 & 15)});
    }
  }
  return table;
}

// Counts loads; one page can't be read.
class CountedPages final : public SpanPages {
 public:
  CountedPages(const math::Index3& dims, const RangeTable& table, std::int64_t damaged_page)
      : pages_(PagesOfTable(dims, table)), damaged_page_(damaged_page) {}

  absl::StatusOr<std::shared_ptr<const std::string>> Load(std::int64_t page) override {
    ++load_count;
    if (page == damaged_page_) {
      return absl::DataLossError("page 1 is damaged");
    }
    return pages_->Load(page);
  }
  [[nodiscard]] std::size_t size_bytes() const override { return pages_->size_bytes(); }

  int load_count = 0;

 private:
  const std::unique_ptr<SpanPages> pages_;
  const std::int64_t damaged_page_;
};

SpanOctree OctreeOf(const math::Index3& dims, const RangeTable& table,
                    const std::shared_ptr<CountedPages>& pages) {
  return SpanOctree(dims, SpanOctree::OfTable(dims, table).page_spans(), pages);
}

TEST(BlockSpansTest, PagesHaveTheSpansOfTheTableInAnyOrder) {
  for (const ScalarType type : kTypes) {
    for (const math::Index3& dims :
         {math::Index3{1, 1, 1}, {16, 16, 16}, {17, 33, 5}, {100, 1, 2}, {40, 35, 50}}) {
      const RangeTable table = NoiseTable(type, dims);
      const SpanOctree octree = SpanOctree::OfTable(dims, table);
      BlockSpans of_table(table);
      BlockSpans of_pages(octree);
      EXPECT_EQ(of_pages.type(), type);
      const std::int64_t count = math::Volume(dims);
      for (std::int64_t i = 0; i < count; ++i) {
        const auto other = static_cast<BlockId>(base::RandomBits(9, static_cast<std::uint64_t>(i)) %
                                                static_cast<std::uint64_t>(count));
        for (const BlockId id : {static_cast<BlockId>(i), other}) {
          ASSERT_EQ(of_pages.Get(id), table.Get(id)) << NameOf(type) << ", block " << id;
          ASSERT_EQ(of_table.Get(id), table.Get(id)) << NameOf(type) << ", block " << id;
        }
      }
      ISOSCOPE_EXPECT_OK(of_pages.status());
    }
  }
}

TEST(BlockSpansTest, BlocksAndNeighboursOfACubeLoadEachPageOnce) {
  const math::Index3 dims{48, 48, 48};
  const RangeTable table = NoiseTable(ScalarType::kUint16, dims);
  const auto pages = std::make_shared<CountedPages>(dims, table, -1);
  const SpanOctree octree = OctreeOf(dims, table, pages);
  BlockSpans spans(octree);
  // Around the corner in which eight pages meet.
  for (std::int64_t z = 12; z < 20; ++z) {
    for (std::int64_t y = 12; y < 20; ++y) {
      for (std::int64_t x = 12; x < 20; ++x) {
        const auto id = static_cast<BlockId>(x + dims.x * (y + dims.y * z));
        ASSERT_EQ(spans.Get(id), table.Get(id));
      }
    }
  }
  EXPECT_EQ(pages->load_count, 8);
}

TEST(BlockSpansTest, APageThatCantBeReadLeavesNoBlockOutAndIsTold) {
  const math::Index3 dims{32, 16, 16};
  const RangeTable table = NoiseTable(ScalarType::kInt16, dims);
  const auto pages = std::make_shared<CountedPages>(dims, table, 1);
  const SpanOctree octree = OctreeOf(dims, table, pages);
  BlockSpans spans(octree);
  EXPECT_EQ(spans.Get(3), table.Get(3));
  ISOSCOPE_EXPECT_OK(spans.status());
  EXPECT_EQ(spans.Get(20), (ScalarSpan{-32768, 32767}));
  EXPECT_EQ(spans.Get(21), WidestSpan(ScalarType::kInt16));
  EXPECT_THAT(spans.status(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("page 1")));
  EXPECT_EQ(pages->load_count, 2) << "it is not asked for again";
  EXPECT_EQ(spans.Get(4), table.Get(4));
}

TEST(BlockSpansTest, TheWidestSpanHoldsAllValuesOfItsType) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_EQ(WidestSpan(ScalarType::kUint8), (ScalarSpan{0, 255}));
  EXPECT_EQ(WidestSpan(ScalarType::kInt32), (ScalarSpan{-2147483648.0, 2147483647.0}));
  EXPECT_EQ(WidestSpan(ScalarType::kFloat32), (ScalarSpan{-kInfinity, kInfinity}));
}

}  // namespace
}  // namespace isoscope::volume
