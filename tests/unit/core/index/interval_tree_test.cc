// Queries are compared with a scan of all intervals, and their cost with the stated bound:
//
// - sets of every shape (interval_sets.h) and of many sizes, up to trees of two levels;
// - the cache: repeated queries, none at all, threads that share a small one;
// - the documented bytes of a tree of one interval;
// - damage: truncations, flipped bytes, pages of other trees, cycles and long chains of nodes.

#include "core/index/interval_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/random.h"
#include "core/index/interval_tree_builder.h"
#include "core/index/interval_tree_format.h"
#include "core/io/page_file.h"
#include "tests/support/interval_tree.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/core/index/interval_sets.h"

namespace isoscope::index {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::MemoryReadFile;
using ::isoscope::testing::MemoryWriteFile;
using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::AnyOf;
using ::testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kGreatest = std::numeric_limits<double>::max();
constexpr std::int64_t kNoCache = 0;
constexpr std::int64_t kLargeCache = 64 << 20;

std::string Build(std::vector<BlockInterval> intervals) {
  std::string bytes;
  MemoryWriteFile file(&bytes);
  EXPECT_THAT(testing::BuildIntervalTree(std::move(intervals), &file), IsOk());
  EXPECT_TRUE(file.is_closed());
  return bytes;
}

absl::StatusOr<std::unique_ptr<IntervalTree>> OpenBytes(const std::string& bytes,
                                                        std::int64_t cache_bytes) {
  return IntervalTree::Open(std::make_unique<MemoryReadFile>(bytes), cache_bytes);
}

// Every endpoint, its neighbours, the points between endpoints, and both ends of the axis; every
// `stride`-th of them.
std::vector<double> QueryPoints(const std::vector<BlockInterval>& intervals, std::size_t stride) {
  std::vector<double> endpoints;
  for (const BlockInterval& interval : intervals) {
    endpoints.push_back(interval.span.min);
    endpoints.push_back(interval.span.max);
  }
  std::sort(endpoints.begin(), endpoints.end());
  endpoints.erase(std::unique(endpoints.begin(), endpoints.end()), endpoints.end());
  std::vector<double> points = {-kGreatest, kGreatest, 0.0, -0.0};
  for (std::size_t i = 0; i < endpoints.size(); i += stride) {
    const double endpoint = endpoints[i];
    points.push_back(endpoint);
    points.push_back(std::nextafter(endpoint, -kInfinity));
    points.push_back(std::nextafter(endpoint, kInfinity));
    points.push_back(endpoint / 2 + endpoints[std::min(i + 1, endpoints.size() - 1)] / 2);
  }
  points.erase(std::remove_if(points.begin(), points.end(),
                              [](double point) { return !std::isfinite(point); }),
               points.end());
  return points;
}

// Builds, then compares every query with a scan and its cost with the stated bounds.
void ExpectTreeEqualsScan(const std::vector<BlockInterval>& intervals, std::size_t stride) {
  const std::string bytes = Build(intervals);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(bytes, kLargeCache));
  const std::int64_t count = tree->interval_count();
  ASSERT_LE(count, static_cast<std::int64_t>(intervals.size()));
  // Space: docs/format/interval_tree.md.
  ASSERT_LE(static_cast<std::int64_t>(bytes.size() / io::kPageBytes),
            10 * count / format::kEntriesPerPage + 3);
  for (const double isovalue : QueryPoints(intervals, stride)) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult result, tree->Query(isovalue));
    ASSERT_TRUE(result.active == Scan(intervals, isovalue))
        << "isovalue " << isovalue << ", " << result.active.size() << " reported, "
        << Scan(intervals, isovalue).size() << " expected";
    ASSERT_LE(result.page_read_count,
              IntervalTree::MaxPageReads(count, static_cast<std::int64_t>(result.active.size())))
        << isovalue;
  }
}

TEST(IntervalTreeTest, EmptyTreeReportsNothingAndReadsNothing) {
  const std::string bytes = Build({});
  EXPECT_EQ(bytes.size(), io::kPageBytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(bytes, kNoCache));
  EXPECT_EQ(tree->interval_count(), 0);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult result, tree->Query(1.0));
  EXPECT_TRUE(result.active.empty());
  EXPECT_EQ(result.page_read_count, 0);
  EXPECT_EQ(result.read_bytes, 0);
}

TEST(IntervalTreeTest, IntervalIsOpenBelowAndClosedAbove) {
  const std::vector<BlockInterval> one = {{{2.0, 3.0}, 7, 4}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(Build(one), kNoCache));
  EXPECT_EQ(tree->interval_count(), 1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult at_min, tree->Query(2.0));
  EXPECT_TRUE(at_min.active.empty());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult at_max, tree->Query(3.0));
  EXPECT_EQ(at_max.active, one);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult above, tree->Query(std::nextafter(3.0, 4.0)));
  EXPECT_TRUE(above.active.empty());
}

TEST(IntervalTreeTest, NeverActiveIntervalsAreLeftOut) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<BlockInterval> intervals =
      Number({{1, 1}, {}, {nan, 2}, {1, nan}, {-0.0, 0.0}, {3, 2}, {1, 2}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(Build(intervals), kNoCache));
  EXPECT_EQ(tree->interval_count(), 1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult result, tree->Query(1.5));
  ASSERT_EQ(result.active.size(), 1u);
  EXPECT_EQ(result.active[0], intervals[6]);
}

TEST(IntervalTreeTest, NonFiniteIsovalueIsInvalidArgument) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(Build(Number({{1, 2}})), kNoCache));
  EXPECT_THAT(tree->Query(std::numeric_limits<double>::quiet_NaN()),
              StatusIs(absl::StatusCode::kInvalidArgument, _));
  EXPECT_THAT(tree->Query(kInfinity), StatusIs(absl::StatusCode::kInvalidArgument, _));
}

TEST(IntervalTreeTest, StatedBoundHasItsDocumentedValues) {
  EXPECT_EQ(IntervalTree::MaxPageReads(0, 0), 0);
  EXPECT_EQ(IntervalTree::MaxPageReads(1, 1), 2);
  EXPECT_EQ(IntervalTree::MaxPageReads(170, 170), 2);
  EXPECT_EQ(IntervalTree::MaxPageReads(171, 84), 10);
  EXPECT_EQ(IntervalTree::MaxPageReads(171, 85), 11);
  EXPECT_EQ(IntervalTree::MaxPageReads(10773, 0), 10);
  EXPECT_EQ(IntervalTree::MaxPageReads(10774, 0), 18);
  EXPECT_EQ(IntervalTree::MaxPageReads(1000000, 17000), 226);
  EXPECT_EQ(IntervalTree::MaxPageReads(std::int64_t{1} << 32, 0), 42);
}

class IntervalTreeShapeTest : public ::testing::TestWithParam<Shape> {};

TEST_P(IntervalTreeShapeTest, SmallSetsEqualScanWithinTheBound) {
  for (std::size_t count = 1; count <= 40; ++count) {
    ExpectTreeEqualsScan(MakeIntervals(GetParam(), count, count), 1);
    if (HasFatalFailure()) {
      FAIL() << count << " intervals";
    }
  }
}

TEST_P(IntervalTreeShapeTest, SetsAroundTheSizeOfAPageEqualScanWithinTheBound) {
  for (const std::size_t count : {169u, 170u, 171u, 172u, 255u, 340u, 341u, 509u, 512u}) {
    ExpectTreeEqualsScan(MakeIntervals(GetParam(), count, 1000 + count), 1 + count / 60);
    if (HasFatalFailure()) {
      FAIL() << count << " intervals";
    }
  }
}

TEST_P(IntervalTreeShapeTest, SetsOfManySizesEqualScanWithinTheBound) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    const auto count = static_cast<std::size_t>(base::RandomBits(77, seed) % 1500 + 1);
    ExpectTreeEqualsScan(MakeIntervals(GetParam(), count, seed), 1 + count / 8);
    if (HasFatalFailure()) {
      FAIL() << count << " intervals, seed " << seed;
    }
  }
}

TEST_P(IntervalTreeShapeTest, SetOfTwoLevelsEqualsScanWithinTheBound) {
  ExpectTreeEqualsScan(MakeIntervals(GetParam(), 40000, 5), 5000);
}

INSTANTIATE_TEST_SUITE_P(AllShapes, IntervalTreeShapeTest, ::testing::ValuesIn(kShapes),
                         [](const ::testing::TestParamInfo<Shape>& param) {
                           return std::string(kShapeNames[static_cast<int>(param.param)]);
                         });

TEST(IntervalTreeTest, SetsOf200000EqualScanWithinTheBound) {
  for (const Shape shape : {Shape::kUniform, Shape::kShort, Shape::kBytes, Shape::kStaircase}) {
    ExpectTreeEqualsScan(MakeIntervals(shape, 200000, 11), 40000);
  }
}

TEST(IntervalTreeTest, ResultIsAscendingByOrdinalOfAnyWidth) {
  std::vector<BlockInterval> intervals;
  for (std::uint32_t i = 0; i < 5000; ++i) {
    intervals.push_back({{0, 1}, i, static_cast<std::uint32_t>(base::RandomBits(4, i))});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(Build(intervals), kNoCache));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult result, tree->Query(0.5));
  EXPECT_EQ(result.active, Scan(intervals, 0.5));
}

TEST(IntervalTreeTest, DuplicatesAreReportedAsOftenAsTheyWereGiven) {
  const std::vector<BlockInterval> intervals(600, BlockInterval{{1, 4}, 9, 9});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(Build(intervals), kNoCache));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult result, tree->Query(2));
  EXPECT_EQ(result.active, intervals);
}

TEST(IntervalTreeTest, AnyInputOrderGivesTheSameBytes) {
  for (const Shape shape : kShapes) {
    std::vector<BlockInterval> intervals = MakeIntervals(shape, 3000, 8);
    const std::string bytes = Build(intervals);
    for (std::uint64_t round = 0; round < 3; ++round) {
      for (std::size_t i = intervals.size(); i > 1; --i) {
        std::swap(intervals[i - 1], intervals[base::RandomBits(round, i) % i]);
      }
      ASSERT_TRUE(Build(intervals) == bytes) << static_cast<int>(shape);
    }
  }
}

TEST(IntervalTreeTest, SignOfZeroDoesNotChangeTheBytes) {
  EXPECT_TRUE(Build(Number({{-0.0, 1}, {-1, -0.0}})) == Build(Number({{0.0, 1}, {-1, 0.0}})));
}

TEST(IntervalTreeTest, WithoutACacheEveryPageComesFromTheFile) {
  const std::string bytes = Build(MakeIntervals(Shape::kUniform, 5000, 2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(bytes, kNoCache));
  for (int round = 0; round < 2; ++round) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult result, tree->Query(0.3));
    EXPECT_GT(result.page_read_count, 0);
    EXPECT_EQ(result.read_bytes, result.page_read_count * 4096);
  }
}

TEST(IntervalTreeTest, RepeatedQueryIsServedFromTheCacheAndCountedTheSame) {
  const std::string bytes = Build(MakeIntervals(Shape::kUniform, 5000, 2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(bytes, kLargeCache));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult first, tree->Query(0.3));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult second, tree->Query(0.3));
  EXPECT_EQ(first.read_bytes, first.page_read_count * 4096);
  EXPECT_EQ(second.page_read_count, first.page_read_count);
  EXPECT_EQ(second.read_bytes, 0);
  EXPECT_EQ(second.active, first.active);
}

TEST(IntervalTreeTest, ThreadsThatShareASmallCacheGetTheRightAnswers) {
  const std::vector<BlockInterval> intervals = MakeIntervals(Shape::kUniform, 5000, 3);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree,
                                OpenBytes(Build(intervals), std::int64_t{4} * 4096));
  std::vector<std::thread> threads;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    threads.emplace_back([&tree, &intervals, seed] {
      for (std::uint64_t i = 0; i < 50; ++i) {
        const double isovalue = base::RandomUnit(seed, i);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const QueryResult result, tree->Query(isovalue));
        ASSERT_TRUE(result.active == Scan(intervals, isovalue)) << isovalue;
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

// The bytes of docs/format/interval_tree.md, for a tree of one interval.
TEST(IntervalTreeFormatTest, TreeOfOneIntervalHasItsDocumentedBytes) {
  const std::string bytes = Build({{{2.0, 3.0}, 0x0a0b0c0d, 0x01020304}});
  ASSERT_EQ(bytes.size(), 3u * 4096);
  const std::string header(
      "ISOTREE1"
      "\x01\0\0\0"          // version
      "\0\x10\0\0"          // page size
      "\x01\0\0\0\0\0\0\0"  // interval count
      "\x03\0\0\0"          // page count
      "\x01\0\0\0"          // root page
      "\x18\0\0\0"          // entry size
      "\x7e\0\0\0",         // greatest number of slabs
      40);
  EXPECT_EQ(bytes.substr(0, 40), header);
  EXPECT_EQ(bytes.substr(40, 4044), std::string(4044, '\0'));

  const std::string node(
      "\x01\0\x01\0"              // kind, slab count
      "\0\0\0\0\0\0\0\0\0\0\0\0"  // ends of left, right and window lists
      "\x01\0\0\0",               // end of the leaf lists
      20);
  const std::string slab(
      "\0\0\0\0\0\0\xf0\xff"       // -infinity
      "\0\0\0\0\0\0\0\0\0\0\0\0"   // begins of its left, right and leaf list
      "\0\0\0\0\0\0\0\0\0\0\0\0",  // window list, child node
      32);
  EXPECT_EQ(bytes.substr(4096, 52 + 32), node + std::string(32, '\0') + slab);

  const std::string entry(
      "\0\0\0\0\0\0\0\x40"
      "\0\0\0\0\0\0\x08\x40"
      "\x0d\x0c\x0b\x0a\x04\x03\x02\x01",
      24);
  EXPECT_EQ(bytes.substr(8192, 28), std::string("\x02\0\x01\0", 4) + entry);

  for (std::size_t page = 0; page < 3; ++page) {
    const char* end = bytes.data() + 4096 * (page + 1);
    EXPECT_EQ(base::LoadLittleEndian<std::uint32_t>(end - 12), base::Crc32c(entry));
    EXPECT_EQ(base::LoadLittleEndian<std::uint32_t>(end - 8), page);
  }
}

TEST(IntervalTreeHostileTest, EveryTruncationFailsOpen) {
  const std::string bytes = Build(MakeIntervals(Shape::kUniform, 200, 6));
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    ASSERT_THAT(OpenBytes(bytes.substr(0, size), kNoCache),
                StatusIs(absl::StatusCode::kDataLoss, _))
        << size;
  }
  EXPECT_THAT(OpenBytes(bytes + std::string(4096, '\0'), kNoCache),
              StatusIs(absl::StatusCode::kDataLoss, _));
}

TEST(IntervalTreeHostileTest, EveryFlippedByteIsDataLossOrARightAnswer) {
  const std::vector<BlockInterval> intervals = MakeIntervals(Shape::kUniform, 200, 6);
  const std::string bytes = Build(intervals);
  const std::vector<double> isovalues = {0.02, 0.3, 0.5, 0.7, 0.98};
  std::vector<std::vector<BlockInterval>> expected;
  expected.reserve(isovalues.size());
  for (const double isovalue : isovalues) {
    expected.push_back(Scan(intervals, isovalue));
  }
  std::vector<int> noticed(bytes.size() / 4096, 0);
  for (std::size_t offset = 0; offset < bytes.size(); ++offset) {
    std::string damaged = bytes;
    damaged[offset] = static_cast<char>(damaged[offset] ^ (1 << (offset % 8)));
    const auto tree = OpenBytes(damaged, kNoCache);
    bool is_noticed = !tree.ok();
    if (!tree.ok()) {
      ASSERT_THAT(tree, StatusIs(absl::StatusCode::kDataLoss, HasSubstr("page 0")));
    }
    for (std::size_t i = 0; tree.ok() && i < isovalues.size(); ++i) {
      const auto result = (*tree)->Query(isovalues[i]);
      if (result.ok()) {
        ASSERT_TRUE(result->active == expected[i]) << offset;
      } else {
        is_noticed = true;
        ASSERT_THAT(result, StatusIs(absl::StatusCode::kDataLoss,
                                     HasSubstr("page " + std::to_string(offset / 4096))));
      }
    }
    noticed[offset / 4096] += is_noticed ? 1 : 0;
  }
  // The five queries read every page, so no flip goes unseen.
  EXPECT_THAT(noticed, ::testing::Each(4096));
}

TEST(IntervalTreeHostileTest, PageOfAnotherTreeIsNoticed) {
  const std::string bytes = Build(MakeIntervals(Shape::kUniform, 100, 1));
  const std::string other = Build(MakeIntervals(Shape::kUniform, 100, 2));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree,
                                OpenBytes(bytes.substr(0, 8192) + other.substr(8192), kNoCache));
  EXPECT_THAT(tree->Query(0.5), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("page 2")));
}

// Makes a page's checksum right again.
void Seal(std::string* bytes, std::size_t page) {
  char* begin = &(*bytes)[page * 4096];
  base::StoreLittleEndian(base::ExtendCrc32c(0, begin, 4092), begin + 4092);
}

TEST(IntervalTreeHostileTest, DamageWithRightChecksumsNeverReportsAnInactiveInterval) {
  const std::string bytes = Build(MakeIntervals(Shape::kBytes, 600, 6));
  const std::size_t page_count = bytes.size() / 4096;
  int refused = 0;
  for (std::uint64_t round = 0; round < 20000; ++round) {
    std::string damaged = bytes;
    for (std::uint64_t change = 0; change < 1 + round % 3; ++change) {
      const std::uint64_t bits = base::RandomBits(round, change);
      // Mostly in the header and the node, where lengths and positions are.
      const std::size_t page = (bits & 7) == 0 ? (bits >> 8) % page_count : (bits >> 8) % 2;
      const std::size_t offset = (bits >> 24) % ((bits & 8) == 0 ? 320 : 4084);
      damaged[page * 4096 + offset] = static_cast<char>(bits >> 56);
      Seal(&damaged, page);
    }
    const auto tree = OpenBytes(damaged, kNoCache);
    if (!tree.ok()) {
      ++refused;
      ASSERT_THAT(tree, AnyOf(StatusIs(absl::StatusCode::kDataLoss, _),
                              StatusIs(absl::StatusCode::kFailedPrecondition, _)));
      continue;
    }
    for (const double isovalue : {1.0, 100.0, 254.5}) {
      const auto result = (*tree)->Query(isovalue);
      if (!result.ok()) {
        ++refused;
        ASSERT_THAT(result, StatusIs(absl::StatusCode::kDataLoss, _));
        continue;
      }
      for (const BlockInterval& interval : result->active) {
        ASSERT_TRUE(volume::IsActive(interval.span, isovalue));
      }
    }
  }
  EXPECT_GT(refused, 1000);
}

TEST(IntervalTreeHostileTest, HeaderFieldsAreChecked) {
  const std::string bytes = Build(MakeIntervals(Shape::kUniform, 10, 1));
  const auto with = [&bytes](std::size_t offset, char value) {
    std::string changed = bytes;
    changed[offset] = value;
    Seal(&changed, 0);
    return OpenBytes(changed, kNoCache);
  };
  EXPECT_THAT(with(0, 'X'), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("ISOTREE1")));
  EXPECT_THAT(with(8, 2), StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("version 2")));
  EXPECT_THAT(with(12, 1), StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_THAT(with(16, 0), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("impossible")));
  EXPECT_THAT(with(23, 1), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("impossible")));
  EXPECT_THAT(with(24, 2), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("header says 2")));
  EXPECT_THAT(with(28, 0), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("impossible")));
  EXPECT_THAT(with(28, 3), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("impossible")));
  EXPECT_THAT(with(32, 20), StatusIs(absl::StatusCode::kDataLoss, _));
  EXPECT_THAT(with(36, 64), StatusIs(absl::StatusCode::kDataLoss, _));
}

// A file of nodes without entries; `child_of` gives each page's child.
template <typename ChildOf>
std::string MakeChain(io::PageNumber node_count, ChildOf child_of) {
  std::string bytes;
  MemoryWriteFile file(&bytes);
  io::PageFileWriter pages(&file, 0);
  std::string header(format::kHeaderBytes, '\0');
  format::EncodeHeader({.interval_count = 1, .page_count = node_count + 1, .root_page = 1},
                       header.data());
  EXPECT_THAT(pages.Append(header), IsOk());
  for (io::PageNumber page = 1; page <= node_count; ++page) {
    std::string node(format::SlabRecordOffset(1), '\0');
    format::EncodeNodeHeader({.slab_count = 1}, node.data());
    format::EncodeSlabRecord({.lower = -kInfinity, .child_page = child_of(page)},
                             &node[format::SlabRecordOffset(0)]);
    EXPECT_THAT(pages.Append(node), IsOk());
  }
  return bytes;
}

TEST(IntervalTreeHostileTest, ChainOfNodesEndsAtTheLimitOfLevels) {
  const std::string bytes = MakeChain(20, [](io::PageNumber page) { return page + 1; });
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(bytes, kNoCache));
  EXPECT_THAT(tree->Query(0), StatusIs(absl::StatusCode::kDataLoss,
                                       HasSubstr("page 9 (offset 36864): is a node below 8")));
}

TEST(IntervalTreeHostileTest, CycleOfNodesIsRefused) {
  for (const io::PageNumber target : {1u, 2u}) {
    const std::string bytes =
        MakeChain(2, [target](io::PageNumber page) { return page == 1 ? 2u : target; });
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto tree, OpenBytes(bytes, kNoCache));
    EXPECT_THAT(tree->Query(0), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("in this order")));
  }
}

TEST(IntervalTreeHostileTest, EveryFailedWriteFailsTheBuild) {
  const std::vector<BlockInterval> intervals = MakeIntervals(Shape::kUniform, 400, 1);
  std::string bytes;
  MemoryWriteFile complete(&bytes);
  ISOSCOPE_ASSERT_OK(testing::BuildIntervalTree(intervals, &complete));
  for (std::int64_t failing = 0; failing < complete.operation_count(); ++failing) {
    std::string cut;
    MemoryWriteFile file(&cut, failing);
    EXPECT_THAT(testing::BuildIntervalTree(intervals, &file),
                StatusIs(absl::StatusCode::kResourceExhausted, _));
    EXPECT_FALSE(file.is_closed());
    // The header is written last: until then the file is no tree.
    if (failing < complete.operation_count() - 1) {
      EXPECT_THAT(OpenBytes(cut, kNoCache), StatusIs(absl::StatusCode::kDataLoss, _));
    }
  }
}

}  // namespace
}  // namespace isoscope::index
