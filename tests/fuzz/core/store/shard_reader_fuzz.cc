// A shard's directory with one hostile file in it. The others are made to fit: checksums name the
// hostile bytes, so that the reader looks behind them.
//
//   0 any file with any bytes   2 entries of the block index, as the manifest expects them
//   1 shard.json, sealed        3 the blocks: an encoding and stored bytes for each of them
//
// Whatever is read has the size of its block; every error names the directory.

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include <nlohmann/json.hpp>

#include "core/base/crc32c.h"
#include "core/store/json_fields.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_reader.h"
#include "tests/fuzz/core/store/sealed_bytes.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/memory_file.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/store/shard_fixture.h"

namespace isoscope::fuzz {
namespace {

using Files = std::map<std::string, std::string>;  // by name

constexpr const char* kNames[] = {store::kManifestFileName, store::kRangeTableFileName,
                                  store::kShardFileName,    store::kBlockIndexFileName,
                                  store::kBlocksFileName,   store::kIntervalTreeFileName};

// A good shard, on disk and in memory.
class GoodShard {
 public:
  GoodShard() {
    const std::string dataset = temp_.Sub("tiny");
    Require(dataset_.Write(dataset).ok(), "a shard can be written");
    directory_ = absl::StrCat(dataset, "/", store::ShardDirectoryName(0, 1));
    for (const char* name : kNames) {
      auto bytes = io::ReadWholeFile(absl::StrCat(directory_, "/", name), 1 << 20);
      Require(bytes.ok(), "a shard has its files");
      files_[name] = *std::move(bytes);
    }
  }
  [[nodiscard]] const std::string& directory() const { return directory_; }
  [[nodiscard]] const Files& files() const { return files_; }
  [[nodiscard]] const store::TestDataset& dataset() const { return dataset_; }

 private:
  testing::TempDir temp_;
  store::TestDataset dataset_;
  std::string directory_;
  Files files_;
};

const GoodShard& Good() {
  static const GoodShard shard;
  return shard;
}

// Makes manifest and shard.json fit the block index and the blocks.
void Adopt(std::string index, std::string blocks, Files* files) {
  store::Manifest manifest = Good().dataset().manifest;
  manifest.shards[0].block_index_crc32c = base::Crc32c(index);
  manifest.shards[0].block_bytes = static_cast<std::int64_t>(blocks.size());
  manifest.dataset_id = store::ComputeDatasetId(manifest);
  const std::string text = store::EncodeManifest(manifest);
  const auto seal = store::VerifySeal(text, "manifest");
  Require(seal.ok(), "an encoded manifest is sealed");
  store::Json shard = store::Json::parse(files->at(store::kShardFileName));
  shard["dataset_id"] = manifest.dataset_id;
  shard["manifest_crc32c"] = store::JsonFromCrc32c(*seal);
  shard["block_index_crc32c"] = store::JsonFromCrc32c(manifest.shards[0].block_index_crc32c);
  shard["blocks_bytes"] = blocks.size();
  (*files)[store::kShardFileName] = SealedText(store::DumpJson(shard));
  (*files)[store::kManifestFileName] = text;
  (*files)[store::kBlockIndexFileName] = std::move(index);
  (*files)[store::kBlocksFileName] = std::move(blocks);
}

std::string IndexOf(absl::string_view entries, std::size_t block_bytes) {
  store::BinaryHeader header;
  header.scalar_type = static_cast<std::uint32_t>(Good().dataset().manifest.scalar_type);
  header.entry_size = store::kBlockIndexEntryBytes;
  header.count = static_cast<std::int64_t>(entries.size() / store::kBlockIndexEntryBytes);
  header.payload_crc32c = base::Crc32c(entries);
  header.data_size = static_cast<std::int64_t>(block_bytes);
  return store::EncodeBinaryHeader(store::kBlockIndexMagic, header) + std::string(entries);
}

// Entries that are right, of blocks stored as the input says.
void AdoptBlocks(Input input, Files* files) {
  const store::TestDataset& dataset = Good().dataset();
  std::string entries;
  std::string blocks;
  for (const volume::BlockId id : dataset.blocks[0]) {
    store::BlockIndexEntry entry;
    const std::uint8_t choice = input.Byte();
    const std::string stored(input.Piece());
    entry.block_id = id;
    entry.encoding = choice % 3;
    entry.offset = static_cast<std::int64_t>(blocks.size());
    entry.size = static_cast<std::uint32_t>(stored.size());
    entry.raw_size = static_cast<std::uint32_t>(
        volume::StoredSizeBytes(dataset.layout, id, dataset.manifest.scalar_type));
    entry.crc32c = base::Crc32c(stored) + (choice >= 250 ? 1 : 0);
    entries += store::EncodeBlockIndexEntry(entry);
    blocks += stored;
  }
  const std::size_t size = blocks.size();
  Adopt(IndexOf(entries, size), std::move(blocks), files);
}

void Run(Input input) {
  Files files = Good().files();
  const std::uint8_t mode = input.Byte();
  switch (mode % 4) {
    case 0:
      files[kNames[input.Byte() % std::size(kNames)]] = std::string(input.Rest());
      break;
    case 1:
      files[store::kShardFileName] = SealedText(input.Rest());
      break;
    case 2: {
      const std::string entries(
          input.Take(store::kBlockIndexEntryBytes * Good().dataset().blocks[0].size()));
      const std::string blocks = files[store::kBlocksFileName];
      Adopt(IndexOf(entries, blocks.size()), blocks, &files);
      break;
    }
    default:
      AdoptBlocks(input, &files);
  }
  const auto open =
      [&](const std::string& path) -> absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> {
    const auto found = files.find(path.substr(path.rfind('/') + 1));
    if (found == files.end()) {
      return absl::NotFoundError(path);
    }
    return std::make_unique<testing::MemoryReadFile>(found->second);
  };
  const auto blocks = store::ReadShard(Good().directory(), open);
  if (!blocks.ok()) {
    RequireError(blocks.status(),
                 {absl::StatusCode::kDataLoss, absl::StatusCode::kFailedPrecondition});
    return;
  }
  const store::TestDataset& dataset = Good().dataset();
  for (const auto& [id, bytes] : *blocks) {
    Require(
        bytes.size() == volume::StoredSizeBytes(dataset.layout, id, dataset.manifest.scalar_type),
        "a block has its size");
  }
}

}  // namespace

std::vector<std::string> Seeds() {
  const Files& files = Good().files();
  std::vector<std::string> seeds;
  for (std::size_t i = 0; i < std::size(kNames); ++i) {
    seeds.push_back(std::string{0, static_cast<char>(i)} + files.at(kNames[i]));
  }
  seeds.push_back("\1" + files.at(store::kShardFileName));
  seeds.push_back("\2" + files.at(store::kBlockIndexFileName).substr(store::kBinaryHeaderBytes));
  const store::TestDataset& dataset = Good().dataset();
  std::string blocks = "\3";
  for (const volume::BlockId id : dataset.blocks[0]) {
    blocks += std::string(1, '\0') +
              MakePiece(store::SamplesOf(dataset.layout, id, dataset.manifest.scalar_type));
  }
  seeds.push_back(blocks);
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
