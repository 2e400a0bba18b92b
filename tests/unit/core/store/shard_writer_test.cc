// The files of a shard, byte by byte, and the rules of writing them:
//
// - the documented bytes of blocks, index and range table;
// - range tables that are damaged or hostile;
// - misuse: wrong ids, wrong order, gaps, a missing interval tree;
// - full disks at any write; the dataset id.

#include "core/store/shard_writer.h"

#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "tests/support/fault_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string HexOf(absl::string_view bytes) { return absl::BytesToHexString(bytes); }

// The shard of docs/format/shard.md: 3 x 2 x 2 samples of uint8 in blocks of one cell.
TEST(ShardWriterTest, BytesStayAsDocumented) {
  const TempDir temp;
  const auto layout = volume::BlockLayout::Make({3, 2, 2}, {1, 1, 1}).value();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, ShardWriter::Create(temp.Sub("shard"), layout,
                                                                       volume::ScalarType::kUint8));
  const std::string first("\x00\x01\x02\x03\x04\x05\x06\x07\x08\x09\x0a\x0b", 12);
  const std::string second(12, '\x2a');
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::uint32_t second_crc, writer->WriteBlock(1, 12, second));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::uint32_t first_crc, writer->WriteBlock(0, 0, first));
  ISOSCOPE_ASSERT_OK(writer->AppendIndexEntry(0, first_crc));
  ISOSCOPE_ASSERT_OK(writer->AppendIndexEntry(1, second_crc));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ShardSummary summary, writer->Finish());

  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string blocks,
                                io::ReadWholeFile(temp.Sub("shard/blocks.bin"), 1000));
  EXPECT_EQ(blocks, first + second);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string index,
                                io::ReadWholeFile(temp.Sub("shard/block_index.bin"), 1000));
  EXPECT_EQ(HexOf(index.substr(0, 64)),
            "49534f424c4b4958"  // "ISOBLKIX"
            "01000000"          // version 1
            "77b1e21d"          // header CRC-32C
            "01000000"          // uint8
            "20000000"          // entries of 32 bytes
            "0200000000000000"  // 2 entries
            "ed09ce05"          // CRC-32C of the entries
            "00000000"
            "1800000000000000"  // blocks.bin has 24 bytes
            "00000000000000000000000000000000");
  EXPECT_EQ(HexOf(index.substr(64, 32)),
            "00000000"          // block 0
            "00000000"          // raw
            "0000000000000000"  // offset 0
            "0c000000"          // 12 bytes stored
            "0c000000"          // 12 bytes raw
            "baaa8353"          // CRC-32C of the block
            "00000000");
  EXPECT_EQ(HexOf(index.substr(96)),
            "01000000"
            "00000000"
            "0c00000000000000"
            "0c000000"
            "0c000000"
            "0d4513d5"
            "00000000");
  EXPECT_EQ(summary,
            (ShardSummary{
                .block_count = 2, .block_bytes = 24, .block_index_crc32c = base::Crc32c(index)}));
}

TEST(ShardWriterTest, RangeTableBytesStayAsDocumented) {
  volume::RangeTable ranges(volume::ScalarType::kInt16, 3);
  ranges.Set(0, {.min = -2, .max = 258});
  ranges.Set(2, {.min = 7, .max = 7});
  const std::string bytes = EncodeRangeTable(ranges);
  EXPECT_EQ(HexOf(bytes),
            "49534f52414e4745"  // "ISORANGE"
            "01000000"          // version 1
            "af8afa7a"          // header CRC-32C
            "04000000"          // int16
            "04000000"          // entries of 4 bytes
            "0300000000000000"  // 3 entries
            "8fd9734d"          // CRC-32C of the entries
            "00000000"
            "0000000000000000"
            "00000000000000000000000000000000"
            "feff0201"    // [-2, 258]
            "ff7f0080"    // empty
            "07000700");  // [7, 7]
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::RangeTable decoded, DecodeRangeTable(bytes, "r"));
  EXPECT_EQ(decoded.type(), volume::ScalarType::kInt16);
  EXPECT_EQ(decoded.bytes(), ranges.bytes());
}

TEST(ShardWriterTest, EveryTruncationAndFlippedBitOfARangeTableIsDataLoss) {
  for (int type = 1; type <= 8; ++type) {
    volume::RangeTable ranges(static_cast<volume::ScalarType>(type), 5);
    ranges.Set(1, {.min = 3, .max = 90});
    const std::string bytes = EncodeRangeTable(ranges);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const volume::RangeTable decoded, DecodeRangeTable(bytes, "r"));
    EXPECT_EQ(decoded.bytes(), ranges.bytes());
    for (std::size_t size = 0; size < bytes.size(); ++size) {
      const std::vector<char> exact(bytes.begin(),
                                    bytes.begin() + static_cast<std::ptrdiff_t>(size));
      ASSERT_THAT(DecodeRangeTable({exact.data(), exact.size()}, "r"),
                  StatusIs(absl::StatusCode::kDataLoss, _));
    }
    EXPECT_THAT(DecodeRangeTable(bytes + '\0', "r"), StatusIs(absl::StatusCode::kDataLoss, _));
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      std::string damaged = bytes;
      damaged[bit / 8] =
          static_cast<char>(static_cast<unsigned char>(damaged[bit / 8]) ^ (1u << (bit % 8)));
      ASSERT_THAT(DecodeRangeTable(damaged, "r"), StatusIs(absl::StatusCode::kDataLoss, _)) << bit;
    }
  }
}

TEST(ShardWriterTest, HostileRangeTableHeadersAreRefusedEvenWithRightChecksums) {
  const auto decode = [](const BinaryHeader& header, const std::string& payload) {
    return DecodeRangeTable(EncodeBinaryHeader(kRangeTableMagic, header) + payload, "r").status();
  };
  const std::string payload(8, '\1');
  const std::uint32_t crc = base::Crc32c(payload);
  ISOSCOPE_EXPECT_OK(
      decode({.scalar_type = 1, .entry_size = 2, .count = 4, .payload_crc32c = crc}, payload));
  const BinaryHeader hostile[] = {
      {.scalar_type = 0, .entry_size = 2, .count = 4, .payload_crc32c = crc},
      {.scalar_type = 9, .entry_size = 2, .count = 4, .payload_crc32c = crc},
      {.scalar_type = 257, .entry_size = 2, .count = 4, .payload_crc32c = crc},
      {.scalar_type = 1, .entry_size = 4, .count = 2, .payload_crc32c = crc},
      {.scalar_type = 1, .entry_size = 2, .count = -4, .payload_crc32c = crc},
      {.scalar_type = 1, .entry_size = 2, .count = 5, .payload_crc32c = crc},
      {.scalar_type = 1, .entry_size = 0, .count = 0, .payload_crc32c = crc},
      {.scalar_type = 1, .entry_size = 2, .count = std::int64_t{1} << 62, .payload_crc32c = crc},
      {.scalar_type = 1,
       .entry_size = 8,
       .count = (std::int64_t{1} << 61) + 1,  // 2^64 + 8 bytes
       .payload_crc32c = crc}};
  for (const BinaryHeader& header : hostile) {
    EXPECT_THAT(decode(header, payload), StatusIs(absl::StatusCode::kDataLoss, _));
  }
}

// A file that ends in its own CRC-32C has the same CRC-32C for any content. The manifest's checksum
// of it would then prove nothing.
TEST(ShardWriterTest, ChecksumsOfWholeFilesDependOnTheirContent) {
  std::set<std::uint32_t> checksums;
  for (int value = 0; value < 200; ++value) {
    for (const auto type : {volume::ScalarType::kUint8, volume::ScalarType::kInt16}) {
      volume::RangeTable ranges(type, 2);
      ranges.Set(0, {.min = 0, .max = static_cast<double>(value)});
      checksums.insert(base::Crc32c(EncodeRangeTable(ranges)));
    }
  }
  EXPECT_EQ(checksums.size(), 400u);
}

TEST(ShardWriterTest, MisuseIsRefused) {
  const TempDir temp;
  const auto layout = volume::BlockLayout::Make({5, 5, 3}, {2, 2, 2}).value();  // 2 x 2 x 1 blocks
  const auto create = [&](const std::string& name) {
    return ShardWriter::Create(temp.Sub(name), layout, volume::ScalarType::kUint8);
  };
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  EXPECT_THAT(create("no/parent"), StatusIs(absl::StatusCode::kNotFound, _));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer, create("b"));
  EXPECT_THAT(create("b"), StatusIs(absl::StatusCode::kAlreadyExists, _));
  const std::string samples = SamplesOf(layout, 0, volume::ScalarType::kUint8);
  EXPECT_THAT(writer->WriteBlock(4, 0, samples), StatusIs(kInvalid, HasSubstr("block 4")));
  EXPECT_THAT(writer->WriteBlock(0, -1, samples), StatusIs(kInvalid, HasSubstr("offset -1")));
  EXPECT_THAT(writer->WriteBlock(0, 0, samples + "x"), StatusIs(kInvalid, _));
  ISOSCOPE_ASSERT_OK(writer->WriteBlock(0, 0, samples).status());
  EXPECT_THAT(writer->AppendIndexEntry(4, 0), StatusIs(kInvalid, _));
  ISOSCOPE_ASSERT_OK(writer->AppendIndexEntry(0, 0));
  EXPECT_THAT(writer->AppendIndexEntry(0, 0),
              StatusIs(kInvalid, HasSubstr("in the order of blocks")));
}

TEST(ShardWriterTest, IdsOutOfOrderAreRefused) {
  const TempDir temp;
  const auto layout = volume::BlockLayout::Make({5, 5, 3}, {2, 2, 2}).value();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto writer, ShardWriter::Create(temp.Sub("a"), layout, volume::ScalarType::kUint8));
  ISOSCOPE_ASSERT_OK(writer->AppendIndexEntry(1, 0));
  EXPECT_THAT(writer->AppendIndexEntry(2, 0),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("in the order of blocks")));
}

// A gap would be read as zeros, and a missing block as the bytes of another one.
TEST(ShardWriterTest, IndexThatIsNotOfTheBlocksWrittenIsInternal) {
  const auto layout = volume::BlockLayout::Make({5, 5, 3}, {2, 2, 2}).value();
  const auto type = volume::ScalarType::kUint8;
  const auto size = [&](volume::BlockId id) {
    return static_cast<std::int64_t>(volume::StoredSizeBytes(layout, id, type));
  };
  struct Case {
    std::vector<std::pair<volume::BlockId, std::int64_t>> written;  // id, offset
    std::vector<volume::BlockId> entries;
  };
  const Case cases[] = {{{}, {}},
                        {{{0, 0}}, {}},
                        {{}, {0}},
                        {{{0, 0}}, {0, 1}},
                        {{{0, 0}, {1, size(0)}}, {0}},
                        {{{0, 0}, {0, 0}}, {0}},
                        {{{0, 0}, {1, size(0) + 1}}, {0, 1}},
                        {{{1, size(0)}}, {0, 1}}};
  const TempDir temp;
  int number = 0;
  for (const Case& c : cases) {
    SCOPED_TRACE(number);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const auto writer, ShardWriter::Create(temp.Sub(std::to_string(number++)), layout, type));
    for (const auto& [id, offset] : c.written) {
      ISOSCOPE_ASSERT_OK(writer->WriteBlock(id, offset, SamplesOf(layout, id, type)).status());
    }
    for (const volume::BlockId id : c.entries) {
      ISOSCOPE_ASSERT_OK(writer->AppendIndexEntry(id, 0));
    }
    EXPECT_THAT(writer->Finish(), StatusIs(absl::StatusCode::kInternal, HasSubstr("expected")));
  }
}

TEST(ShardWriterTest, RangeTableInPiecesIsTheSameFile) {
  const TempDir temp;
  volume::RangeTable whole(volume::ScalarType::kInt16, 10);
  for (volume::BlockId id = 0; id < 10; ++id) {
    whole.Set(id, {.min = -1.0 * id, .max = 7.0 * id});
  }
  const std::string expected = EncodeRangeTable(whole);
  const std::string path = temp.Sub("ranges.bin");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto writer,
                                RangeTableWriter::Create(path, volume::ScalarType::kInt16));
  volume::BlockId next = 0;
  for (const std::int64_t count : {3, 0, 1, 6}) {
    volume::RangeTable part(volume::ScalarType::kInt16, count);
    for (volume::BlockId i = 0; i < count; ++i) {
      part.Set(i, whole.Get(next++));
    }
    ISOSCOPE_ASSERT_OK(writer->Append(part));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::uint32_t crc, writer->Finish());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(path, 1000));
  EXPECT_EQ(bytes, expected);
  EXPECT_EQ(crc, base::Crc32c(expected));
  EXPECT_THAT(RangeTableWriter::Create(path, volume::ScalarType::kInt16),
              StatusIs(absl::StatusCode::kAlreadyExists, _));
}

TEST(ShardWriterTest, FullDiskIsReportedWhereverItStrikes) {
  const auto layout = volume::BlockLayout::Make({5, 5, 3}, {2, 2, 2}).value();
  const std::vector<volume::BlockId> blocks = {0, 2, 3, 1};
  const TempDir temp;
  int failure_count = 0;
  bool has_succeeded = false;
  for (std::int64_t capacity = 0; !has_succeeded; capacity += 7) {
    ASSERT_LT(capacity, 1000);
    const std::string directory = temp.Sub(std::to_string(capacity));
    const auto create_file =
        [capacity](const std::string& path) -> absl::StatusOr<std::unique_ptr<io::WritableFile>> {
      ISOSCOPE_ASSIGN_OR_RETURN(auto file, io::CreateWritableFile(path));
      return testing::MakeFullDiskFile(std::move(file), capacity);
    };
    const absl::Status status =
        WriteBlocks(directory, layout, volume::ScalarType::kUint8, blocks, create_file).status();
    has_succeeded = status.ok();
    if (!has_succeeded) {
      ++failure_count;
      EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
      EXPECT_FALSE(ShardReader::Open(directory).ok());
    }
  }
  EXPECT_GT(failure_count, 10);
}

TEST(ShardWriterTest, DescriptionsNeedTheIntervalTreeAndComeOnce) {
  const TempDir temp;
  TestDataset dataset;
  ISOSCOPE_ASSERT_OK(dataset.Write(temp.Sub("tiny")));
  const std::string shard = temp.Sub("tiny/") + ShardDirectoryName(0, 1);
  const std::string ranges = EncodeRangeTable(dataset.ranges);
  EXPECT_THAT(WriteDescriptions(shard, dataset.manifest, ranges, 0),
              StatusIs(absl::StatusCode::kAlreadyExists, _));
  ISOSCOPE_ASSERT_OK(io::CreateDirectory(temp.Sub("bare")));
  EXPECT_THAT(WriteDescriptions(temp.Sub("bare"), dataset.manifest, ranges, 0),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr(kIntervalTreeFileName)));
  ISOSCOPE_ASSERT_OK(io::CreateDirectory(temp.Sub("empty")));
  EXPECT_THAT(WriteDescriptions(temp.Sub("empty"), dataset.manifest, -1),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr(kRangeTableFileName)));
  EXPECT_FALSE(io::PathExists(temp.Sub("bare/") + kManifestFileName));
}

TEST(ShardWriterTest, BlocksOfAShardAreInTheOrderOfBlocks) {
  const auto layout = volume::BlockLayout::Make({5, 5, 5}, {1, 1, 1}).value();  // 4 x 4 x 4 blocks
  std::vector<std::uint16_t> shard_of_block(64, 0);
  shard_of_block[5] = 2;
  const auto blocks = BlocksByShard(layout, shard_of_block, 3);
  ASSERT_EQ(blocks.size(), 3u);
  EXPECT_TRUE(blocks[1].empty());
  EXPECT_THAT(blocks[2], ElementsAre(5u));
  ASSERT_EQ(blocks[0].size(), 63u);
  // Along the curve, without block 5.
  EXPECT_THAT(std::vector<volume::BlockId>(blocks[0].begin(), blocks[0].begin() + 9),
              ElementsAre(0u, 4u, 1u, 17u, 21u, 20u, 16u, 32u, 48u));
}

TEST(ShardWriterTest, DatasetIdDependsOnEverythingButNameAndId) {
  const TestDataset dataset;
  Manifest manifest = dataset.manifest;
  manifest.shards = {{.block_count = 6, .block_bytes = 500, .block_index_crc32c = 1}};
  const std::string id = ComputeDatasetId(manifest);
  EXPECT_EQ(id.size(), 32u);
  EXPECT_EQ(
      id, "12e761f2d0bbd266a466024a9a548d34");  // known value: ids must not change between versions
  const std::vector<void (*)(Manifest*)> changes = {
      [](Manifest* m) { m->source += "x"; },
      [](Manifest* m) { m->geometry.sample_dims.z += 1; },
      [](Manifest* m) { m->geometry.spacing.y = 2; },
      [](Manifest* m) { m->geometry.origin.x = 1; },
      [](Manifest* m) { m->geometry.direction.columns[2].x = 0.5; },
      [](Manifest* m) { m->scalar_type = volume::ScalarType::kInt8; },
      [](Manifest* m) { m->value_range.min = 1; },
      [](Manifest* m) { m->value_range.max = 1; },
      [](Manifest* m) { m->block_cells.x = 4; },
      [](Manifest* m) { m->distribution = Distribution::kGreedy; },
      [](Manifest* m) { m->seed = 8; },
      [](Manifest* m) { m->range_table_crc32c ^= 1; },
      [](Manifest* m) { m->shards[0].block_index_crc32c ^= 1; },
      [](Manifest* m) { m->shards.push_back({}); }};
  std::set<std::string> ids = {id};
  for (const auto& change : changes) {
    Manifest changed = manifest;
    change(&changed);
    ids.insert(ComputeDatasetId(changed));
  }
  EXPECT_EQ(ids.size(), changes.size() + 1);
  manifest.name = "renamed";
  manifest.dataset_id = "other";
  EXPECT_EQ(ComputeDatasetId(manifest), id);
}

}  // namespace
}  // namespace isoscope::store
