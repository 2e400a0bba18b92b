#include "core/extract/block_shape.h"

#include <cstdint>
#include <set>
#include <thread>
#include <vector>

#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::extract {
namespace {

void ExpectEqual(const BlockShape& a, const BlockShape& b) {
  EXPECT_EQ(a.stored_dims, b.stored_dims);
  EXPECT_EQ(a.row, b.row);
  EXPECT_EQ(a.slice, b.slice);
  EXPECT_EQ(a.sample_count, b.sample_count);
  EXPECT_EQ(a.touches_border, b.touches_border);
  EXPECT_EQ(a.edges, b.edges);
  EXPECT_EQ(a.owned_edges, b.owned_edges);
  EXPECT_EQ(a.cells, b.cells);
  EXPECT_EQ(a.interior, b.interior);
  EXPECT_EQ(a.first_interior, b.first_interior);
  EXPECT_EQ(a.lane_offsets, b.lane_offsets);
}

TEST(BlockShapesTest, EveryBlockHasItsOwnShapeAndInnerOnesShareIt) {
  for (const math::Index3& samples :
       {math::Index3{24, 17, 30}, math::Index3{9, 33, 8}, math::Index3{2, 2, 41}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::BlockLayout layout,
                                  volume::BlockLayout::Make(samples, {5, 8, 4}));
    const BlockShapes shapes(layout);
    std::set<const BlockShape*> known;
    for (std::int64_t id = 0; id < layout.block_count(); ++id) {
      SCOPED_TRACE(id);
      const BlockShape& shape = shapes.Of(static_cast<volume::BlockId>(id));
      ExpectEqual(shape, MakeBlockShape(layout, static_cast<volume::BlockId>(id)));
      known.insert(&shape);
    }
    EXPECT_LE(known.size(), 27U);
  }
}

TEST(BlockShapesTest, ThreadsThatAskAtOnceGetOneShape) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::BlockLayout layout,
                                volume::BlockLayout::Make({100, 100, 100}, {16, 16, 16}));
  const BlockShapes shapes(layout);
  std::vector<const BlockShape*> found(8);
  std::vector<std::thread> threads;
  threads.reserve(found.size());
  for (const BlockShape*& shape : found) {
    threads.emplace_back([&] { shape = &shapes.Of(57); });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  ExpectEqual(*found[0], MakeBlockShape(layout, 57));
  EXPECT_EQ(std::set<const BlockShape*>(found.begin(), found.end()).size(), 1U);
}

}  // namespace
}  // namespace isoscope::extract
