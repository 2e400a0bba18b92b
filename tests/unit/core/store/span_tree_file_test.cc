// A span_tree.bin must give the blocks and spans of the ranges.bin that it was made of, to a shard,
// too. Every damaged byte is noticed: of the head at opening, of a page when it is read.

#include "core/store/span_tree_file.h"

#include <cstdint>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/crc32c.h"
#include "core/io/file.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "core/store/shard_writer.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

class SpanTreeFileTest : public ::testing::Test {
 protected:
  SpanTreeFileTest() {
    for (std::int64_t id = 0; id < table_.block_count(); ++id) {
      const auto value = static_cast<double>(id * 7 % 1000);
      if (id % 11 != 0) {
        table_.Set(static_cast<volume::BlockId>(id), {value, value + static_cast<double>(id % 5)});
      }
    }
    const std::string bytes = EncodeRangeTable(table_);
    manifest_.range_table_crc32c = base::Crc32c(bytes);
    ISOSCOPE_EXPECT_OK(io::WriteWholeFile(PathIn(directory_, kRangeTableFileName), bytes));
  }

  static Manifest MakeManifest() {
    Manifest manifest;
    manifest.scalar_type = volume::ScalarType::kUint16;
    manifest.geometry.sample_dims = {41, 35, 69};
    manifest.block_cells = {1, 2, 2};
    return manifest;
  }
  [[nodiscard]] volume::BlockLayout LayoutOf() const {
    return *volume::BlockLayout::Make(manifest_.geometry.sample_dims, manifest_.block_cells);
  }
  [[nodiscard]] std::string path() const { return PathIn(directory_, kSpanTreeFileName); }
  absl::Status Write() { return WriteSpanTree(directory_, manifest_, LayoutOf()); }
  absl::StatusOr<volume::SpanOctree> Open() {
    return OpenSpanTree(directory_, manifest_, LayoutOf(), io::OpenRandomAccessFile);
  }
  void FlipBit(std::int64_t offset) {
    std::fstream file(path(), std::ios::in | std::ios::out | std::ios::binary);
    file.seekg(offset);
    const int byte = file.get();
    ASSERT_GE(byte, 0);
    file.seekp(offset);
    file.put(static_cast<char>(byte ^ 16));
  }

  isoscope::testing::TempDir temp_;
  const std::string directory_ = temp_.path();
  Manifest manifest_ = MakeManifest();
  const math::Index3 dims_ = LayoutOf().block_dims();
  volume::RangeTable table_{manifest_.scalar_type, LayoutOf().block_count()};
};

TEST_F(SpanTreeFileTest, HasTheBlocksAndSpansOfTheTable) {
  ISOSCOPE_ASSERT_OK(Write());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::SpanOctree octree, Open());
  ISOSCOPE_EXPECT_OK(VerifySpanTree(octree, "here"));
  EXPECT_EQ(octree.Total(), table_.Total());
  for (const auto& rule :
       {volume::InsideRule::OfIsovalue(3), volume::InsideRule::OfIsovalue(500.5),
        volume::InsideRule::OfIsovalue(5000), volume::InsideRule::OfLabels({7, 8, 503})}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::BlockTree active, octree.ActiveBlocks(rule));
    EXPECT_EQ(active, volume::BlockTree(dims_, table_.ActiveBlocks(rule))) << rule.Text();
  }
  for (std::int64_t id = 0; id < table_.block_count(); id += 13) {
    const auto block = static_cast<volume::BlockId>(id);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::ScalarSpan span, octree.SpanOf(block));
    ASSERT_EQ(span, table_.Get(block)) << id;
  }
  EXPECT_THAT(Write(), StatusIs(absl::StatusCode::kAlreadyExists));
}

TEST_F(SpanTreeFileTest, ADamagedHeadIsRefusedAtOpening) {
  ISOSCOPE_ASSERT_OK(Write());
  const std::int64_t pages = volume::SpanPageLayout(dims_).page_count();
  const std::int64_t head = 64 + 8 * pages;
  for (std::int64_t offset = 0; offset < head; ++offset) {
    FlipBit(offset);
    const absl::Status status = Open().status();
    EXPECT_TRUE(absl::IsDataLoss(status) || absl::IsFailedPrecondition(status)) << offset << status;
    FlipBit(offset);
  }
  ISOSCOPE_EXPECT_OK(Open());
}

TEST_F(SpanTreeFileTest, ADamagedPageIsRefusedWhenItIsRead) {
  ISOSCOPE_ASSERT_OK(Write());
  const auto page_bytes =
      static_cast<std::int64_t>(volume::SpanPageLayout::PageBytes(volume::ScalarType::kUint16));
  const std::int64_t size = static_cast<std::int64_t>(io::BytesBelow(directory_)) - 64 -
                            TableBytes(manifest_, LayoutOf());
  FlipBit(size - page_bytes + 5);  // of the last page
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::SpanOctree octree, Open());
  ISOSCOPE_EXPECT_OK(octree.SpanOf(0));
  EXPECT_THAT(octree.SpanOf(static_cast<volume::BlockId>(table_.block_count() - 1)),
              StatusIs(absl::StatusCode::kDataLoss, AllOf(HasSubstr(path()), HasSubstr("page "))));
  EXPECT_THAT(VerifySpanTree(octree, "here"), StatusIs(absl::StatusCode::kDataLoss));
}

TEST_F(SpanTreeFileTest, AFileOfAnotherTableOrSizeIsRefused) {
  ISOSCOPE_ASSERT_OK(Write());
  manifest_.range_table_crc32c ^= 1;
  EXPECT_THAT(Open(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("of another dataset")));
  manifest_.range_table_crc32c ^= 1;
  std::ofstream(path(), std::ios::app) << "x";
  EXPECT_THAT(Open(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("expected")));
}

TEST_F(SpanTreeFileTest, ATableOfAnotherSizeMakesNoTree) {
  manifest_.block_cells = {1, 2, 1};
  EXPECT_THAT(Write(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("ranges.bin")));
}

TEST_F(SpanTreeFileTest, OnlyLargeTablesNeedOne) {
  EXPECT_FALSE(NeedsSpanTree(manifest_, LayoutOf()));
  manifest_.geometry.sample_dims = {161, 161, 161};
  manifest_.block_cells = {1, 1, 1};
  EXPECT_FALSE(NeedsSpanTree(manifest_, LayoutOf()));
  manifest_.geometry.sample_dims = {257, 257, 257};
  EXPECT_TRUE(NeedsSpanTree(manifest_, LayoutOf()));
}

// A shard whose directory has a tree answers as one that has the table alone.
TEST(SpanTreeOfShardTest, AShardAnswersByItsTree) {
  const isoscope::testing::TempDir temp;
  TestDataset dataset(volume::ScalarType::kUint16);
  ISOSCOPE_ASSERT_OK(dataset.Write(temp.Sub("d")));
  const std::string directory = PathIn(temp.Sub("d"), ShardDirectoryName(0, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto by_table, ShardReader::Open(directory));
  EXPECT_FALSE(by_table->has_span_tree());
  ISOSCOPE_ASSERT_OK(WriteSpanTree(directory, by_table->manifest(), by_table->layout()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto by_tree, ShardReader::Open(directory));
  ASSERT_TRUE(by_tree->has_span_tree());
  ISOSCOPE_EXPECT_OK(by_tree->VerifySpans());
  const volume::ScalarSpan total = by_table->ranges().Total();
  for (int i = 0; i < 20; ++i) {
    const auto rule = volume::InsideRule::OfIsovalue(total.min + (total.max - total.min) * i / 19);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto active, by_tree->ActiveTree(rule));
    EXPECT_EQ(active->ToSet(), *by_table->ActiveBlocks(rule));
    EXPECT_GE(by_tree->CountActivePages(rule.isovalue), active->count() > 0 ? 1 : 0);
  }
  for (std::int64_t id = 0; id < by_table->layout().block_count(); ++id) {
    const auto block = static_cast<volume::BlockId>(id);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::ScalarSpan span, by_tree->SpanOf(block));
    ASSERT_EQ(span, by_table->ranges().Get(block));
  }
  EXPECT_EQ(by_tree->ranges(), by_table->ranges()) << "read when it is asked for";

  // Both files are verified, as far as they were not read.
  for (const char* const name : {kSpanTreeFileName, kRangeTableFileName}) {
    const std::string path = PathIn(directory, name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(path, 1 << 20));
    std::string damaged = bytes;
    damaged[damaged.size() - 5] ^= 1;
    std::ofstream(path, std::ios::binary) << damaged;
    EXPECT_THAT(by_tree->VerifySpans(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr(path)));
    std::ofstream(path, std::ios::binary) << bytes;
    ISOSCOPE_EXPECT_OK(by_tree->VerifySpans());
  }
}

}  // namespace
}  // namespace isoscope::store
