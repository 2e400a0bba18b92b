// The manifest of a series: a dataset with several fields or time steps (docs/format/dataset.md,
// "Series"). It names the grid and the cut, which all scalar volumes share, and has a line for each
// scalar volume. A scalar volume is one component of a field at one step; its shards are shard
// directories of their own, as those of a dataset of version 1:
//
//   flow/
//   ├── manifest.json                     version 2: what all shards agree on
//   └── shard-00000-of-00002/
//       ├── manifest.json                 the same bytes
//       ├── series_shard.json             which shard it is
//       └── field-000-component-0-step-00003/   manifest.json, ranges.bin, shard.json, blocks.bin,
//       ...
//
// Appending adds folders, then replaces the manifests: those in the shards first, the one of the
// dataset last. Nothing that was written before changes.

#ifndef ISOSCOPE_CORE_STORE_SERIES_MANIFEST_H_
#define ISOSCOPE_CORE_STORE_SERIES_MANIFEST_H_

#include <cstdint>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/math/vec.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/label.h"
#include "core/volume/patient_frame.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"
#include "core/volume/volume_level.h"

namespace isoscope::store {

// The component that holds the length of all others, of fields with several.
inline constexpr absl::string_view kMagnitudeName = "magnitude";
inline constexpr int kMaxFields = 1000;
inline constexpr int kMaxComponents = 10;  // the magnitude included
inline constexpr int kMaxSteps = 100'000;
inline constexpr int kMaxScalarVolumes = 200'000;

struct FieldComponent {
  std::string name;  // "" for the only one of a field
  volume::ScalarType scalar_type = volume::ScalarType::kUint8;

  friend bool operator==(const FieldComponent&, const FieldComponent&) = default;
};

struct Field {
  std::string name;                        // unique in the series
  std::string long_name;                   // may be empty
  std::string unit;                        // may be empty
  std::vector<FieldComponent> components;  // at least one; of several, the last is the magnitude

  friend bool operator==(const Field&, const Field&) = default;
};

// Names a scalar volume of a series.
struct ScalarVolumeKey {
  int field = 0;      // index
  int component = 0;  // index
  int step = 0;       // number

  friend bool operator==(const ScalarVolumeKey&, const ScalarVolumeKey&) = default;
  friend bool operator<(const ScalarVolumeKey& a, const ScalarVolumeKey& b) {
    return std::tie(a.step, a.field, a.component) < std::tie(b.step, b.field, b.component);
  }
};

// "field-000-component-0-step-00003".
std::string ScalarVolumeDirectoryName(const ScalarVolumeKey& key);

// One scalar volume in the manifest of a series; its own manifest has the rest.
struct ScalarVolume {
  ScalarVolumeKey key;
  std::string dataset_id;  // of its own manifest: what agents are asked for
  std::uint32_t manifest_crc32c = 0;
  volume::ScalarSpan value_range;
  std::optional<volume::ScalarSpan> finite_range = std::nullopt;  // as in Manifest
  std::optional<double> max_gradient_magnitude = std::nullopt;
  int highest_level = 0;  // as in Manifest; 0: there are none
  volume::LevelFilter level_filter = volume::LevelFilter::kMean;

  friend bool operator==(const ScalarVolume&, const ScalarVolume&) = default;
};

struct SeriesManifest {
  // 32 hex digits: names grid, cut, fields and the first step; appending does not change it.
  std::string dataset_id;
  std::string name;    // clients ask for the dataset by it
  std::string source;  // file name (no folder) of the first source, for people
  volume::GridGeometry geometry;
  std::optional<volume::PatientFrame> patient_frame = std::nullopt;
  std::string length_unit;  // may be empty
  math::Index3 block_cells;
  std::uint64_t seed = 0;  // of the random distribution: the same shard for a block in every volume
  int shard_count = 0;
  std::vector<Field> fields;
  std::vector<double>
      times;              // by step number, strictly ascending, finite; empty: one step, no time
  std::string time_unit;  // may be empty
  std::vector<ScalarVolume> volumes;  // ascending by key, each once
  // As in Manifest; those of the scalar volumes' own manifests are empty.
  std::vector<volume::Label> labels{};

  [[nodiscard]] int step_count() const {
    return times.empty() ? 1 : static_cast<int>(times.size());
  }
  // Null if the series has no such volume.
  [[nodiscard]] const ScalarVolume* Find(const ScalarVolumeKey& key) const;
  // Of the volumes; 0 if none has levels. A volume may have fewer.
  [[nodiscard]] int highest_level() const;

  friend bool operator==(const SeriesManifest&, const SeriesManifest&) = default;
};

// Returns the bytes of manifest.json, sealed: of version 3 if a volume has levels, else of version 2.
std::string EncodeSeriesManifest(const SeriesManifest& manifest);
// Decodes and validates. `where` names the file in messages. DATA_LOSS if the bytes are damaged or
// contradict themselves, FAILED_PRECONDITION if they are of a volume or of a newer version.
absl::StatusOr<SeriesManifest> DecodeSeriesManifest(absl::string_view bytes,
                                                    absl::string_view where);

// True if a dataset or shard directory has a manifest of a series; false for one of a volume, and
// where there is none or it can't be read (whoever opens it then says why).
bool IsSeriesDirectory(const std::string& directory);

// A shard directory of a series.
struct SeriesShard {
  SeriesManifest manifest;
  std::uint32_t manifest_crc32c = 0;
  int shard_index = 0;
};
// Errors as ShardReader::Open.
absl::StatusOr<SeriesShard> OpenSeriesShard(const std::string& directory);

// A dataset directory of a series.
struct SeriesDescription {
  SeriesManifest manifest;
  std::vector<std::string> shard_directories;  // by shard index; "" where it does not exist
};
// Errors as OpenDataset.
absl::StatusOr<SeriesDescription> OpenSeries(const std::string& directory);

// A scalar volume that the manifest names, and the shards whose folders lack it.
struct MissingVolume {
  ScalarVolumeKey key;
  std::vector<int> shards;  // indices, ascending
};
// The volumes that are not there, ascending by key: partitioning and careful copies write the
// manifest of a volume's folder last. Shards that do not exist at all do not count.
std::vector<MissingVolume> MissingVolumes(const SeriesDescription& series);
// "field "p", step 5, in shards 0 and 2; and 3 more volumes". REQUIRES: `missing` is not empty.
std::string DescribeMissing(const std::vector<MissingVolume>& missing,
                            const SeriesManifest& manifest);
// NOT_FOUND, with the first of them, if the series lacks a shard or a volume.
absl::Status CheckComplete(const SeriesDescription& series);

// Returns the shard directories of a dataset directory, of a series or of version 1, by shard
// index;
// "" where one does not exist. Errors as OpenDataset.
absl::StatusOr<std::vector<std::string>> ShardDirectoriesOf(const std::string& directory);

// Writes the manifest in a way that readers see the old or the new one whole: into a dataset
// directory (shard_index < 0), or with series_shard.json into a shard directory.
absl::Status WriteSeriesManifest(const std::string& directory, const SeriesManifest& manifest,
                                 int shard_index);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SERIES_MANIFEST_H_
