#include "core/store/shard_levels.h"

#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/store/directory_files.h"
#include "core/store/shard_format.h"
#include "core/volume/volume_level.h"

namespace isoscope::store {
namespace {

std::string NameOfShard(const ShardReader& shard) {
  return absl::StrFormat("dataset \"%s\", shard %d of %d", shard.manifest().name,
                         shard.shard_index(), shard.manifest().shards.size());
}

// DATA_LOSS unless the level is what the manifest of level 0 says.
absl::Status CheckBelongs(const ShardReader& shard, int level, const ShardReader& opened) {
  const LevelSummary& expected = shard.manifest().levels[static_cast<std::size_t>(level - 1)];
  if (opened.manifest_crc32c() != expected.manifest_crc32c ||
      opened.manifest().dataset_id != expected.dataset_id ||
      opened.shard_index() != shard.shard_index()) {
    return absl::DataLossError(absl::StrFormat(
        "%s: holds shard %d of dataset id %s, manifest crc32c %08x; %s expects shard %d of %s, "
        "%08x: copy the whole shard directory again",
        opened.directory(), opened.shard_index(), opened.manifest().dataset_id,
        opened.manifest_crc32c(), NameOfShard(shard), shard.shard_index(), expected.dataset_id,
        expected.manifest_crc32c));
  }
  const volume::VolumeLevel described = shard.manifest().Level(level);
  if (!(opened.manifest().geometry.sample_dims == described.grid.sample_dims) ||
      opened.manifest().scalar_type != described.type) {
    const math::Index3& dims = opened.manifest().geometry.sample_dims;
    const math::Index3& expected_dims = described.grid.sample_dims;
    return absl::DataLossError(absl::StrFormat(
        "%s: %d x %d x %d samples of %s, level %d of %s has %d x %d x %d of %s", opened.directory(),
        dims.x, dims.y, dims.z, volume::NameOf(opened.manifest().scalar_type), level,
        NameOfShard(shard), expected_dims.x, expected_dims.y, expected_dims.z,
        volume::NameOf(described.type)));
  }
  return absl::OkStatus();
}

}  // namespace

std::string LevelDirectory(const std::string& shard_directory, int level) {
  return level == 0 ? shard_directory : PathIn(shard_directory, LevelDirectoryName(level));
}

absl::StatusOr<std::unique_ptr<ShardReader>> OpenShardLevel(
    const std::string& shard_directory, int level, const ShardReader::OpenFile& open_file) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<ShardReader> shard,
                            ShardReader::Open(shard_directory, open_file));
  if (level == 0) {
    return shard;
  }
  return OpenLevelOf(*shard, level, open_file);
}

absl::StatusOr<std::unique_ptr<ShardReader>> OpenLevelOf(const ShardReader& shard, int level,
                                                         const ShardReader::OpenFile& open_file) {
  const int highest = shard.manifest().highest_level();
  if (level < 1 || level > highest) {
    return absl::NotFoundError(absl::StrFormat(
        "%s has no level %d, %s; `isoscope partition --add-levels` makes levels",
        NameOfShard(shard), level,
        highest == 0 ? "only its samples" : absl::StrFormat("only 0 to %d", highest)));
  }
  const std::string directory = LevelDirectory(shard.directory(), level);
  if (!io::PathExists(PathIn(directory, kManifestFileName))) {
    return absl::NotFoundError(absl::StrFormat(
        "%s lacks level %d, which its manifest names: no %s in %s; copy the shard directory again",
        NameOfShard(shard), level, kManifestFileName, directory));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<ShardReader> opened,
                            ShardReader::Open(directory, open_file));
  ISOSCOPE_RETURN_IF_ERROR(CheckBelongs(shard, level, *opened));
  return opened;
}

std::vector<int> MissingLevels(const std::string& shard_directory, const Manifest& manifest) {
  std::vector<int> missing;
  for (int level = 1; level <= manifest.highest_level(); ++level) {
    if (!io::PathExists(PathIn(LevelDirectory(shard_directory, level), kManifestFileName))) {
      missing.push_back(level);
    }
  }
  return missing;
}

}  // namespace isoscope::store
