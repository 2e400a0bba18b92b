// A small dataset, read unchanged, damaged, and with planned reads:
//
// - every sample type and number of shards comes back;
// - every flipped bit, truncation and extension of every file is noticed;
// - files of other shards, and consistent lies behind right checksums, are refused;
// - disk runs follow their definition (RunPlanTest), for random and for all small subsets.

#include "core/store/shard_reader.h"

#include <algorithm>
#include <bit>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "core/store/sealed_json.h"
#include "tests/support/fault_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::MakeFaultyFile;
using ::isoscope::testing::ReadFault;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::_;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr const char* kShardFiles[] = {kManifestFileName, kRangeTableFileName,
                                       kShardFileName,    kBlockIndexFileName,
                                       kBlocksFileName,   kIntervalTreeFileName};

std::string Slurp(const std::string& path) { return io::ReadWholeFile(path, base::kGiB).value(); }

void Overwrite(const std::string& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

// Stands for a file of these bytes: thousands of damaged versions need no disk.
class MemoryFile : public io::RandomAccessFile {
 public:
  MemoryFile(std::string path, std::string bytes)
      : path_(std::move(path)), bytes_(std::move(bytes)) {}
  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    if (offset > size_bytes() || size > bytes_.size() - static_cast<std::size_t>(offset)) {
      return absl::DataLossError(path_ + ": too short");
    }
    bytes_.copy(out, size, static_cast<std::size_t>(offset));
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t size_bytes() const override {
    return static_cast<std::int64_t>(bytes_.size());
  }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::string path_;
  const std::string bytes_;
};

// Expects an error of a damaged shard: never OK, and never a code that means a fault of the
// program.
void ExpectRefused(const absl::Status& status, const std::string& what) {
  EXPECT_TRUE(status.code() == absl::StatusCode::kDataLoss ||
              status.code() == absl::StatusCode::kFailedPrecondition)
      << what << ": " << status;
}

class ShardReaderTest : public ::testing::Test {
 protected:
  void WriteDataset(TestDataset* dataset) {
    dataset_directory_ = temp_.Sub("tiny");
    ISOSCOPE_ASSERT_OK(dataset->Write(dataset_directory_));
    shard_directory_ =
        dataset_directory_ + "/" + ShardDirectoryName(0, static_cast<int>(dataset->blocks.size()));
  }
  [[nodiscard]] std::string ShardFile(const std::string& name) const {
    return shard_directory_ + "/" + name;
  }
  // All files of the shard, by name.
  [[nodiscard]] std::map<std::string, std::string> LoadFiles() const {
    std::map<std::string, std::string> files;
    for (const char* name : kShardFiles) {
      files[name] = Slurp(ShardFile(name));
    }
    return files;
  }
  // Opens the shard and reads all of it from memory.
  [[nodiscard]] absl::Status ReadFrom(const std::map<std::string, std::string>& files) const {
    const auto open_file =
        [&](const std::string& path) -> absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> {
      return std::make_unique<MemoryFile>(path, files.at(path.substr(path.rfind('/') + 1)));
    };
    return ReadShard(shard_directory_, open_file).status();
  }
  // Writes a JSON file whose text differs but whose seal is right.
  void Reseal(const std::string& name, const std::string& from, const std::string& to) {
    std::string text = Slurp(ShardFile(name));
    const std::size_t at = text.find(from);
    ASSERT_NE(at, std::string::npos);
    text.replace(at, from.size(), to);
    text.replace(text.find("\"crc32c\": \"") + 11, 8, "00000000");
    Overwrite(ShardFile(name), SealJson(text));
  }

  // Replaces the entries of the block index; checksums and descriptions agree with them.
  void ReplaceBlockIndex(const TestDataset& dataset, const std::string& entries) {
    const std::string index =
        EncodeBinaryHeader(kBlockIndexMagic,
                           {.scalar_type = 1,
                            .entry_size = kBlockIndexEntryBytes,
                            .count = dataset.layout.block_count(),
                            .payload_crc32c = base::Crc32c(entries),
                            .data_size = dataset.manifest.shards[0].block_bytes}) +
        entries;
    Manifest manifest = dataset.manifest;
    manifest.shards[0].block_index_crc32c = base::Crc32c(index);
    for (const char* name : {kManifestFileName, kShardFileName, kRangeTableFileName}) {
      ISOSCOPE_ASSERT_OK(io::RemoveRecursively(ShardFile(name)));
    }
    ISOSCOPE_ASSERT_OK(
        WriteDescriptions(shard_directory_, manifest, EncodeRangeTable(dataset.ranges), 0));
    Overwrite(ShardFile(kBlockIndexFileName), index);
  }

  TempDir temp_;
  std::string dataset_directory_;
  std::string shard_directory_;
};

TEST_F(ShardReaderTest, EverySampleTypeAndShardCountComesBackUnchanged) {
  for (int type_number = 1; type_number <= 8; ++type_number) {
    for (const int shard_count : {1, 2, 6}) {
      const auto type = static_cast<volume::ScalarType>(type_number);
      TestDataset dataset(type, shard_count);
      const std::string directory =
          temp_.Sub(std::to_string(type_number) + "-" + std::to_string(shard_count));
      ISOSCOPE_ASSERT_OK(dataset.Write(directory));
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DatasetDescription description, OpenDataset(directory));
      EXPECT_EQ(description.manifest, dataset.manifest);
      EXPECT_EQ(description.ranges.bytes(), dataset.ranges.bytes());
      ASSERT_EQ(description.shard_directories.size(), static_cast<std::size_t>(shard_count));
      std::size_t seen = 0;
      for (std::size_t shard = 0; shard < description.shard_directories.size(); ++shard) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader,
                                      ShardReader::Open(description.shard_directories[shard]));
        EXPECT_EQ(reader->shard_index(), static_cast<int>(shard));
        EXPECT_EQ(reader->manifest(), dataset.manifest);
        EXPECT_EQ(reader->ranges().bytes(), dataset.ranges.bytes());
        EXPECT_EQ(reader->block_count(), static_cast<std::int64_t>(dataset.blocks[shard].size()));
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto blocks,
                                      ReadShard(description.shard_directories[shard]));
        ASSERT_EQ(blocks.size(), dataset.blocks[shard].size());
        for (std::size_t i = 0; i < blocks.size(); ++i) {
          EXPECT_EQ(blocks[i].first, dataset.blocks[shard][i]);
          EXPECT_EQ(blocks[i].second, SamplesOf(dataset.layout, blocks[i].first, type));
        }
        seen += blocks.size();
      }
      EXPECT_EQ(seen, static_cast<std::size_t>(dataset.layout.block_count()));
    }
  }
}

TEST_F(ShardReaderTest, EveryFlippedBitOfEveryFileIsNoticed) {
  TestDataset dataset;
  WriteDataset(&dataset);
  std::map<std::string, std::string> files = LoadFiles();
  ISOSCOPE_ASSERT_OK(ReadFrom(files));
  for (auto& [name, bytes] : files) {
    ASSERT_FALSE(bytes.empty());
    const std::string original = bytes;
    for (std::size_t bit = 0; bit < 8 * original.size(); ++bit) {
      bytes[bit / 8] =
          static_cast<char>(static_cast<unsigned char>(original[bit / 8]) ^ (1u << (bit % 8)));
      const absl::Status status = ReadFrom(files);
      ASSERT_EQ(status.code(), absl::StatusCode::kDataLoss)
          << name << " bit " << bit << ": " << status;
      ASSERT_THAT(std::string(status.message()), HasSubstr(name));
      bytes[bit / 8] = original[bit / 8];
    }
  }
  ISOSCOPE_EXPECT_OK(ReadFrom(files));
}

TEST_F(ShardReaderTest, EveryTruncationAndEveryExtensionOfEveryFileIsNoticed) {
  TestDataset dataset;
  WriteDataset(&dataset);
  std::map<std::string, std::string> files = LoadFiles();
  for (auto& [name, bytes] : files) {
    const std::string original = bytes;
    for (std::size_t size = 0; size < original.size(); ++size) {
      bytes = original.substr(0, size);
      ASSERT_THAT(ReadFrom(files), StatusIs(absl::StatusCode::kDataLoss, _))
          << name << " cut to " << size;
    }
    for (const std::string& extra : {std::string(1, '\0'), std::string("\n"), original}) {
      bytes = original + extra;
      ASSERT_THAT(ReadFrom(files), StatusIs(absl::StatusCode::kDataLoss, _))
          << name << " with " << extra.size() << " more bytes";
    }
    bytes = original;
  }
}

TEST_F(ShardReaderTest, DatasetFilesAreVerifiedToo) {
  TestDataset dataset;
  WriteDataset(&dataset);
  for (const char* name : {kManifestFileName, kRangeTableFileName}) {
    const std::string path = dataset_directory_ + "/" + name;
    const std::string original = Slurp(path);
    for (std::size_t byte = 0; byte < original.size(); byte += 5) {
      std::string damaged = original;
      damaged[byte] = static_cast<char>(static_cast<unsigned char>(damaged[byte]) ^ 0x20u);
      Overwrite(path, damaged);
      ASSERT_THAT(OpenDataset(dataset_directory_), StatusIs(absl::StatusCode::kDataLoss, _))
          << name << " byte " << byte;
    }
    Overwrite(path, original);
  }
}

TEST_F(ShardReaderTest, MissingFileIsNamed) {
  TestDataset dataset;
  WriteDataset(&dataset);
  for (const char* name : {kRangeTableFileName, kShardFileName, kBlockIndexFileName,
                           kBlocksFileName, kIntervalTreeFileName}) {
    const std::string aside = temp_.Sub("aside");
    ISOSCOPE_ASSERT_OK(io::RenamePath(ShardFile(name), aside));
    EXPECT_THAT(
        ReadShard(shard_directory_),
        StatusIs(absl::StatusCode::kDataLoss, AllOf(HasSubstr(name), HasSubstr("is missing"))));
    ISOSCOPE_ASSERT_OK(io::RenamePath(aside, ShardFile(name)));
  }
}

TEST_F(ShardReaderTest, UnfinishedDirectoriesAreRefused) {
  EXPECT_THAT(ShardReader::Open(temp_.Sub("nothing")), StatusIs(absl::StatusCode::kNotFound, _));
  EXPECT_THAT(OpenDataset(temp_.Sub("nothing")), StatusIs(absl::StatusCode::kNotFound, _));
  TestDataset dataset;
  WriteDataset(&dataset);
  EXPECT_TRUE(IsDatasetDirectory(dataset_directory_));
  EXPECT_FALSE(IsDatasetDirectory(shard_directory_));
  EXPECT_TRUE(IsShardDirectory(shard_directory_));
  EXPECT_FALSE(IsShardDirectory(dataset_directory_));
  EXPECT_THAT(ShardReader::Open(dataset_directory_),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("shard-*-of-*")));
  EXPECT_THAT(OpenDataset(shard_directory_), StatusIs(absl::StatusCode::kFailedPrecondition, _));

  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(ShardFile(kManifestFileName)));
  EXPECT_THAT(ShardReader::Open(shard_directory_),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("did not finish")));
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(dataset_directory_ + "/" + kManifestFileName));
  EXPECT_THAT(OpenDataset(dataset_directory_),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("isoscope partition")));
}

TEST_F(ShardReaderTest, FilesOfAnotherShardOrDatasetAreRefused) {
  TestDataset dataset(volume::ScalarType::kUint8, 2);
  WriteDataset(&dataset);
  TestDataset other(volume::ScalarType::kInt8, 2);  // same sizes
  ISOSCOPE_ASSERT_OK(other.Write(temp_.Sub("other")));
  for (const std::string& foreign : {temp_.Sub("other") + "/" + ShardDirectoryName(0, 2),
                                     dataset_directory_ + "/" + ShardDirectoryName(1, 2)}) {
    for (const char* name :
         {kRangeTableFileName, kShardFileName, kBlockIndexFileName, kManifestFileName}) {
      const std::string original = Slurp(ShardFile(name));
      const std::string replacement = Slurp(foreign + "/" + name);
      if (original == replacement) {
        continue;  // shared by all shards of a dataset
      }
      Overwrite(ShardFile(name), replacement);
      if (name == std::string(kShardFileName) && foreign.find("other") == std::string::npos) {
        // Then the index of shard 0 lies beside the description of shard 1.
        EXPECT_THAT(ReadShard(shard_directory_),
                    StatusIs(absl::StatusCode::kDataLoss, HasSubstr(kBlockIndexFileName)));
      } else {
        EXPECT_THAT(ReadShard(shard_directory_),
                    StatusIs(absl::StatusCode::kDataLoss, HasSubstr(shard_directory_)))
            << name << " from " << foreign;
      }
      Overwrite(ShardFile(name), original);
    }
  }
}

TEST_F(ShardReaderTest, ConsistentlySealedButWrongDescriptionsAreRefused) {
  TestDataset dataset;
  WriteDataset(&dataset);
  const std::string shard = Slurp(ShardFile(kShardFileName));
  const std::pair<const char*, const char*> edits[] = {
      {"\"shard_index\": 0", "\"shard_index\": 1"},
      {"\"shard_index\": 0", "\"shard_index\": -1"},
      {"\"shard_index\": 0", "\"shard_index\": 18446744073709551615"},
      {"\"shard_index\": 0", "\"shard_index\": 0.5"},
      {"\"shard_index\": 0", "\"shard_index\": {}"},
      {"\"shard_count\": 1", "\"shard_count\": 2"},
      {"\"blocks_bytes\": ", "\"blocks_bytes\": 1"},
      {"\"interval_tree_bytes\": ", "\"interval_tree_bytes\": 9000000000"},
      {"\"dataset_id\": \"", "\"dataset_id\": \"0"},
      {"isoscope-shard", "isoscope-dataset"},
      {"\"manifest_crc32c\": \"", "\"manifest_crc32c\": \"0"},
      {"\"format_version\": 1", "\"format_version\": 0"},
  };
  for (const auto& [from, to] : edits) {
    Reseal(kShardFileName, from, to);
    EXPECT_THAT(ReadShard(shard_directory_), StatusIs(absl::StatusCode::kDataLoss, _)) << to;
    Overwrite(ShardFile(kShardFileName), shard);
  }
  Reseal(kShardFileName, "\"format_version\": 1", "\"format_version\": 2");
  EXPECT_THAT(ReadShard(shard_directory_),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("newer program")));
  Overwrite(ShardFile(kShardFileName), shard);
  Reseal(kShardFileName, "\"shard_index\": 0", "\"later_member\": [1, {}], \"shard_index\": 0");
  EXPECT_THAT(ReadShard(shard_directory_), IsOk());
}

TEST_F(ShardReaderTest, HostileBlockIndexEntriesAreRefusedEvenWithRightChecksums) {
  TestDataset dataset;
  WriteDataset(&dataset);
  const std::string original = Slurp(ShardFile(kBlockIndexFileName));
  const struct {
    std::size_t offset;
    std::uint32_t value;
  } edits[] = {{0, 0xffffffff},  {0, 5},  {4, 1},          {8, 1},
               {12, 0x80000000}, {16, 0}, {20, 0xffffffff}};
  for (const auto& edit : edits) {
    for (const std::size_t ordinal : {std::size_t{0}, std::size_t{2}}) {
      std::string payload = original.substr(kBinaryHeaderBytes);
      base::StoreLittleEndian(edit.value,
                              payload.data() + ordinal * kBlockIndexEntryBytes + edit.offset);
      ReplaceBlockIndex(dataset, payload);
      ExpectRefused(ReadShard(shard_directory_).status(),
                    "entry " + std::to_string(ordinal) + " offset " + std::to_string(edit.offset));
    }
  }
}

TEST_F(ShardReaderTest, AnUnknownEncodingIsNamedAndAsksForANewerProgram) {
  TestDataset dataset;
  WriteDataset(&dataset);
  std::string payload = Slurp(ShardFile(kBlockIndexFileName)).substr(kBinaryHeaderBytes);
  base::StoreLittleEndian(std::uint32_t{5}, payload.data() + kBlockIndexEntryBytes + 4);
  ReplaceBlockIndex(dataset, payload);
  EXPECT_THAT(ReadShard(shard_directory_),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       HasSubstr("encoding 5, this program reads 0 to 4; use a newer program")));
}

TEST_F(ShardReaderTest, AnOverhangNeedsASource) {
  TestDataset dataset;
  WriteDataset(&dataset);
  std::string payload = Slurp(ShardFile(kBlockIndexFileName)).substr(kBinaryHeaderBytes);
  base::StoreLittleEndian(std::uint32_t{4}, payload.data() + kBlockIndexEntryBytes + 4);
  base::StoreLittleEndian(std::uint32_t{5}, payload.data() + kBlockIndexEntryBytes + 16);
  ReplaceBlockIndex(dataset, payload);
  EXPECT_THAT(ReadShard(shard_directory_),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("stored (overhang)")));
}

TEST_F(ShardReaderTest, BlocksMayLieInAnyOrder) {
  TestDataset dataset;
  WriteDataset(&dataset);
  const std::string index = Slurp(ShardFile(kBlockIndexFileName));
  const std::string blocks = Slurp(ShardFile(kBlocksFileName));
  std::string payload;
  std::string reversed;
  for (std::size_t at = index.size(); at > kBinaryHeaderBytes; at -= kBlockIndexEntryBytes) {
    BlockIndexEntry entry = DecodeBlockIndexEntry(index.data() + at - kBlockIndexEntryBytes);
    const std::string samples = blocks.substr(static_cast<std::size_t>(entry.offset), entry.size);
    entry.offset = static_cast<std::int64_t>(reversed.size());
    payload += EncodeBlockIndexEntry(entry);
    reversed += samples;
  }
  ReplaceBlockIndex(dataset, payload);
  Overwrite(ShardFile(kBlocksFileName), reversed);
  EXPECT_THAT(ReadShard(shard_directory_), IsOk());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader, ShardReader::Open(shard_directory_));
  ASSERT_EQ(reader->block_count(), dataset.layout.block_count());
  EXPECT_EQ(reader->block_id(0), dataset.blocks[0].back());
}

TEST_F(ShardReaderTest, ReadErrorsNameDatasetAndShard) {
  TestDataset dataset;
  WriteDataset(&dataset);
  const std::int64_t size = dataset.manifest.shards[0].block_bytes;
  for (const ReadFault fault :
       {ReadFault::kIoError, ReadFault::kShortRead, ReadFault::kFlippedBit}) {
    for (std::int64_t offset = 0; offset < size; offset += 37) {
      const auto open_file =
          [&](const std::string& path) -> absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> {
        ISOSCOPE_ASSIGN_OR_RETURN(auto file, io::OpenRandomAccessFile(path));
        if (path != ShardFile(kBlocksFileName)) {
          return file;
        }
        return MakeFaultyFile(std::move(file), fault, offset);
      };
      EXPECT_THAT(ReadShard(shard_directory_, open_file),
                  StatusIs(absl::StatusCode::kDataLoss,
                           AllOf(HasSubstr("dataset tiny (" + dataset.manifest.dataset_id +
                                           "), shard 0 of 1"),
                                 HasSubstr(ShardFile(kBlocksFileName)))));
    }
  }
}

TEST_F(ShardReaderTest, DamagedBlockIsNamedWithOffsetAndBothChecksums) {
  TestDataset dataset;
  WriteDataset(&dataset);
  std::string bytes = Slurp(ShardFile(kBlocksFileName));
  const volume::BlockId second = dataset.blocks[0][1];
  const std::size_t offset =
      volume::StoredSizeBytes(dataset.layout, dataset.blocks[0][0], volume::ScalarType::kUint8);
  bytes[offset] = static_cast<char>(bytes[offset] + 1);
  Overwrite(ShardFile(kBlocksFileName), bytes);
  EXPECT_THAT(ReadShard(shard_directory_),
              StatusIs(absl::StatusCode::kDataLoss,
                       AllOf(HasSubstr("block " + std::to_string(second) + ":"),
                             HasSubstr("at offset " + std::to_string(offset) + " of "),
                             HasSubstr(" stored, 0x"), HasSubstr(" computed"))));
}

TEST_F(ShardReaderTest, VisitorErrorStopsTheRun) {
  TestDataset dataset;
  WriteDataset(&dataset);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader, ShardReader::Open(shard_directory_));
  const std::vector<std::uint32_t> ordinals = {1, 2, 3};
  const std::vector<ShardReader::DiskRun> runs = reader->PlanDiskRuns(ordinals);
  ASSERT_EQ(runs.size(), 1u);
  std::vector<char> buffer(static_cast<std::size_t>(runs[0].size));
  std::vector<volume::BlockId> visited;
  EXPECT_THAT(reader->ReadDiskRun(runs[0], ordinals, buffer.data(),
                                  [&](const volume::BlockSamples& block) -> absl::Status {
                                    visited.push_back(block.block_id);
                                    return visited.size() == 2 ? absl::CancelledError("enough")
                                                               : absl::OkStatus();
                                  }),
              StatusIs(absl::StatusCode::kCancelled, _));
  EXPECT_THAT(visited, ::testing::ElementsAre(dataset.blocks[0][1], dataset.blocks[0][2]));
}

// Plans of disk runs for a dataset of many blocks, and their definition.
class RunPlanTest : public ShardReaderTest {
 protected:
  void Open(const math::Index3& sample_dims, std::int64_t edge) {
    TestDataset dataset;
    dataset.manifest.geometry.sample_dims = sample_dims;
    dataset.manifest.block_cells = {edge, edge, edge};
    dataset.layout = volume::BlockLayout::Make(sample_dims, {edge, edge, edge}).value();
    const std::int64_t block_count = dataset.layout.block_count();
    dataset.ranges = volume::RangeTable(volume::ScalarType::kUint8, block_count);
    dataset.blocks = BlocksByShard(
        dataset.layout, std::vector<std::uint16_t>(static_cast<std::size_t>(block_count)), 1);
    WriteDataset(&dataset);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(reader_, ShardReader::Open(shard_directory_));
    std::int64_t offset = 0;
    for (const volume::BlockId id : dataset.blocks[0]) {
      const auto size = static_cast<std::int64_t>(
          volume::StoredSizeBytes(dataset.layout, id, volume::ScalarType::kUint8));
      blocks_.push_back({offset, size});
      offset += size;
    }
  }

  // Each block with the given chance.
  [[nodiscard]] std::vector<std::uint32_t> RandomOrdinals(std::uint64_t seed, double share) const {
    std::vector<std::uint32_t> ordinals;
    for (std::uint32_t ordinal = 0; ordinal < blocks_.size(); ++ordinal) {
      if (base::RandomUnit(seed, ordinal) < share) {
        ordinals.push_back(ordinal);
      }
    }
    return ordinals;
  }

  // The gap before each of the ordinals but the first.
  [[nodiscard]] std::vector<std::int64_t> GapsOf(const std::vector<std::uint32_t>& ordinals) const {
    std::vector<std::int64_t> gaps;
    for (std::size_t i = 1; i < ordinals.size(); ++i) {
      const Extent& before = blocks_[ordinals[i - 1]];
      gaps.push_back(blocks_[ordinals[i]].offset - before.offset - before.size);
    }
    return gaps;
  }

  // Checks a plan by its definition. Counts the cases, so that a test can require each of them.
  void Check(const std::vector<std::uint32_t>& ordinals) {
    const std::vector<ShardReader::DiskRun> runs = reader_->PlanDiskRuns(ordinals);
    const std::vector<std::int64_t> gaps = GapsOf(ordinals);
    std::int64_t useful_bytes = 0;
    for (const std::uint32_t ordinal : ordinals) {
      useful_bytes += blocks_[ordinal].size;
    }
    const auto budget =
        static_cast<std::int64_t>(ShardReader::kMaxGapShare * static_cast<double>(useful_bytes));
    // The smallest gaps that the budget takes in all.
    std::vector<std::int64_t> sorted = gaps;
    std::sort(sorted.begin(), sorted.end());
    std::int64_t sum = 0;
    std::size_t affordable = 0;
    while (affordable < sorted.size() && sum + sorted[affordable] <= budget) {
      sum += sorted[affordable++];
    }

    std::size_t next = 0;
    std::int64_t read_bytes = 0;
    std::size_t merge_count = 0;
    std::size_t limit_count = 0;
    std::int64_t largest_merged = 0;
    std::int64_t smallest_left = std::numeric_limits<std::int64_t>::max();
    for (std::size_t i = 0; i < runs.size(); ++i) {
      const ShardReader::DiskRun& run = runs[i];
      ASSERT_EQ(run.first, next);
      ASSERT_GE(run.count, 1u);
      ASSERT_LE(run.first + run.count, ordinals.size());
      next += run.count;
      const Extent& first = blocks_[ordinals[run.first]];
      const Extent& last = blocks_[ordinals[next - 1]];
      EXPECT_EQ(run.offset, first.offset);
      EXPECT_EQ(run.offset + run.size, last.offset + last.size);
      EXPECT_TRUE(run.size <= ShardReader::kMaxDiskRunBytes || run.count == 1) << run.size;
      read_bytes += run.size;
      merge_count += run.count - 1;
      for (std::size_t j = run.first; j + 1 < next; ++j) {
        largest_merged = std::max(largest_merged, gaps[j]);
      }
      if (i > 0) {
        const ShardReader::DiskRun& before = runs[i - 1];
        if (first.offset + first.size - before.offset > ShardReader::kMaxDiskRunBytes) {
          ++limit_count;  // whatever the gap
        } else {
          smallest_left = std::min(smallest_left, gaps[run.first - 1]);
        }
      }
    }
    EXPECT_EQ(next, ordinals.size());
    const std::int64_t gap_bytes = read_bytes - useful_bytes;
    EXPECT_LE(gap_bytes, budget) << "of " << useful_bytes << " useful bytes";
    // The smallest gaps, and as many as the budget takes.
    EXPECT_LE(largest_merged, smallest_left);
    EXPECT_GE(merge_count + limit_count, affordable);
    EXPECT_LE(merge_count, affordable);
    bridged_count_ += gap_bytes > 0 ? 1 : 0;
    left_count_ += smallest_left < std::numeric_limits<std::int64_t>::max() ? 1 : 0;
    limited_count_ += limit_count > 0 ? 1 : 0;
  }

  struct Extent {
    std::int64_t offset = 0;
    std::int64_t size = 0;
  };
  std::unique_ptr<ShardReader> reader_;
  std::vector<Extent> blocks_;  // by ordinal
  int bridged_count_ = 0;
  int left_count_ = 0;
  int limited_count_ = 0;
};

TEST_F(RunPlanTest, ReadsOverTheSmallestGapsAndNoMoreThanItsShareOfManySmallBlocks) {
  // 1400 blocks of 4 to 7 samples an edge: gaps of all sizes.
  ASSERT_NO_FATAL_FAILURE(Open({38, 55, 40}, 4));
  ASSERT_EQ(blocks_.size(), 1400U);
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE(seed);
    const double share = base::RandomUnit(seed, 1'000'000);
    Check(RandomOrdinals(seed, seed % 2 == 0 ? share : 0.85 + 0.15 * share));
    if (HasFailure()) {
      return;
    }
  }
  EXPECT_GT(bridged_count_, 100);
  EXPECT_GT(left_count_, 50);
}

TEST_F(RunPlanTest, KeepsTheLargestRunOfLargeBlocks) {
  // 24 blocks of 33^3 to 35^3 samples: about 39 KB each, so that a run takes some 26.
  ASSERT_NO_FATAL_FAILURE(Open({65, 97, 257}, 32));
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    SCOPED_TRACE(seed);
    Check(
        RandomOrdinals(seed, seed % 4 == 0 ? 1.0 : 0.8 + 0.2 * base::RandomUnit(seed, 1'000'000)));
    if (HasFailure()) {
      return;
    }
  }
  EXPECT_GT(bridged_count_, 100);
  EXPECT_GT(limited_count_, 100);
}

TEST_F(RunPlanTest, EverySubsetOfAFewBlocksIsPlannedRight) {
  ASSERT_NO_FATAL_FAILURE(Open({17, 13, 9}, 4));
  ASSERT_EQ(blocks_.size(), 24U);
  for (unsigned subset = 0; subset < 1u << 12; ++subset) {
    std::vector<std::uint32_t> ordinals;
    for (std::uint32_t ordinal = 0; ordinal < 24; ++ordinal) {
      // A window, among all blocks after it.
      if (ordinal >= 12 || (subset >> ordinal & 1) != 0) {
        ordinals.push_back(ordinal);
      }
    }
    Check(ordinals);
    ordinals.resize(static_cast<std::size_t>(std::popcount(subset)));  // the window alone
    Check(ordinals);
    if (HasFailure()) {
      FAIL() << "subset " << subset;
    }
  }
  EXPECT_GT(bridged_count_, 100);
  EXPECT_GT(left_count_, 60);
  EXPECT_TRUE(reader_->PlanDiskRuns({}).empty());
}

TEST_F(RunPlanTest, BlocksOfARunThatReadsOverGapsComeBackUnchanged) {
  ASSERT_NO_FATAL_FAILURE(Open({38, 55, 40}, 4));
  const std::vector<std::uint32_t> ordinals = RandomOrdinals(3, 0.9);
  std::vector<volume::BlockId> visited;
  bool has_gap = false;
  for (const ShardReader::DiskRun& run : reader_->PlanDiskRuns(ordinals)) {
    std::vector<char> buffer(static_cast<std::size_t>(run.size));
    std::int64_t useful_bytes = 0;
    ISOSCOPE_ASSERT_OK(
        reader_->ReadDiskRun(run, ordinals, buffer.data(), [&](const volume::BlockSamples& block) {
          const std::string expected =
              SamplesOf(reader_->layout(), block.block_id, volume::ScalarType::kUint8);
          EXPECT_EQ(std::string(block.bytes, expected.size()), expected) << block.block_id;
          EXPECT_GE(block.bytes, buffer.data());
          EXPECT_LE(block.bytes + expected.size(), buffer.data() + buffer.size());
          useful_bytes += static_cast<std::int64_t>(expected.size());
          visited.push_back(block.block_id);
          return absl::OkStatus();
        }));
    has_gap = has_gap || useful_bytes < run.size;
  }
  EXPECT_TRUE(has_gap);
  ASSERT_EQ(visited.size(), ordinals.size());
  for (std::size_t i = 0; i < ordinals.size(); ++i) {
    EXPECT_EQ(visited[i], reader_->block_id(ordinals[i]));
  }
}

}  // namespace
}  // namespace isoscope::store
