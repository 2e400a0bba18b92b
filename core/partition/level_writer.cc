// Each level is a volume like any other, so VolumeWriter writes it:
//
//   spool of level 1 --> VolumeWriter --> work/level_1/shard-... --> shard-.../level_1
//                             |
//                             v
//   spool of level 2 --> VolumeWriter --> work/level_2/shard-... --> shard-.../level_2
//
// At most two spools exist at a time. Blocks, distribution, seed and compression are those of
// level 0, so the samples and the files of a level depend on the samples of level 0 and its cut
// alone.

#include "core/partition/level_writer.h"

#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/partition/partition_plan.h"
#include "core/partition/volume_writer.h"
#include "core/store/shard_format.h"
#include "core/volume/block_layout.h"

namespace isoscope::partition {
namespace {

// A volume of which levels are made.
struct Below {
  const volume::GridGeometry& geometry;
  volume::ScalarType type;
  const LevelPlan& levels;

  [[nodiscard]] volume::VolumeLevel Level(int level) const {
    return volume::LevelOf(geometry, type, levels.filter, level);
  }
};

absl::StatusOr<volume::BlockLayout> LayoutOf(const volume::VolumeLevel& level,
                                             const math::Index3& block_cells) {
  return volume::BlockLayout::Make(level.grid.sample_dims, block_cells);
}

// The plan of a level, which makes the one above along with it.
absl::StatusOr<PartitionPlan> PlanLevel(const Below& below, int level,
                                        const volume::BlockLayout& layout,
                                        const PartitionOptions& options) {
  std::int64_t others = options.reserved_bytes;
  if (level < below.levels.highest) {
    others += LevelSpool::MemoryBytes(below.Level(level + 1));
  }
  return PlanPartition(layout, below.Level(level).type, options.shard_count, options.distribution,
                       others, options.memory_limit_bytes);
}

// The cut of a volume, for its levels.
PartitionOptions LevelOptionsOf(const store::Manifest& base, const PartitionOptions& options) {
  PartitionOptions of_level;
  of_level.source_name = base.source;
  of_level.shard_count = static_cast<int>(base.shards.size());
  of_level.block_cells = base.block_cells;
  of_level.distribution = base.distribution;
  of_level.compression = options.compression;
  of_level.seed = base.seed;
  of_level.memory_limit_bytes = options.memory_limit_bytes;
  of_level.reserved_bytes = options.reserved_bytes;
  of_level.progress = options.progress;
  return of_level;
}

// Moves the folders of the shards from `work` to `level_...` of each shard.
absl::Status MoveShards(const std::string& work, int level,
                        const std::vector<std::string>& shard_directories) {
  const auto shard_count = static_cast<int>(shard_directories.size());
  for (int shard = 0; shard < shard_count; ++shard) {
    const std::string& to_shard = shard_directories[static_cast<std::size_t>(shard)];
    const std::string to = absl::StrCat(to_shard, "/", store::LevelDirectoryName(level));
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(to));
    ISOSCOPE_RETURN_IF_ERROR(
        io::RenamePath(absl::StrCat(work, "/", store::ShardDirectoryName(shard, shard_count)), to));
    ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(to_shard));
  }
  return absl::OkStatus();
}

// Writes one level into `work`, and takes its place in the manifest.
absl::StatusOr<store::LevelSummary> WriteLevel(const store::Manifest& base, const Below& below,
                                               const LevelSpool& spool, LevelSpool* next,
                                               const std::string& work,
                                               const PartitionOptions& options,
                                               const base::Cancellation& cancellation) {
  ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(work));
  const int level = spool.level().index;
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::BlockLayout layout,
                            LayoutOf(spool.level(), base.block_cells));
  ISOSCOPE_ASSIGN_OR_RETURN(const PartitionPlan plan, PlanLevel(below, level, layout, options));
  const std::unique_ptr<source::VolumeSource> source =
      spool.MakeSource(absl::StrFormat("level %d of %s", level, base.name));
  VolumeWriter writer(source.get(), options, layout, plan, cancellation);
  ISOSCOPE_ASSIGN_OR_RETURN(const store::Manifest manifest, writer.Write(work, base.name, next));
  ISOSCOPE_RETURN_IF_ERROR(DescribeShards(work, manifest, cancellation));
  store::LevelSummary summary{.dataset_id = manifest.dataset_id};
  ISOSCOPE_ASSIGN_OR_RETURN(summary.manifest_crc32c,
                            store::ManifestCrc32c(store::EncodeManifest(manifest), work));
  return summary;
}

}  // namespace

absl::Status CheckLevelsFit(const volume::GridGeometry& geometry, volume::ScalarType type,
                            const LevelPlan& levels, const PartitionOptions& options) {
  const Below below{.geometry = geometry, .type = type, .levels = levels};
  for (int level = 1; level <= levels.highest; ++level) {
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::BlockLayout layout,
                              LayoutOf(below.Level(level), *options.block_cells));
    ISOSCOPE_RETURN_IF_ERROR(PlanLevel(below, level, layout, options).status());
  }
  return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<LevelSpool>> CreateSpoolOfLevel1(
    const std::string& directory, const volume::GridGeometry& geometry, volume::ScalarType type,
    const LevelPlan& levels) {
  if (levels.highest == 0) {
    return nullptr;
  }
  return LevelSpool::Create(directory, volume::LevelOf(geometry, type, levels.filter, 1), type,
                            levels.filter);
}

absl::StatusOr<std::vector<store::LevelSummary>> WriteLevels(
    const store::Manifest& base, const std::vector<std::string>& shard_directories,
    const std::string& directory, const LevelPlan& levels, std::unique_ptr<LevelSpool> level1,
    const PartitionOptions& options, const base::Cancellation& cancellation) {
  ISOSCOPE_CHECK(levels.highest == 0 || level1 != nullptr);
  const Below below{.geometry = base.geometry, .type = base.scalar_type, .levels = levels};
  PartitionOptions level_options = LevelOptionsOf(base, options);
  std::int64_t done_bytes = 0;
  if (options.progress) {
    level_options.progress = [&](PartitionProgress progress) {
      progress.phase = "writing levels";
      progress.done_bytes += done_bytes;
      progress.total_bytes = VolumeWriter::PassCount(level_options) *
                             BytesOfLevels(levels, base.geometry, base.scalar_type);
      options.progress(progress);
    };
  }
  std::vector<store::LevelSummary> summaries;
  std::unique_ptr<LevelSpool> spool = std::move(level1);
  for (int level = 1; level <= levels.highest; ++level) {
    std::unique_ptr<LevelSpool> next;
    if (level < levels.highest) {
      ISOSCOPE_ASSIGN_OR_RETURN(next, LevelSpool::Create(directory, below.Level(level + 1),
                                                         spool->level().type, levels.filter));
    }
    const std::string work = absl::StrCat(directory, "/", store::LevelDirectoryName(level));
    ISOSCOPE_ASSIGN_OR_RETURN(
        store::LevelSummary summary,
        WriteLevel(base, below, *spool, next.get(), work, level_options, cancellation));
    ISOSCOPE_RETURN_IF_ERROR(MoveShards(work, level, shard_directories));
    ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(work));
    summaries.push_back(std::move(summary));
    done_bytes += VolumeWriter::PassCount(level_options) *
                  math::Volume(spool->level().grid.sample_dims) *
                  static_cast<std::int64_t>(volume::SizeOf(spool->level().type));
    spool = std::move(next);
  }
  return summaries;
}

}  // namespace isoscope::partition
