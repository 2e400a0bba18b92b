// Files of a dataset that several processes cut, each of them one part of it, until the parts are
// joined (docs/partitioning.md):
//
//   head.partial/parts/
//   ├── part-00003-of-00016.json          a run of part 3 has begun: what it cuts, and how (PartCut)
//   └── volume/                           or field-000-component-0-step-00000/ of a series
//       ├── part-00003-of-00016.try-a8Xd3q/   under way, with progress.json (PartProgress)
//       └── part-00003-of-00016/          finished
//           ├── piece.json                what it holds, with all checksums (PieceRecord)
//           ├── ranges.bin                of the blocks of the slab
//           ├── level_1.bin               samples of the planes of level 1, if there are levels
//           └── shard-00000-of-00002/     blocks.bin, block_index.bin, histogram.bin as in a shard;
//                                         spans.bin: two doubles a block, in the same order
//
// All are sealed JSON. Only processes of one version read them.

#ifndef ISOSCOPE_CORE_STORE_PART_FILE_H_
#define ISOSCOPE_CORE_STORE_PART_FILE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/units.h"
#include "core/store/manifest.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/volume/scalar_span.h"
#include "core/volume/volume_level.h"

namespace isoscope::store {

inline constexpr char kPieceFileName[] = "piece.json";
inline constexpr char kPartProgressFileName[] = "progress.json";
inline constexpr char kLevel1FileName[] = "level_1.bin";
inline constexpr char kSpansFileName[] = "spans.bin";
inline constexpr std::size_t kSpanBytes = 2 * sizeof(double);
inline constexpr int kMaxPartCount = 100'000;
inline constexpr std::int64_t kMaxPartFileBytes = 64 * base::kMiB;

// A part of a whole: 0 <= index < count.
struct PartNumber {
  int index = 0;
  int count = 1;

  friend bool operator==(const PartNumber&, const PartNumber&) = default;
};

// "part-00003-of-00016".
inline std::string PartName(const PartNumber& part) {
  return absl::StrFormat("part-%05d-of-%05d", part.index, part.count);
}
// Reads the number back from the front of a file's name. Not set: it is no name of a part.
std::optional<PartNumber> PartOfName(absl::string_view name);

// What all parts agree on. Only `part` differs.
struct PartCut {
  PartNumber part;
  // Name and value of everything that decides the bytes, for comparing and for messages.
  std::vector<std::pair<std::string, std::string>> members;
  std::string name;                      // of the dataset
  std::optional<SeriesManifest> series;  // without volumes; not set: a dataset of one volume
  std::vector<ScalarVolumeKey> keys;     // of the series' volumes

  // A digest of all but `part`.
  [[nodiscard]] std::string Digest() const;
};

// What a part has of one shard. No blocks: no folder.
struct ShardPiece {
  ShardSummary summary;
  std::uint32_t spans_crc32c = 0;
  std::uint32_t histogram_crc32c = 0;

  friend bool operator==(const ShardPiece&, const ShardPiece&) = default;
};

// What a part has of one scalar volume.
struct PieceRecord {
  PartNumber part;
  std::string cut_digest;  // PartCut::Digest
  // The manifest as far as the source and the cut tell it: one shard with all blocks.
  Manifest manifest;
  int highest_level = 0;
  volume::LevelFilter level_filter = volume::LevelFilter::kMean;
  BlockEncoding compression = BlockEncoding::kRaw;
  std::array<std::uint64_t, 4> digest_sum{};  // of the rows of the slab, lowest word first
  volume::ScalarSpan value_range;
  volume::ScalarSpan finite_range;
  double max_gradient_magnitude = 0;
  std::int64_t ranges_bytes = 0;  // 0: the part has no blocks
  std::uint32_t ranges_crc32c = 0;
  std::int64_t level1_bytes = 0;
  std::uint32_t level1_crc32c = 0;
  std::vector<ShardPiece> shards;  // by index
};

// How far a process is.
struct PartProgress {
  std::string phase;
  std::int64_t done_bytes = 0;
  std::int64_t total_bytes = 0;
  std::string host;
  std::int64_t process_id = 0;
  std::int64_t updated_unix_seconds = 0;  // by the clock of its machine
};

std::string EncodePartCut(const PartCut& cut);
std::string EncodePieceRecord(const PieceRecord& record);
std::string EncodePartProgress(const PartProgress& progress);

// DATA_LOSS, naming `where`: damaged, or it contradicts itself. FAILED_PRECONDITION: of a newer
// version.
absl::StatusOr<PartCut> DecodePartCut(absl::string_view bytes, absl::string_view where);
absl::StatusOr<PieceRecord> DecodePieceRecord(absl::string_view bytes, absl::string_view where);
absl::StatusOr<PartProgress> DecodePartProgress(absl::string_view bytes, absl::string_view where);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_PART_FILE_H_
