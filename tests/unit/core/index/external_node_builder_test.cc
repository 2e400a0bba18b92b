// The division of memory in an external build. interval_tree_builder_test.cc compares its output
// with the in-memory build.

#include "core/index/external_node_builder.h"

#include <cstdint>

#include "gtest/gtest.h"

#include "core/base/units.h"
#include "core/index/interval_tree_format.h"

namespace isoscope::index {
namespace {

TEST(MemoryPlanTest, PartsOfAPhaseFitTogether) {
  for (std::int64_t memory = 1; memory <= base::kGiB; memory += memory / 7 + 1) {
    const MemoryPlan plan(memory);
    EXPECT_LE(
        plan.sorter_bytes + (format::kMaxSlabs + 1) * plan.bucket_bytes + 2 * plan.sequence_bytes,
        memory);
  }
}

TEST(MemoryPlanTest, DealingWritesTheDocumentedStretches) {
  for (std::int64_t memory = 1; memory <= base::kGiB; memory += memory / 7 + 1) {
    EXPECT_GE(MemoryPlan(memory).bucket_bytes, memory / 512) << memory;
  }
}

TEST(MemoryPlanTest, MemoryThatWasAskedForHoldsItsIntervals) {
  const std::int64_t most = IntervalTreeBuilder::Options().memory_bytes / kBytesPerInterval;
  for (std::int64_t count = 1; count <= most; count += count / 7 + 1) {
    EXPECT_GE(MemoryPlan(IntervalTreeBuilder::MemoryBytes(count)).in_memory_count, count);
  }
  EXPECT_EQ(MemoryPlan(IntervalTreeBuilder::MemoryBytes(most + 1)).in_memory_count, most);
}

}  // namespace
}  // namespace isoscope::index
