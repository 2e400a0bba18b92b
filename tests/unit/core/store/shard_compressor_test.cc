// A raw shard of 180 blocks is compressed in place:
//
// - blocks of every type come back, and take less room;
// - the bytes depend neither on threads nor on batches;
// - damaged blocks, shards that are not raw, full disks at every byte, cancellation.

#include "core/store/shard_compressor.h"

#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/store/block_codec.h"
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

void OneByOne(std::size_t count, absl::FunctionRef<void(std::size_t)> task) {
  for (std::size_t i = count; i-- > 0;) {
    task(i);
  }
}
void OnThreeThreads(std::size_t count, absl::FunctionRef<void(std::size_t)> task) {
  std::vector<std::thread> threads;
  for (std::size_t first = 0; first < 3; ++first) {
    threads.emplace_back([=] {
      for (std::size_t i = first; i < count; i += 3) {
        task(i);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

// 180 blocks of 4^3 cells; SamplesOf keeps to six bits of eight: they compress, but not all.
class ShardCompressorTest : public ::testing::Test {
 protected:
  void WriteRaw(volume::ScalarType type) {
    dataset_ = TestDataset(type);
    dataset_.manifest.geometry.sample_dims = {24, 21, 25};
    dataset_.manifest.block_cells = {4, 4, 4};
    dataset_.layout = volume::BlockLayout::Make({24, 21, 25}, {4, 4, 4}).value();
    const auto block_count = static_cast<std::size_t>(dataset_.layout.block_count());
    dataset_.ranges = volume::RangeTable(type, dataset_.layout.block_count());
    dataset_.blocks = BlocksByShard(dataset_.layout, std::vector<std::uint16_t>(block_count), 1);
    directory_ = temp_.Sub("s" + std::to_string(++directory_count_));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        raw_, WriteBlocks(directory_, dataset_.layout, type, dataset_.blocks[0]));
  }
  absl::StatusOr<ShardSummary> Compress(const CompressOptions& options,
                                        ParallelFor parallel_for = OneByOne) {
    return CompressShard(directory_, dataset_.layout, dataset_.manifest.scalar_type, raw_, options,
                         parallel_for, base::Cancellation());
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
  ShardSummary raw_;
};

TEST_F(ShardCompressorTest, BlocksOfEveryTypeComeBackAndTakeLess) {
  for (int type_number = 1; type_number <= 8; ++type_number) {
    const auto type = static_cast<volume::ScalarType>(type_number);
    for (const BlockEncoding encoding :
         {BlockEncoding::kLz4, BlockEncoding::kZstd, BlockEncoding::kPacked}) {
      ASSERT_NO_FATAL_FAILURE(WriteRaw(type));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ShardSummary summary, Compress({.encoding = encoding}));
      EXPECT_EQ(summary.block_count, raw_.block_count);
      EXPECT_LE(summary.block_bytes, raw_.block_bytes);
      if (encoding == BlockEncoding::kZstd) {  // entropy coding pays for six bits of eight
        EXPECT_LT(summary.block_bytes, raw_.block_bytes);
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

TEST_F(ShardCompressorTest, BytesDependOnNeitherThreadsNorBatches) {
  ASSERT_NO_FATAL_FAILURE(WriteRaw(volume::ScalarType::kUint16));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ShardSummary expected,
                                Compress({.encoding = BlockEncoding::kZstd}));
  const std::string blocks = Slurp(BlocksPath());
  const std::string index = Slurp(IndexPath());
  for (const std::size_t batch_bytes : {std::size_t{1}, std::size_t{5000}, std::size_t{1} << 30}) {
    ASSERT_NO_FATAL_FAILURE(WriteRaw(volume::ScalarType::kUint16));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const ShardSummary summary,
        Compress({.encoding = BlockEncoding::kZstd, .batch_bytes = batch_bytes}, OnThreeThreads));
    EXPECT_EQ(summary, expected);
    EXPECT_TRUE(Slurp(BlocksPath()) == blocks);
    EXPECT_TRUE(Slurp(IndexPath()) == index);
  }
}

TEST_F(ShardCompressorTest, DamagedCompressedBlockIsDataLossEvenWithItsRightChecksum) {
  ASSERT_NO_FATAL_FAILURE(WriteRaw(volume::ScalarType::kUint8));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(ShardSummary summary, Compress({.encoding = BlockEncoding::kZstd}));
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

TEST_F(ShardCompressorTest, ShardThatIsNotRawOrNotWholeIsRefused) {
  ASSERT_NO_FATAL_FAILURE(WriteRaw(volume::ScalarType::kUint8));
  raw_.block_bytes += 1;
  EXPECT_THAT(Compress({}), StatusIs(absl::StatusCode::kDataLoss, HasSubstr(directory_)));
  raw_.block_bytes -= 1;
  const std::string index = Slurp(IndexPath());
  // Block id (its highest byte), encoding, offset, both sizes.
  for (const std::size_t field :
       {std::size_t{3}, std::size_t{4}, std::size_t{8}, std::size_t{16}, std::size_t{20}}) {
    std::string damaged = index;
    damaged[kBinaryHeaderBytes + 3 * kBlockIndexEntryBytes + field] ^= 1;
    std::ofstream(IndexPath(), std::ios::binary | std::ios::trunc) << damaged;
    EXPECT_THAT(Compress({}), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("next raw block")));
    for (const std::string& path : {BlocksPath(), IndexPath()}) {
      ISOSCOPE_ASSERT_OK(io::RemoveRecursively(path + ".compressed"));
    }
  }
}

// Encodings depend on the shape of a block, so that the index has to name the block it holds.
TEST_F(ShardCompressorTest, ABlockOfAnotherSizeThanItsIdSaysIsRefused) {
  ASSERT_NO_FATAL_FAILURE(WriteRaw(volume::ScalarType::kUint8));
  std::string index = Slurp(IndexPath());
  const std::size_t at = kBinaryHeaderBytes + 3 * kBlockIndexEntryBytes;
  BlockIndexEntry entry = DecodeBlockIndexEntry(index.data() + at);
  const volume::BlockId old_id = entry.block_id;
  while (volume::StoredSizeBytes(dataset_.layout, entry.block_id, volume::ScalarType::kUint8) ==
         entry.size) {
    entry.block_id =
        (entry.block_id + 1) % static_cast<volume::BlockId>(dataset_.layout.block_count());
    ASSERT_NE(entry.block_id, old_id);
  }
  index.replace(at, kBlockIndexEntryBytes, EncodeBlockIndexEntry(entry));
  std::ofstream(IndexPath(), std::ios::binary | std::ios::trunc) << index;
  EXPECT_THAT(Compress({.encoding = BlockEncoding::kPacked}),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("next raw block")));
}

TEST_F(ShardCompressorTest, FullDiskIsReportedAtEveryByte) {
  ASSERT_NO_FATAL_FAILURE(WriteRaw(volume::ScalarType::kUint8));
  for (std::int64_t capacity = 0; capacity < 6000; capacity += 499) {
    CompressOptions options{.encoding = BlockEncoding::kZstd};
    options.create_file =
        [&](const std::string& path) -> absl::StatusOr<std::unique_ptr<io::WritableFile>> {
      ISOSCOPE_ASSIGN_OR_RETURN(auto file, io::CreateWritableFile(path));
      return MakeFullDiskFile(std::move(file), capacity);
    };
    EXPECT_THAT(Compress(options), StatusIs(absl::StatusCode::kResourceExhausted, _)) << capacity;
    for (const std::string& path : {BlocksPath(), IndexPath()}) {
      ISOSCOPE_ASSERT_OK(io::RemoveRecursively(path + ".compressed"));
    }
  }
}

TEST_F(ShardCompressorTest, CancellationStopsIt) {
  ASSERT_NO_FATAL_FAILURE(WriteRaw(volume::ScalarType::kUint8));
  base::Cancellation cancellation;
  const auto cancel = [&](std::size_t count, absl::FunctionRef<void(std::size_t)> task) {
    OneByOne(count, task);
    cancellation.Cancel();
  };
  EXPECT_THAT(CompressShard(directory_, dataset_.layout, volume::ScalarType::kUint8, raw_,
                            {.batch_bytes = 5000}, cancel, cancellation),
              StatusIs(absl::StatusCode::kCancelled, _));
}

}  // namespace
}  // namespace isoscope::store
