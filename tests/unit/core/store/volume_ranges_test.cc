#include "core/store/volume_ranges.h"

#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "core/volume/scalar_span.h"
#include "tests/support/status_matchers.h"

namespace isoscope::store {
namespace {

constexpr math::Index3 kDims{10, 10, 5};

volume::RangeTable MakeTable(std::uint64_t seed, std::int64_t block_count = 500) {
  volume::RangeTable table(volume::ScalarType::kUint8, block_count);
  for (std::int64_t id = 0; id < block_count; ++id) {
    const double low = std::floor(200 * base::RandomUnit(seed, static_cast<std::uint64_t>(id)));
    table.Set(static_cast<volume::BlockId>(id), {low, low + 40});
  }
  return table;
}

TEST(VolumeRangesTest, ShardsOfOneVolumeShareATableAndThoseOfAnotherDoNot) {
  const auto a = VolumeRanges::Share(kDims, MakeTable(1));
  const auto again = VolumeRanges::Share(kDims, MakeTable(1));
  const auto other = VolumeRanges::Share(kDims, MakeTable(2));
  EXPECT_EQ(a, again);
  EXPECT_NE(a, other);
  EXPECT_EQ(other->table().bytes(), MakeTable(2).bytes());
}

TEST(VolumeRangesTest, ATableGoesWithItsLastShard) {
  auto ranges = VolumeRanges::Share(kDims, MakeTable(3));
  const std::weak_ptr<VolumeRanges> weak = ranges;
  ranges.reset();
  EXPECT_TRUE(weak.expired());
  EXPECT_EQ(VolumeRanges::Share(kDims, MakeTable(3))->table().bytes(), MakeTable(3).bytes());
}

TEST(VolumeRangesTest, ActiveBlocksAreThoseOfTheTableAlsoAfterManyIsovalues) {
  VolumeRanges ranges(kDims, MakeTable(4));
  for (int round = 0; round < 2; ++round) {
    for (int isovalue = 0; isovalue < 3 * static_cast<int>(VolumeRanges::kMaxSets); ++isovalue) {
      EXPECT_EQ(*ranges.ActiveBlocks({.isovalue = 5.0 * isovalue}),
                ranges.table().ActiveBlocks(5.0 * isovalue))
          << "isovalue " << 5 * isovalue;
    }
  }
}

TEST(VolumeRangesTest, SetsOfLabelsAndOfIsovaluesAreToldApart) {
  VolumeRanges ranges(kDims, MakeTable(7));
  for (const double value : {0.0, 20.0, 60.0, 100.0}) {
    const auto labels = volume::InsideRule::OfLabels({value});
    const auto more = volume::InsideRule::OfLabels({value, value + 5});
    for (int round = 0; round < 2; ++round) {
      EXPECT_EQ(*ranges.ActiveBlocks({.isovalue = value}), ranges.table().ActiveBlocks(value));
      EXPECT_EQ(*ranges.ActiveBlocks(labels), ranges.table().ActiveBlocks(labels));
      EXPECT_EQ(*ranges.ActiveBlocks(more), ranges.table().ActiveBlocks(more));
    }
  }
}

TEST(VolumeRangesTest, TreesHaveTheBlocksOfTheSets) {
  VolumeRanges ranges(kDims, MakeTable(8));
  for (int round = 0; round < 2; ++round) {
    for (const double value : {0.0, 20.0, 60.0, 100.0, 500.0}) {
      for (const auto& rule :
           {volume::InsideRule::OfIsovalue(value), volume::InsideRule::OfLabels({value, 30})}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto active, ranges.ActiveTree(rule));
        EXPECT_EQ(active->ToSet(), ranges.table().ActiveBlocks(rule)) << rule.Text();
      }
    }
  }
}

TEST(VolumeRangesTest, OnlyLargeVolumesTakeMoreLater) {
  const std::size_t before = VolumeRanges::LaterBytes();
  const auto small = VolumeRanges::Share(kDims, MakeTable(11));
  EXPECT_EQ(VolumeRanges::LaterBytes(), before);
  constexpr math::Index3 kLarge{256, 256, 65};
  auto large = VolumeRanges::Share(
      kLarge, volume::RangeTable(volume::ScalarType::kUint8, math::Volume(kLarge)));
  EXPECT_EQ(VolumeRanges::LaterBytes(), before + VolumeRanges::kMaxTreeBytes);
  large.reset();
  EXPECT_EQ(VolumeRanges::LaterBytes(), before);
}

TEST(VolumeRangesTest, ATableOfOtherDimensionsIsAnother) {
  const auto a = VolumeRanges::Share(kDims, MakeTable(1));
  EXPECT_NE(a, VolumeRanges::Share({5, 10, 10}, MakeTable(1)));
}

TEST(VolumeRangesTest, OneSetServesAllWhoAskAgain) {
  VolumeRanges ranges(kDims, MakeTable(5));
  EXPECT_EQ(*ranges.ActiveTree({.isovalue = 60}), *ranges.ActiveTree({.isovalue = 60}));
  EXPECT_EQ(ranges.ActiveBlocks({.isovalue = 60}), ranges.ActiveBlocks({.isovalue = 60}));
}

// The ranges of a file, here of a table in memory.
std::shared_ptr<VolumeRanges> InFile(const std::string& key, const volume::RangeTable& table,
                                     int* load_count, bool is_readable = true) {
  return VolumeRanges::Share(
      key, volume::SpanOctree::OfTable(kDims, table),
      [&table, load_count, is_readable]() -> absl::StatusOr<volume::RangeTable> {
        ++*load_count;
        if (!is_readable) {
          return absl::DataLossError("ranges.bin: damaged");
        }
        return table;
      });
}

TEST(VolumeRangesTest, TheTableOfAFileIsReadOnceAndOnlyIfItIsAskedFor) {
  const volume::RangeTable table = MakeTable(9);
  int load_count = 0;
  const auto ranges = InFile("a", table, &load_count);
  EXPECT_EQ(ranges, InFile("a", table, &load_count));
  EXPECT_NE(ranges, InFile("b", table, &load_count));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto active, ranges->ActiveTree({.isovalue = 60}));
  EXPECT_EQ(active->ToSet(), table.ActiveBlocks(60));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::ScalarSpan span, ranges->SpanOf(77));
  EXPECT_EQ(span, table.Get(77));
  volume::BlockSpans spans = ranges->Spans();
  EXPECT_EQ(spans.Get(77), table.Get(77));
  EXPECT_EQ(load_count, 0);
  EXPECT_EQ(ranges->table(), table);
  EXPECT_EQ(*ranges->ActiveBlocks({.isovalue = 60}), table.ActiveBlocks(60));
  EXPECT_EQ(load_count, 1);
}

TEST(VolumeRangesTest, ATableThatCantBeReadLeavesNoBlockOut) {
  const volume::RangeTable table = MakeTable(9);
  int load_count = 0;
  const auto ranges = InFile("unreadable", table, &load_count, /*is_readable=*/false);
  for (volume::BlockId id = 0; id < 500; ++id) {
    EXPECT_EQ(ranges->table().Get(id), (volume::ScalarSpan{0, 255}));
  }
  EXPECT_EQ(load_count, 1);
}

TEST(VolumeRangesTest, ManyThreadsGetTheSameSets) {
  VolumeRanges ranges(kDims, MakeTable(6));
  std::vector<std::thread> threads;
  for (int t = 0; t < 16; ++t) {
    threads.emplace_back([&ranges, t] {
      for (int i = 0; i < 200; ++i) {
        const double isovalue = (i * 7 + t) % 23 * 10;
        EXPECT_EQ(*ranges.ActiveBlocks({.isovalue = isovalue}),
                  ranges.table().ActiveBlocks(isovalue));
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

}  // namespace
}  // namespace isoscope::store
