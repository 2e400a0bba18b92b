// The manifest of a dataset, on which all its shards must agree. It is JSON that carries its own
// CRC-32C (docs/format/dataset.md). The dataset directory and each shard directory hold the same
// bytes.

#ifndef ISOSCOPE_CORE_STORE_MANIFEST_H_
#define ISOSCOPE_CORE_STORE_MANIFEST_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/store/sample_reader.h"
#include "core/volume/block_layout.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/label.h"
#include "core/volume/patient_frame.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"
#include "core/volume/volume_level.h"

namespace isoscope::store {

enum class Distribution { kRandom, kGreedy };
absl::string_view NameOf(Distribution distribution);
absl::StatusOr<Distribution> DistributionFromName(absl::string_view name);

struct ShardSummary {
  std::int64_t block_count = 0;
  std::int64_t block_bytes = 0;          // size of blocks.bin
  std::uint32_t block_index_crc32c = 0;  // of the whole index file: ties the shard to the dataset

  friend bool operator==(const ShardSummary&, const ShardSummary&) = default;
};

// A level >= 1 in the manifest of its volume. It has a folder in each shard, whose own manifest, of
// version 1, has the rest; values there are stored ones (volume::VolumeLevel::value_scale).
struct LevelSummary {
  std::string dataset_id;             // of the level's manifest
  std::uint32_t manifest_crc32c = 0;  // of it

  friend bool operator==(const LevelSummary&, const LevelSummary&) = default;
};

struct Manifest {
  std::string dataset_id;  // 32 hex digits: digest of content and parameters (ComputeDatasetId)
  // 32 hex digits: digest of samples and grid alone, the same however the volume was cut
  // (partition/samples_digest.h). Empty in datasets of programs that did not know it.
  std::string samples_digest;
  std::string name;    // clients ask for the dataset by it; from the output folder's name
  std::string source;  // file name (no folder) of the source volume, for people
  volume::GridGeometry geometry;
  volume::ScalarType scalar_type = volume::ScalarType::kUint8;
  volume::ScalarSpan value_range;  // over all samples that are not NaN
  // Over the finite samples; empty if there are none. Only if `value_range` has an infinite end,
  // and not in datasets of programs that did not know it.
  std::optional<volume::ScalarSpan> finite_range = std::nullopt;
  math::Index3 block_cells;
  Distribution distribution = Distribution::kRandom;
  std::uint64_t seed = 0;
  std::uint32_t range_table_crc32c = 0;  // of the whole range table file
  std::vector<ShardSummary> shards;      // by shard index
  // The meaning of the world axes on the patient, if the source tells it.
  std::optional<volume::PatientFrame> patient_frame = std::nullopt;
  // Bound of the length of the gradient (extract/gradient_bound.h), in field units per world unit;
  // finite, >= 0. Not in datasets of programs that did not know it.
  std::optional<double> max_gradient_magnitude = std::nullopt;
  // Names and colours of sample values, if the source or its user tells them; as
  // volume::ValidateLabels has them.
  std::vector<volume::Label> labels{};
  // Levels 1, 2, ...: each has a block for every shard. Empty: there are none.
  std::vector<LevelSummary> levels{};
  volume::LevelFilter level_filter = volume::LevelFilter::kMean;  // that made them
  // Set in an index-only dataset: the shards have no blocks.bin. block_bytes and the block indices
  // are those of raw blocks.
  std::optional<SourceSamples> in_source = std::nullopt;

  // 0 if there is only the volume itself.
  [[nodiscard]] int highest_level() const { return static_cast<int>(levels.size()); }
  // Grid, sample type and scale of a level. REQUIRES: 0 <= level <= highest_level().
  [[nodiscard]] volume::VolumeLevel Level(int level) const {
    return volume::LevelOf(geometry, scalar_type, level_filter, level);
  }

  friend bool operator==(const Manifest&, const Manifest&) = default;
};

// Returns the bytes of manifest.json, sealed: of version 3 if there are levels or the samples are in
// the source, else of version 1, which earlier programs read.
std::string EncodeManifest(const Manifest& manifest);
// Decodes and validates a manifest. `where` names the file in messages. DATA_LOSS if the bytes are
// damaged or contradict themselves, FAILED_PRECONDITION if they have a newer format version.
absl::StatusOr<Manifest> DecodeManifest(absl::string_view bytes, absl::string_view where);

// Returns the CRC-32C by which shards and series name a manifest: the seal that it has without
// levels. So levels are added and dropped without a change of any other file. Verifies the seal of
// `bytes`: DATA_LOSS.
absl::StatusOr<std::uint32_t> ManifestCrc32c(absl::string_view bytes, absl::string_view where);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_MANIFEST_H_
