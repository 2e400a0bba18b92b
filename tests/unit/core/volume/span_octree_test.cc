// Active blocks found by the tree are compared with the pass over the whole table: all sample types,
// isovalues and labels, empty spans, infinities and NaN, volumes that do not fill their pages. Pages
// without active blocks must not be loaded.

#include "core/volume/span_octree.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::volume {
namespace {

using isoscope::testing::StatusIs;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::UnorderedElementsAre;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr ScalarType kTypes[] = {ScalarType::kUint8,   ScalarType::kInt8,   ScalarType::kUint16,
                                 ScalarType::kInt16,   ScalarType::kUint32, ScalarType::kInt32,
                                 ScalarType::kFloat32, ScalarType::kFloat64};
constexpr math::Index3 kVolumes[] = {
    {1, 1, 1}, {16, 16, 16}, {17, 33, 5}, {100, 1, 2}, {40, 35, 50}};

// Spans of values 0 to 99 that vary slowly over the volume, a few of them empty.
RangeTable SmoothTable(ScalarType type, const math::Index3& dims, std::uint64_t seed) {
  RangeTable table(type, math::Volume(dims));
  for (std::int64_t id = 0; id < math::Volume(dims); ++id) {
    const double z = static_cast<double>(id / (dims.x * dims.y));
    const double y = static_cast<double>(id / dims.x % dims.y);
    const auto counter = static_cast<std::uint64_t>(id) * 2;
    const double middle = std::floor(45 + 40 * std::sin(0.1 * z) * std::cos(0.07 * y));
    const double extent = std::floor(6 * base::RandomUnit(seed, counter));
    if (base::RandomUnit(seed, counter + 1) > 0.05) {
      table.Set(static_cast<BlockId>(id), {middle, middle + extent});
    }
  }
  return table;
}

void ExpectAsTable(const math::Index3& dims, const RangeTable& table, const InsideRule& rule) {
  const SpanOctree octree = SpanOctree::OfTable(dims, table);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockTree active, octree.ActiveBlocks(rule));
  EXPECT_EQ(active, BlockTree(dims, table.ActiveBlocks(rule)))
      << NameOf(table.type()) << ", " << dims.x << " x " << dims.y << " x " << dims.z << ", "
      << rule.Text();
}

TEST(SpanOctreeTest, FindsTheActiveBlocksOfTheTable) {
  for (const ScalarType type : kTypes) {
    for (const math::Index3& dims : kVolumes) {
      const RangeTable table = SmoothTable(type, dims, 3);
      for (const double isovalue : {-5.0, 0.0, 30.0, 30.5, 45.0, 90.0, 1e300, -1e300}) {
        ExpectAsTable(dims, table, InsideRule::OfIsovalue(isovalue));
      }
      ExpectAsTable(dims, table, InsideRule::OfLabels({30}));
      ExpectAsTable(dims, table, InsideRule::OfLabels({3, 40, 40.5, 85}));
      ExpectAsTable(dims, table, InsideRule::OfLabels({200, -7}));
    }
  }
}

TEST(SpanOctreeTest, NoNumberAndInfiniteEndsActAsInTheTable) {
  const math::Index3 dims{20, 18, 3};
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double ends[] = {nan, -kInfinity, -1, 0, 1, kInfinity};
  std::string bytes;
  for (std::int64_t id = 0; id < math::Volume(dims); ++id) {
    for (const int end : {0, 1}) {
      const double value = ends[static_cast<std::size_t>(
          6 * base::RandomUnit(7, static_cast<std::uint64_t>(2 * id + end)))];
      bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
    }
  }
  const RangeTable table = RangeTable::FromBytes(ScalarType::kFloat64, math::Volume(dims), bytes);
  for (const double isovalue : {-2.0, -1.0, 0.0, 0.5, 1.0, 1e308}) {
    ExpectAsTable(dims, table, InsideRule::OfIsovalue(isovalue));
  }
  ExpectAsTable(dims, table, InsideRule::OfLabels({0, 1}));
}

TEST(SpanOctreeTest, KnowsEachSpanAndThatOfTheVolume) {
  const math::Index3 dims{17, 33, 5};
  for (const ScalarType type : kTypes) {
    const RangeTable table = SmoothTable(type, dims, 9);
    const SpanOctree octree = SpanOctree::OfTable(dims, table);
    EXPECT_EQ(octree.Total(), table.Total());
    for (std::int64_t id = 0; id < table.block_count(); ++id) {
      const auto block = static_cast<BlockId>(id);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ScalarSpan span, octree.SpanOf(block));
      ASSERT_EQ(span, table.Get(block)) << id;
    }
  }
}

// Pages of a table, counted; one of them can't be read.
class WatchedPages final : public SpanPages {
 public:
  WatchedPages(const math::Index3& dims, const RangeTable& table)
      : pages_(PagesOfTable(dims, table)) {}

  absl::StatusOr<std::shared_ptr<const std::string>> Load(std::int64_t page) override {
    loaded.insert(page);
    if (page == bad_page) {
      return absl::DataLossError("page 2 is damaged");
    }
    return pages_->Load(page);
  }
  [[nodiscard]] std::size_t size_bytes() const override { return 0; }

  std::multiset<std::int64_t> loaded;
  std::int64_t bad_page = -1;

 private:
  std::unique_ptr<SpanPages> pages_;
};

TEST(SpanOctreeTest, LoadsOnlyPagesThatMayHaveActiveBlocksEachOnce) {
  const math::Index3 dims{64, 16, 16};  // four pages
  RangeTable table(ScalarType::kUint16, math::Volume(dims));
  for (std::int64_t id = 0; id < table.block_count(); ++id) {
    const auto page = static_cast<double>(id % 64 / 16);
    table.Set(static_cast<BlockId>(id), {100 * page, 100 * page + 50});
  }
  const auto pages = std::make_shared<WatchedPages>(dims, table);
  const SpanOctree octree(dims, SpanOctree::OfTable(dims, table).page_spans(), pages);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(BlockTree active, octree.ActiveBlocks(InsideRule::OfIsovalue(130)));
  EXPECT_EQ(active.count(), 16 * 16 * 16);
  EXPECT_THAT(pages->loaded, UnorderedElementsAre(1));
  pages->loaded.clear();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(active, octree.ActiveBlocks(InsideRule::OfLabels({20, 310})));
  EXPECT_THAT(pages->loaded, UnorderedElementsAre(0, 3));
  pages->loaded.clear();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(active, octree.ActiveBlocks(InsideRule::OfIsovalue(80)));
  EXPECT_EQ(active.count(), 0);
  EXPECT_THAT(pages->loaded, IsEmpty());

  pages->bad_page = 2;
  EXPECT_THAT(octree.ActiveBlocks(InsideRule::OfIsovalue(230)),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("page 2")));
  ISOSCOPE_EXPECT_OK(octree.ActiveBlocks(InsideRule::OfIsovalue(130)));
}

TEST(SpanOctreeTest, KeepsLittleBesideItsPages) {
  const math::Index3 dims{160, 160, 160};
  const RangeTable table(ScalarType::kUint16, math::Volume(dims));
  const SpanOctree octree = SpanOctree::OfTable(dims, table);
  EXPECT_LT(octree.size_bytes() - table.bytes().size(), table.bytes().size() / 2000);
}

}  // namespace
}  // namespace isoscope::volume
