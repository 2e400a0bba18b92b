// A shard of 180 encoded blocks, in place of raw ones:
//
// - blocks of every type come back, and take less room;
// - the bytes do not depend on the order in which the blocks were appended;
// - damaged blocks, wrong ids and orders, full disks at every byte.

#include <algorithm>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/store/block_codec.h"
#include "core/store/shard_writer.h"
#include "core/volume/block_samples.h"
#include "tests/support/fault_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::MakeFullDiskFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Slurp(const std::string& path) { return io::ReadWholeFile(path, base::kGiB).value(); }

// 180 blocks of 4^3 cells; SamplesOf keeps to six bits of eight: they compress, but not all.
class EncodedShardTest : public ::testing::Test {
 protected:
  void SetType(volume::ScalarType type) {
    dataset_ = TestDataset(type);
    dataset_.manifest.geometry.sample_dims = {24, 21, 25};
    dataset_.manifest.block_cells = {4, 4, 4};
    dataset_.layout = volume::BlockLayout::Make({24, 21, 25}, {4, 4, 4}).value();
    const auto block_count = static_cast<std::size_t>(dataset_.layout.block_count());
    dataset_.ranges = volume::RangeTable(type, dataset_.layout.block_count());
    dataset_.blocks = BlocksByShard(dataset_.layout, std::vector<std::uint16_t>(block_count), 1);
  }
  // The ordinals from first to last.
  [[nodiscard]] std::vector<std::size_t> Ordinals() const {
    std::vector<std::size_t> ordinals(dataset_.blocks[0].size());
    for (std::size_t i = 0; i < ordinals.size(); ++i) {
      ordinals[i] = i;
    }
    return ordinals;
  }
  // Appends the blocks of these ordinals, then the index.
  absl::StatusOr<ShardSummary> WriteShard(
      BlockEncoding encoding, const std::vector<std::size_t>& order,
      const ShardWriter::CreateFile& create_file = io::CreateWritableFile) {
    directory_ = temp_.Sub("s" + std::to_string(++directory_count_));
    const volume::BlockLayout& layout = dataset_.layout;
    const volume::ScalarType type = dataset_.manifest.scalar_type;
    ISOSCOPE_ASSIGN_OR_RETURN(const auto writer,
                              ShardWriter::Create(directory_, layout, type, create_file));
    std::vector<BlockIndexEntry> entries(order.size());
    for (const std::size_t ordinal : order) {
      const volume::BlockId id = dataset_.blocks[0][ordinal];
      std::string stored;
      const BlockEncoding used = EncodeBlock(encoding, type, layout.StoredSamplesOf(id).dims(),
                                             SamplesOf(layout, id, type), &stored);
      BlockIndexEntry& entry = entries[ordinal];
      entry.block_id = id;
      entry.encoding = static_cast<std::uint32_t>(used);
      entry.size = static_cast<std::uint32_t>(stored.size());
      entry.crc32c = base::Crc32c(stored);
      ISOSCOPE_ASSIGN_OR_RETURN(entry.offset, writer->AppendBlock(id, stored));
    }
    for (const BlockIndexEntry& entry : entries) {
      ISOSCOPE_RETURN_IF_ERROR(writer->AppendIndexEntry(entry));
    }
    return writer->Finish();
  }
  // Makes the directory readable.
  void Describe(const ShardSummary& summary) {
    dataset_.manifest.shards = {summary};
    const std::string range_bytes = EncodeRangeTable(dataset_.ranges);
    dataset_.manifest.range_table_crc32c = base::Crc32c(range_bytes);
    dataset_.manifest.dataset_id = ComputeDatasetId(dataset_.manifest);
    ISOSCOPE_ASSERT_OK(io::WriteWholeFile(directory_ + "/" + kIntervalTreeFileName,
                                          "stands for an interval tree"));
    ISOSCOPE_ASSERT_OK(WriteDescriptions(directory_, dataset_.manifest, range_bytes, 0));
  }
  [[nodiscard]] std::string BlocksPath() const { return directory_ + "/" + kBlocksFileName; }
  [[nodiscard]] std::string IndexPath() const { return directory_ + "/" + kBlockIndexFileName; }

  const TempDir temp_;
  int directory_count_ = 0;
  TestDataset dataset_;
  std::string directory_;
};

TEST_F(EncodedShardTest, BlocksOfEveryTypeComeBackAndTakeLess) {
  for (int type_number = 1; type_number <= 8; ++type_number) {
    const auto type = static_cast<volume::ScalarType>(type_number);
    SetType(type);
    std::int64_t raw_bytes = 0;
    for (const volume::BlockId id : dataset_.blocks[0]) {
      raw_bytes += static_cast<std::int64_t>(volume::StoredSizeBytes(dataset_.layout, id, type));
    }
    for (const BlockEncoding encoding :
         {BlockEncoding::kLz4, BlockEncoding::kZstd, BlockEncoding::kPacked}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ShardSummary summary, WriteShard(encoding, Ordinals()));
      EXPECT_EQ(summary.block_count, 180);
      EXPECT_LE(summary.block_bytes, raw_bytes);
      if (encoding == BlockEncoding::kZstd) {  // entropy coding pays for six bits of eight
        EXPECT_LT(summary.block_bytes, raw_bytes);
      }
      ASSERT_NO_FATAL_FAILURE(Describe(summary));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto blocks, ReadShard(directory_));
      ASSERT_EQ(blocks.size(), dataset_.blocks[0].size());
      for (std::size_t i = 0; i < blocks.size(); ++i) {
        EXPECT_EQ(blocks[i].first, dataset_.blocks[0][i]);
        EXPECT_TRUE(blocks[i].second == SamplesOf(dataset_.layout, blocks[i].first, type)) << i;
      }
    }
  }
}

TEST_F(EncodedShardTest, BytesDoNotDependOnTheOrderInWhichBlocksWereAppended) {
  SetType(volume::ScalarType::kUint16);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ShardSummary expected,
                                WriteShard(BlockEncoding::kZstd, Ordinals()));
  const std::string blocks = Slurp(BlocksPath());
  const std::string index = Slurp(IndexPath());
  std::vector<std::vector<std::size_t>> orders(3, Ordinals());
  std::reverse(orders[0].begin(), orders[0].end());
  std::swap(orders[1].front(), orders[1].back());
  std::sort(orders[2].begin(), orders[2].end(), [](std::size_t a, std::size_t b) {
    return base::RandomBits(1, a) < base::RandomBits(1, b);
  });
  for (const std::vector<std::size_t>& order : orders) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ShardSummary summary,
                                  WriteShard(BlockEncoding::kZstd, order));
    EXPECT_EQ(summary, expected);
    EXPECT_TRUE(Slurp(BlocksPath()) == blocks);
    EXPECT_TRUE(Slurp(IndexPath()) == index);
  }
}

TEST_F(EncodedShardTest, WrongIdsAndOrdersAreRefused) {
  SetType(volume::ScalarType::kUint8);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto writer,
      ShardWriter::Create(temp_.Sub("shard"), dataset_.layout, volume::ScalarType::kUint8));
  EXPECT_THAT(writer->AppendBlock(180, "x"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("block 180")));
  ISOSCOPE_ASSERT_OK(writer->AppendBlock(0, "x").status());
  const BlockIndexEntry entry{.block_id = 0, .encoding = 1, .offset = 0, .size = 1};
  ISOSCOPE_ASSERT_OK(writer->AppendIndexEntry(entry));
  EXPECT_THAT(writer->AppendIndexEntry(entry),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("order of blocks")));
  EXPECT_THAT(writer->AppendIndexEntry({.block_id = 180}),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("block 180")));
}

TEST_F(EncodedShardTest, DamagedCompressedBlockIsDataLossEvenWithItsRightChecksum) {
  SetType(volume::ScalarType::kUint8);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(ShardSummary summary, WriteShard(BlockEncoding::kZstd, Ordinals()));
  std::string index = Slurp(IndexPath());
  std::string blocks = Slurp(BlocksPath());
  BlockIndexEntry entry = DecodeBlockIndexEntry(index.data() + kBinaryHeaderBytes);
  ASSERT_EQ(entry.encoding, static_cast<std::uint32_t>(BlockEncoding::kZstd));
  ASSERT_EQ(entry.offset, 0);
  blocks.replace(0, entry.size, entry.size, '\xff');
  entry.crc32c = base::Crc32c(absl::string_view(blocks).substr(0, entry.size));
  index.replace(kBinaryHeaderBytes, kBlockIndexEntryBytes, EncodeBlockIndexEntry(entry));
  const std::string payload = index.substr(kBinaryHeaderBytes);
  index = EncodeBinaryHeader(kBlockIndexMagic, {.scalar_type = 1,
                                                .entry_size = kBlockIndexEntryBytes,
                                                .count = summary.block_count,
                                                .payload_crc32c = base::Crc32c(payload),
                                                .data_size = summary.block_bytes}) +
          payload;
  summary.block_index_crc32c = base::Crc32c(index);
  std::ofstream(IndexPath(), std::ios::binary | std::ios::trunc) << index;
  std::ofstream(BlocksPath(), std::ios::binary | std::ios::trunc) << blocks;
  ASSERT_NO_FATAL_FAILURE(Describe(summary));
  EXPECT_THAT(ReadShard(directory_),
              StatusIs(absl::StatusCode::kDataLoss,
                       AllOf(HasSubstr("shard 0 of 1: block " +
                                       std::to_string(dataset_.blocks[0][0]) + " at offset 0"),
                             HasSubstr("no zstd encoding"))));
}

// The first writes, those of the copy in order, and those of the index fail.
TEST_F(EncodedShardTest, FullDiskIsReportedAtEveryByte) {
  SetType(volume::ScalarType::kUint8);
  std::vector<std::size_t> backwards = Ordinals();
  std::reverse(backwards.begin(), backwards.end());
  for (const std::vector<std::size_t>& order : {Ordinals(), backwards}) {
    int file_count = 0;
    for (int full_file = 0; full_file <= 3; ++full_file) {
      for (std::int64_t capacity = 0; capacity < 5500; capacity += 499) {
        file_count = 0;
        const auto create_file =
            [&](const std::string& path) -> absl::StatusOr<std::unique_ptr<io::WritableFile>> {
          ISOSCOPE_ASSIGN_OR_RETURN(auto file, io::CreateWritableFile(path));
          return file_count++ == full_file ? MakeFullDiskFile(std::move(file), capacity)
                                           : std::move(file);
        };
        const absl::Status status = WriteShard(BlockEncoding::kZstd, order, create_file).status();
        if (full_file < file_count) {
          EXPECT_THAT(status, StatusIs(absl::StatusCode::kResourceExhausted, _))
              << full_file << " " << capacity;
        } else {
          ISOSCOPE_EXPECT_OK(status);
        }
      }
    }
    EXPECT_EQ(file_count, order == backwards ? 3 : 2);
  }
}

}  // namespace
}  // namespace isoscope::store
