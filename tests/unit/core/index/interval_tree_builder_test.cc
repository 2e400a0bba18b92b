// A tree that is built in scratch files must have the bytes of the in-memory build:
//
// - around every boundary: sizes of pages, sorters, slabs and levels;
// - for any memory, order of input and sign of zero;
// - and a build that fails, at any write or cancellation, must leave no file that opens.

#include "core/index/interval_tree_builder.h"

#include <algorithm>
#include <csignal>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/resource.h>

#include "core/base/cancellation.h"
#include "core/index/interval_tree_format.h"
#include "core/io/file.h"
#include "tests/support/interval_tree.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/index/interval_sets.h"

namespace isoscope::index {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::MemoryReadFile;
using ::isoscope::testing::MemoryWriteFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;
using ::testing::AnyOf;

// The least that matters: nodes of more than 170 intervals are built in scratch files, sorters hold
// 453 intervals and merge two runs at a time.
constexpr std::int64_t kLeastMemory = 170 * 128;

std::string BuildInMemory(const std::vector<BlockInterval>& intervals) {
  std::string bytes;
  MemoryWriteFile file(&bytes);
  EXPECT_THAT(testing::BuildIntervalTree(intervals, &file), IsOk());
  return bytes;
}

absl::Status BuildExternally(const std::vector<BlockInterval>& intervals,
                             const IntervalTreeBuilder::Options& options, io::WritableFile* file) {
  IntervalTreeBuilder builder(options);
  for (const BlockInterval& interval : intervals) {
    const absl::Status added = builder.Add(interval);
    if (!added.ok()) {
      return added;
    }
  }
  return builder.Finish(file);
}

class IntervalTreeBuilderTest : public ::testing::Test {
 protected:
  [[nodiscard]] IntervalTreeBuilder::Options Options(std::int64_t memory_bytes) const {
    return {.scratch_directory = dir_.path(), .memory_bytes = memory_bytes};
  }
  std::string Build(const std::vector<BlockInterval>& intervals, std::int64_t memory_bytes) {
    std::string bytes;
    MemoryWriteFile file(&bytes);
    EXPECT_THAT(BuildExternally(intervals, Options(memory_bytes), &file), IsOk());
    EXPECT_TRUE(file.is_closed());
    ExpectNothingLeft();
    return bytes;
  }
  void ExpectNothingLeft() { EXPECT_TRUE(std::filesystem::is_empty(dir_.path())); }

  TempDir dir_;
};

class IntervalTreeBuilderShapeTest : public IntervalTreeBuilderTest,
                                     public ::testing::WithParamInterface<Shape> {};

TEST_P(IntervalTreeBuilderShapeTest, BytesAreThoseOfTheInMemoryBuildAroundEveryBoundary) {
  // A page of entries; two slabs; what a sorter holds, once, twice and three times (one more
  // merge); the most slabs; one more level.
  for (const std::size_t boundary :
       {std::size_t{1}, std::size_t{170}, std::size_t{340}, std::size_t{453}, std::size_t{906},
        std::size_t{1359}, std::size_t{10710}, std::size_t{10773}}) {
    const bool is_slow = boundary > 10000;  // a hundred children, with scratch files each
    if (is_slow && GetParam() != Shape::kUniform && GetParam() != Shape::kShort) {
      continue;
    }
    for (const std::size_t count : {boundary - 1, boundary, boundary + 1}) {
      const std::vector<BlockInterval> intervals = MakeIntervals(GetParam(), count, count);
      ASSERT_TRUE(Build(intervals, kLeastMemory) == BuildInMemory(intervals)) << count;
    }
  }
}

TEST_P(IntervalTreeBuilderShapeTest, BytesDoNotDependOnTheMemory) {
  const std::vector<BlockInterval> intervals = MakeIntervals(GetParam(), 12000, 6);
  const std::string expected = BuildInMemory(intervals);
  // External at the root only, with one merge or more, and near the size that fits into memory.
  for (const std::int64_t memory :
       {std::int64_t{1} << 16, std::int64_t{1} << 17, std::int64_t{1} << 20,
        std::int64_t{128} * 11999, std::int64_t{128} * 12000}) {
    ASSERT_TRUE(Build(intervals, memory) == expected) << memory;
  }
  // Less than a single record.
  const std::vector<BlockInterval> few = MakeIntervals(GetParam(), 200, 6);
  ASSERT_TRUE(Build(few, 1) == BuildInMemory(few));
}

INSTANTIATE_TEST_SUITE_P(AllShapes, IntervalTreeBuilderShapeTest, ::testing::ValuesIn(kShapes),
                         [](const ::testing::TestParamInfo<Shape>& param) {
                           return std::string(kShapeNames[static_cast<int>(param.param)]);
                         });

TEST_F(IntervalTreeBuilderTest, AnyInputOrderAndSignOfZeroGiveTheSameBytes) {
  std::vector<BlockInterval> intervals = MakeIntervals(Shape::kUniform, 3000, 8);
  intervals.push_back({{-0.0, 1}, 1, 1});
  intervals.push_back({{-1, -0.0}, 2, 2});
  const std::string bytes = Build(intervals, kLeastMemory);
  std::reverse(intervals.begin(), intervals.end());
  intervals[1].span.min = 0.0;
  intervals[0].span.max = 0.0;
  EXPECT_TRUE(Build(intervals, kLeastMemory) == bytes);
}

TEST_F(IntervalTreeBuilderTest, SmallSetsNeedNoScratchFile) {
  std::string bytes;
  MemoryWriteFile file(&bytes);
  ISOSCOPE_EXPECT_OK(BuildExternally(
      MakeIntervals(Shape::kUniform, 170, 1),
      {.scratch_directory = dir_.Sub("absent"), .memory_bytes = kLeastMemory}, &file));
  EXPECT_THAT(BuildExternally(
                  MakeIntervals(Shape::kUniform, 171, 1),
                  {.scratch_directory = dir_.Sub("absent"), .memory_bytes = kLeastMemory}, &file),
              StatusIs(absl::StatusCode::kNotFound, _));
}

TEST_F(IntervalTreeBuilderTest, EveryFailedWriteOfTheTreeFailsTheBuild) {
  const std::vector<BlockInterval> intervals = MakeIntervals(Shape::kUniform, 1000, 1);
  std::string bytes;
  MemoryWriteFile complete(&bytes);
  ISOSCOPE_ASSERT_OK(BuildExternally(intervals, Options(kLeastMemory), &complete));
  for (std::int64_t failing = 0; failing < complete.operation_count(); ++failing) {
    std::string cut;
    MemoryWriteFile file(&cut, failing);
    EXPECT_THAT(BuildExternally(intervals, Options(kLeastMemory), &file),
                StatusIs(absl::StatusCode::kResourceExhausted, _));
    EXPECT_FALSE(file.is_closed());
    ExpectNothingLeft();
    if (failing < complete.operation_count() - 1) {
      EXPECT_FALSE(IntervalTree::Open(std::make_unique<MemoryReadFile>(cut), 0).ok());
    }
  }
}

// Limits the size of files: a write across the limit is short, and the next one fails, as on a full
// disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    old_handler_ = std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit small = before_;
    small.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &small);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, old_handler_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

 private:
  rlimit before_{};
  void (*old_handler_)(int) = nullptr;
};

TEST_F(IntervalTreeBuilderTest, FullDiskWhileSpoolingIsReportedAndLeavesNothing) {
  // Long ones: the window lists are the largest scratch file.
  const std::vector<BlockInterval> intervals = MakeIntervals(Shape::kLong, 3000, 4);
  const std::string expected = BuildInMemory(intervals);
  int failure_count = 0;
  bool has_succeeded = false;
  for (rlim_t limit = 0; !has_succeeded; limit += 1237) {
    ASSERT_LT(limit, rlim_t{3000 * 24 * 6});
    std::string bytes;
    MemoryWriteFile file(&bytes);
    absl::Status status;
    {
      const FileSizeLimit small(limit);
      status = BuildExternally(intervals, Options(kLeastMemory), &file);
    }
    has_succeeded = status.ok();
    ExpectNothingLeft();
    if (has_succeeded) {
      EXPECT_TRUE(bytes == expected);
    } else {
      ++failure_count;
      EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, _));
      EXPECT_FALSE(IntervalTree::Open(std::make_unique<MemoryReadFile>(bytes), 0).ok());
    }
  }
  EXPECT_GT(failure_count, 20);
}

// Cancels when the tree's n-th page is written.
class CancellingFile : public io::WritableFile {
 public:
  CancellingFile(io::WritableFile* file, base::Cancellation* cancellation, int at)
      : file_(file), cancellation_(cancellation), left_(at) {}

  [[nodiscard]] absl::Status Append(absl::string_view bytes) override {
    if (left_-- == 0) {
      cancellation_->Cancel();
    }
    return file_->Append(bytes);
  }
  [[nodiscard]] absl::Status WriteAt(std::int64_t offset, absl::string_view bytes) override {
    return file_->WriteAt(offset, bytes);
  }
  [[nodiscard]] absl::Status Close() override { return file_->Close(); }
  [[nodiscard]] std::int64_t size_bytes() const override { return file_->size_bytes(); }

 private:
  io::WritableFile* file_;
  base::Cancellation* cancellation_;
  int left_;
};

TEST_F(IntervalTreeBuilderTest, CancellationAtAnyTimeLeavesNothingThatOpens) {
  const std::vector<BlockInterval> intervals = MakeIntervals(Shape::kUniform, 20000, 4);
  for (const int at : {-1, 0, 1, 50, 200}) {
    base::Cancellation cancellation;
    if (at < 0) {
      cancellation.Cancel();
    }
    std::string bytes;
    MemoryWriteFile memory_file(&bytes);
    CancellingFile file(&memory_file, &cancellation, at);
    IntervalTreeBuilder::Options options = Options(kLeastMemory);
    options.cancellation = &cancellation;
    EXPECT_THAT(BuildExternally(intervals, options, &file),
                StatusIs(absl::StatusCode::kCancelled, _))
        << at;
    EXPECT_FALSE(memory_file.is_closed());
    EXPECT_FALSE(IntervalTree::Open(std::make_unique<MemoryReadFile>(bytes), 0).ok());
    ExpectNothingLeft();
  }
}

TEST_F(IntervalTreeBuilderTest, MemoryThatIsAskedForIsStatedAndBounded) {
  EXPECT_EQ(IntervalTreeBuilder::MemoryBytes(1000), 128000);
  EXPECT_EQ(IntervalTreeBuilder::MemoryBytes(std::int64_t{1} << 29), 24 << 20);
}

}  // namespace
}  // namespace isoscope::index
