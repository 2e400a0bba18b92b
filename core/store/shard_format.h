// Names, constants and binary records of a dataset on disk (docs/format/dataset.md and shard.md,
// with the same names).

#ifndef ISOSCOPE_CORE_STORE_SHARD_FORMAT_H_
#define ISOSCOPE_CORE_STORE_SHARD_FORMAT_H_

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/units.h"
#include "core/volume/block_layout.h"

namespace isoscope::store {

// In the dataset directory and in each shard directory.
inline constexpr char kManifestFileName[] = "manifest.json";
inline constexpr char kRangeTableFileName[] = "ranges.bin";
// In a shard directory.
inline constexpr char kBlocksFileName[] = "blocks.bin";
inline constexpr char kBlockIndexFileName[] = "block_index.bin";
inline constexpr char kIntervalTreeFileName[] = "interval_tree.bin";
inline constexpr char kHistogramFileName[] = "histogram.bin";  // optional
// Names the shard that a shard directory holds: JSON with its own CRC-32C.
inline constexpr char kShardFileName[] = "shard.json";
// The same in a shard directory of a series.
inline constexpr char kSeriesShardFileName[] = "series_shard.json";

// "shard-00003-of-00016".
inline std::string ShardDirectoryName(int shard_index, int shard_count) {
  return absl::StrFormat("shard-%05d-of-%05d", shard_index, shard_count);
}

// "level_2": the folder of a level >= 1 in a shard directory of a volume.
inline std::string LevelDirectoryName(int level) { return absl::StrFormat("level_%d", level); }

inline constexpr int kMaxShardCount = 65536;

// Values of "format" and "format_version" in the JSON files.
inline constexpr absl::string_view kManifestFormat = "isoscope-dataset";
inline constexpr absl::string_view kShardFormat = "isoscope-shard";
inline constexpr int kFormatVersion = 1;
inline constexpr int kSeriesFormatVersion = 2;  // of manifests (series_manifest.h)
// Of manifests of either kind that need what earlier programs do not know, such as levels. Its
// member "kind" tells a volume from a series, and "requires" lists what a reader must know.
inline constexpr int kExtendedFormatVersion = 3;
inline constexpr absl::string_view kVolumeKind = "volume";
inline constexpr absl::string_view kSeriesKind = "series";
inline constexpr absl::string_view kLevelsFeature = "levels";
inline constexpr absl::string_view kIndexOnlyFeature = "index_only";  // of volumes alone

// Larger files are refused before memory is allocated for them. The largest manifest, of
// kMaxShardCount shards, takes about 9 MiB.
inline constexpr std::int64_t kMaxManifestBytes = 16 * base::kMiB;
// One of kMaxScalarVolumes, 200 bytes each, takes about 40 MiB.
inline constexpr std::int64_t kMaxSeriesManifestBytes = 64 * base::kMiB;
inline constexpr std::int64_t kMaxShardFileBytes = base::kMiB;

// The CRC-32C of this many first bytes of the interval tree is verified when a shard is opened.
inline constexpr std::int64_t kIntervalTreeHeadBytes = 4 * base::kKiB;

// The header of the binary files, kBinaryHeaderBytes long. Offsets in it:
//
//   0 magic, 8 bytes           4 bytes each: 8 version, 12 header CRC-32C, 16 scalar type,
//   24 count, 8 bytes          20 entry size, 32 payload CRC-32C
//   40 payload size, 8 bytes   the rest is reserved: written as 0, ignored when read
inline constexpr std::size_t kBinaryHeaderBytes = 64;
inline constexpr absl::string_view kRangeTableMagic = "ISORANGE";
inline constexpr absl::string_view kBlockIndexMagic = "ISOBLKIX";
inline constexpr absl::string_view kHistogramMagic = "ISOHISTO";
inline constexpr std::uint32_t kBinaryVersion = 1;

struct BinaryHeader {
  std::uint32_t scalar_type = 0;
  std::uint32_t entry_size = 0;
  std::int64_t count = 0;            // entries
  std::uint32_t payload_crc32c = 0;  // of all bytes after the header
  std::int64_t data_size = 0;        // block index: size of blocks.bin; others: 0
};

// `magic` has 8 characters.
std::string EncodeBinaryHeader(absl::string_view magic, const BinaryHeader& header);
// Decodes the header of a binary file and verifies magic, version, both checksums and the size.
// `bytes` is the whole file. DATA_LOSS naming `where` if it is damaged, FAILED_PRECONDITION if it
// has a newer version.
absl::StatusOr<BinaryHeader> DecodeBinaryFile(absl::string_view magic, absl::string_view bytes,
                                              absl::string_view where);

// The encoding of a block's stored bytes. On disk: never change the values. Samples wider than a
// byte are shuffled before LZ4 or Zstandard compress them (docs/format/shard.md, "blocks.bin"). An overhang
// (block_overhang.h) is of an index-only shard.
enum class BlockEncoding : std::uint32_t {
  kRaw = 0,
  kLz4 = 1,
  kZstd = 2,
  kPacked = 3,
  kOverhang = 4
};
inline constexpr BlockEncoding kLastBlockEncoding = BlockEncoding::kOverhang;

// An entry of the block index. Offsets in it: 0 block id, 4 encoding, 8 offset (8 bytes), 16 stored
// size, 20 raw size, 24 CRC-32C of the stored bytes, 28 reserved.
inline constexpr std::size_t kBlockIndexEntryBytes = 32;
struct BlockIndexEntry {
  volume::BlockId block_id = 0;
  std::uint32_t encoding = 0;  // a BlockEncoding, or one of a later version
  std::int64_t offset = 0;
  std::uint32_t size = 0;
  std::uint32_t raw_size = 0;
  std::uint32_t crc32c = 0;
};
std::string EncodeBlockIndexEntry(const BlockIndexEntry& entry);
// Reads kBlockIndexEntryBytes. Any bytes are accepted: the caller checks the values.
BlockIndexEntry DecodeBlockIndexEntry(const char* bytes);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SHARD_FORMAT_H_
