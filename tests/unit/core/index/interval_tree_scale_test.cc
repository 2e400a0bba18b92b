// Trees that are too large to hold in memory twice, built in the stated memory:
//
// 1. Intervals are a function of their index (IntervalAt), so that no list of them is needed.
// 2. This file replaces operator new, and counts the allocated bytes while the tree is built.
// 3. Queries are compared with one scan of all intervals, and their page reads with the bound.

#include <malloc.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/index/interval_tree.h"
#include "core/index/interval_tree_builder.h"
#include "core/index/interval_tree_format.h"
#include "core/io/file.h"
#include "core/io/page_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace {

std::atomic<std::int64_t> allocated_bytes{0};
std::atomic<std::int64_t> peak_bytes{0};

void Count(std::int64_t bytes) {
  const std::int64_t now = allocated_bytes.fetch_add(bytes) + bytes;
  if (now > peak_bytes.load()) {
    peak_bytes.store(now);
  }
}

void* AllocateOrNull(std::size_t size) {
  void* memory = std::malloc(size);
  if (memory != nullptr) {
    Count(static_cast<std::int64_t>(malloc_usable_size(memory)));
  }
  return memory;
}

void* Allocate(std::size_t size) {
  void* memory = AllocateOrNull(size);
  if (memory == nullptr) {
    throw std::bad_alloc();
  }
  return memory;
}

void Free(void* memory) {
  if (memory != nullptr) {
    Count(-static_cast<std::int64_t>(malloc_usable_size(memory)));
    std::free(memory);
  }
}

}  // namespace

void* operator new(std::size_t size) { return Allocate(size); }
void* operator new[](std::size_t size) { return Allocate(size); }
// The standard library's temporary buffers come from these.
void* operator new(std::size_t size, const std::nothrow_t& /*tag*/) noexcept {
  return AllocateOrNull(size);
}
void* operator new[](std::size_t size, const std::nothrow_t& /*tag*/) noexcept {
  return AllocateOrNull(size);
}
void operator delete(void* memory) noexcept { Free(memory); }
void operator delete[](void* memory) noexcept { Free(memory); }
void operator delete(void* memory, std::size_t /*size*/) noexcept { Free(memory); }
void operator delete[](void* memory, std::size_t /*size*/) noexcept { Free(memory); }

namespace isoscope::index {
namespace {

using ::isoscope::testing::TempDir;

// The i-th interval, without a list of them. Short ones make the deepest tree; one in eight is
// longer, so that all kinds of lists are there.
BlockInterval IntervalAt(std::int64_t i, std::int64_t count) {
  const auto n = static_cast<std::uint64_t>(i);
  const double low = base::RandomUnit(3, 2 * n);
  const double length = std::pow(base::RandomUnit(3, 2 * n + 1), i % 8 == 0 ? 6 : 1);
  const double scale = i % 8 == 0 ? 0.1 : 1.0 / static_cast<double>(count);
  return {.span = {low, low + length * scale},
          .block_id = static_cast<volume::BlockId>(i),
          .ordinal = static_cast<std::uint32_t>(count - 1 - i)};
}

// The cost of building, beyond earlier allocations.
struct BuildCost {
  std::int64_t peak_bytes = 0;
};

absl::StatusOr<BuildCost> Build(const TempDir& dir, std::int64_t count, std::int64_t memory_bytes) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::CreateWritableFile(dir.Sub("tree")));
  const std::int64_t before = allocated_bytes.load();
  peak_bytes.store(before);
  IntervalTreeBuilder builder({.scratch_directory = dir.path(), .memory_bytes = memory_bytes});
  for (std::int64_t i = 0; i < count; ++i) {
    ISOSCOPE_RETURN_IF_ERROR(builder.Add(IntervalAt(i, count)));
  }
  ISOSCOPE_RETURN_IF_ERROR(builder.Finish(file.get()));
  return BuildCost{.peak_bytes = peak_bytes.load() - before};
}

// Nodes on the longest path below and with `page`.
int DepthOf(const io::PageFile& pages, io::PageNumber page) {
  io::PageReadCost cost;
  const auto node = pages.Read(page, &cost);
  EXPECT_TRUE(node.ok());
  if (!node.ok()) {
    return 0;
  }
  const char* payload = node->payload().data();
  int deepest = 0;
  for (std::int64_t slab = 0; slab < format::DecodeNodeHeader(payload).slab_count; ++slab) {
    const format::SlabRecord record =
        format::DecodeSlabRecord(payload + format::SlabRecordOffset(slab));
    if (record.child_page != 0) {
      deepest = std::max(deepest, DepthOf(pages, record.child_page));
    }
  }
  return deepest + 1;
}

TEST(IntervalTreeScaleTest, ThreeLevelsBuiltInTheStatedMemoryEqualAScanWithinTheBound) {
  // More than 126 * 126 * 170, less a few that are so short that they are empty.
  constexpr std::int64_t kCount = 3200000;
  const std::int64_t memory_bytes = IntervalTreeBuilder::Options().memory_bytes;
  const TempDir dir;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BuildCost cost, Build(dir, kCount, memory_bytes));
  EXPECT_LE(cost.peak_bytes, memory_bytes);
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto file, io::OpenRandomAccessFile(dir.Sub("tree")));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto pages, io::PageFile::Open(std::move(file), 0));
    EXPECT_EQ(DepthOf(*pages, 1), 3);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto file, io::OpenRandomAccessFile(dir.Sub("tree")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree,
                                IntervalTree::Open(std::move(file), 256 * base::kKiB));
  const std::int64_t stored_count = tree->interval_count();
  ASSERT_GT(stored_count, 2700000);
  // One scan of all intervals for all queries.
  std::vector<double> isovalues = {-1, 0, 1, 2};
  for (std::uint64_t i = 0; i < 12; ++i) {
    isovalues.push_back(base::RandomUnit(5, i) * 1.05);
    const BlockInterval interval = IntervalAt(static_cast<std::int64_t>(i * 200001), kCount);
    isovalues.push_back(interval.span.min);
    isovalues.push_back(interval.span.max);
  }
  std::vector<std::vector<BlockInterval>> expected(isovalues.size());
  for (std::int64_t i = kCount; i-- > 0;) {
    const BlockInterval interval = IntervalAt(i, kCount);
    for (std::size_t query = 0; query < isovalues.size(); ++query) {
      if (volume::IsActive(interval.span, isovalues[query])) {
        expected[query].push_back(interval);
      }
    }
  }
  std::int64_t most = 0;
  for (std::size_t query = 0; query < isovalues.size(); ++query) {
    const std::int64_t before = allocated_bytes.load();
    peak_bytes.store(before);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult result, tree->Query(isovalues[query]));
    EXPECT_TRUE(result.active == expected[query])
        << isovalues[query] << ": " << result.active.size() << " reported, "
        << expected[query].size() << " expected";
    const auto active_count = static_cast<std::int64_t>(result.active.size());
    most = std::max(most, active_count);
    EXPECT_LE(result.page_read_count, IntervalTree::MaxPageReads(stored_count, active_count));
    // 8 pages a level and two more; the answer, twice while it grows and is sorted.
    EXPECT_LE(result.page_read_count, 26 + 2 * active_count / 170);
    EXPECT_LE(peak_bytes.load() - before, 300 * base::kKiB + 100 * active_count);
  }
  EXPECT_GT(most, 3000);
}

TEST(IntervalTreeScaleTest, PeakOfAllocationsStaysUnderTheStatedMemory) {
  for (const std::int64_t memory_bytes : {256 * base::kKiB, base::kMiB, 4 * base::kMiB}) {
    const TempDir dir;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BuildCost cost, Build(dir, 200000, memory_bytes));
    EXPECT_LE(cost.peak_bytes, memory_bytes) << memory_bytes;
    // Not because the set is small.
    EXPECT_GT(cost.peak_bytes, memory_bytes / 2) << memory_bytes;
  }
}

}  // namespace
}  // namespace isoscope::index
