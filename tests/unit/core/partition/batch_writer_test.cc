// A writer of batches: all of them are written, and the first error ends it.

#include "core/partition/batch_writer.h"

#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/store/shard_format.h"
#include "core/volume/block_samples.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::partition {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

class BatchWriterTest : public ::testing::Test {
 protected:
  BatchWriterTest() {
    plan_.file_buffer_bytes = 16384;
    plan_.entry_bytes = 1 << 16;
    plan_.tree_bytes = 1 << 16;
  }

  // Sets a batch to these blocks of shard 0: each has bytes of its id.
  void Set(const std::vector<volume::BlockId>& ids, BlockBatch* batch) const {
    batch->blocks.clear();
    batch->offsets.assign(1, 0);
    batch->bytes.clear();
    for (const volume::BlockId id : ids) {
      const std::size_t size = volume::StoredSizeBytes(layout_, id, type_);
      std::int64_t offset = 0;
      for (volume::BlockId before = 0; before < id; ++before) {
        offset += static_cast<std::int64_t>(volume::StoredSizeBytes(layout_, before, type_));
      }
      batch->blocks.push_back({.placement = {.offset = offset, .ordinal = id}, .id = id});
      batch->bytes.insert(batch->bytes.end(), size, static_cast<char>(id));
      batch->offsets.push_back(batch->bytes.size());
    }
    batch->spans.resize(ids.size());
    batch->entries.resize(ids.size());
  }
  [[nodiscard]] std::string WrittenBytes() const {
    return io::ReadWholeFile(
               absl::StrCat(shards_.directories().front(), "/", store::kBlocksFileName), base::kGiB)
        .value();
  }

  testing::TempDir dir_;
  const volume::ScalarType type_ = volume::ScalarType::kUint8;
  // A row of 20 blocks.
  const volume::BlockLayout layout_ = volume::BlockLayout::Make({41, 3, 3}, {2, 2, 2}).value();
  PartitionPlan plan_;
  ShardSet shards_{dir_.path(), layout_, type_, plan_, store::BlockEncoding::kRaw};
};

TEST_F(BatchWriterTest, AllBatchesAreWrittenWhereTheirBlocksBelong) {
  ISOSCOPE_ASSERT_OK(shards_.Create(1, false));
  std::string expected;
  for (volume::BlockId id = 0; id < 20; ++id) {
    expected.append(volume::StoredSizeBytes(layout_, id, type_), static_cast<char>(id));
  }
  {
    BatchWriter writer(&shards_, 2);
    // Batches with gaps: blocks 0, 1, 3 and 2, 4 to 7, and so on.
    const std::vector<std::vector<volume::BlockId>> batches = {
        {0, 1, 3}, {2}, {4, 5, 6, 7}, {19}, {9, 11, 13, 15, 17}, {8, 10, 12, 14, 16, 18}};
    for (const std::vector<volume::BlockId>& ids : batches) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(BlockBatch* const batch, writer.Take());
      Set(ids, batch);
      writer.Write(batch);
    }
    ISOSCOPE_EXPECT_OK(writer.Finish());
  }
  // The file's buffer is flushed when the index begins.
  HistogramBuilder histograms(layout_, type_, 1);
  base::Cancellation never;
  ISOSCOPE_ASSERT_OK(shards_.Finish(histograms, never).status());
  EXPECT_EQ(WrittenBytes(), expected);
}

TEST_F(BatchWriterTest, TheFirstErrorEndsItAndIsToldToAll) {
  ISOSCOPE_ASSERT_OK(shards_.Create(1, false));
  BatchWriter writer(&shards_, 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(BlockBatch* const wrong, writer.Take());
  Set({0, 1}, wrong);
  wrong->blocks[1].id = 99;
  writer.Write(wrong);
  EXPECT_THAT(writer.Finish(), StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("block 99")));
  EXPECT_THAT(writer.Take().status(), StatusIs(absl::StatusCode::kInvalidArgument, _));
  EXPECT_THAT(writer.Finish(), StatusIs(absl::StatusCode::kInvalidArgument, _));
}

// Would hang, or touch shards that are gone.
TEST_F(BatchWriterTest, ItMayEndWithBatchesThatWereTakenOrWait) {
  ISOSCOPE_ASSERT_OK(shards_.Create(1, false));
  for (int round = 0; round < 50; ++round) {
    BatchWriter writer(&shards_, 4);
    for (volume::BlockId id = 0; id < 3; ++id) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(BlockBatch* const batch, writer.Take());
      Set({id}, batch);
      if (id < 2) {
        writer.Write(batch);
      }
    }
  }
}

}  // namespace
}  // namespace isoscope::partition
