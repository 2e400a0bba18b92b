// A dataset is written into a folder that gets its name at the end:
//
//   1  VolumeWriter writes the shards of level 0, and spools the samples of level 1 along with them
//   2  WriteLevels writes level 1 from its spool, and so on (level_writer.h)
//   3  manifests, which name the levels: those of the shards first, that of the dataset last
//
// A step frees what it holds before the next one begins, and levels are smaller than the volume, so
// they take no more memory than it does.

#include "core/partition/partitioner.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/cancellation.h"
#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/partition/distribution.h"
#include "core/partition/level_writer.h"
#include "core/partition/output_folder.h"
#include "core/partition/partition_plan.h"
#include "core/partition/portion_reader.h"
#include "core/partition/volume_writer.h"
#include "core/store/shard_format.h"
#include "core/store/shard_writer.h"

namespace isoscope::partition {
namespace {

// One call of Partition.
class Partitioner {
 public:
  Partitioner(source::VolumeSource* source, const PartitionOptions& options,
              const LevelPlan& levels, const base::Cancellation& cancellation)
      : source_(*source), options_(options), levels_(levels), cancellation_(cancellation) {
    const source::SourceInfo& info = source->info();
    const int passes = VolumeWriter::PassCount(options);
    own_bytes_ = passes * VolumeWriter::PassBytes(info);
    total_bytes_ = own_bytes_ + passes * BytesOfLevels(levels, info.geometry, info.type);
  }

  // Writes the whole dataset into `directory`, which exists.
  absl::StatusOr<store::Manifest> Run(const volume::BlockLayout& layout, const PartitionPlan& plan,
                                      const std::string& directory, const std::string& name) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<LevelSpool> level1,
        CreateSpoolOfLevel1(directory, source_.info().geometry, source_.info().type, levels_));
    ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest manifest,
                              WriteVolume(layout, plan, directory, name, level1.get()));
    if (levels_.highest > 0) {
      ISOSCOPE_RETURN_IF_ERROR(AddLevels(directory, std::move(level1), &manifest));
    }
    ISOSCOPE_RETURN_IF_ERROR(DescribeShards(directory, manifest, cancellation_));
    ISOSCOPE_RETURN_IF_ERROR(store::WriteDescriptions(directory, manifest, -1));
    ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(directory));
    return manifest;
  }

 private:
  absl::StatusOr<store::Manifest> WriteVolume(const volume::BlockLayout& layout,
                                              const PartitionPlan& plan,
                                              const std::string& directory, const std::string& name,
                                              LevelSpool* level1) {
    PartitionOptions options = options_;
    options.progress = ProgressFrom(0);
    VolumeWriter writer(&source_, options, layout, plan, cancellation_);
    return writer.Write(directory, name, level1);
  }

  absl::Status AddLevels(const std::string& directory, std::unique_ptr<LevelSpool> level1,
                         store::Manifest* manifest) {
    std::vector<std::string> shards;
    const auto shard_count = static_cast<int>(manifest->shards.size());
    shards.reserve(manifest->shards.size());
    for (int shard = 0; shard < shard_count; ++shard) {
      shards.push_back(absl::StrCat(directory, "/", store::ShardDirectoryName(shard, shard_count)));
    }
    PartitionOptions options = options_;
    options.reserved_bytes += source_.info().memory_bytes;
    options.progress = ProgressFrom(own_bytes_);
    ISOSCOPE_ASSIGN_OR_RETURN(manifest->levels,
                              WriteLevels(*manifest, shards, directory, levels_, std::move(level1),
                                          options, cancellation_));
    manifest->level_filter = levels_.filter;
    return absl::OkStatus();
  }

  // Progress of a part of the work, as one of all of it.
  [[nodiscard]] std::function<void(const PartitionProgress&)> ProgressFrom(
      std::int64_t done_before) const {
    if (!options_.progress) {
      return nullptr;
    }
    return [this, done_before](PartitionProgress progress) {
      progress.done_bytes += done_before;
      progress.total_bytes = total_bytes_;
      options_.progress(progress);
    };
  }

  source::VolumeSource& source_;
  const PartitionOptions& options_;
  const LevelPlan levels_;
  const base::Cancellation& cancellation_;
  std::int64_t own_bytes_ = 0;
  std::int64_t total_bytes_ = 0;
};

// Small boxes are joined: fewer reads, and fewer samples that lie around the blocks of a unit.
constexpr std::int64_t kMinUnitEdge = 32;
constexpr std::int64_t kJoinedUnitBytes = 2 * base::kMiB;

absl::StatusOr<source::BoxGrid> GridOf(const source::VolumeSource& source) {
  const std::optional<source::BoxGrid> grid = source.box_grid();
  if (!grid.has_value()) {
    return absl::InvalidArgumentError(absl::StrCat(
        source.info().name,
        ": can't be indexed alone: its samples can't be read in any order (it is compressed as a "
        "whole, resampled, or of a format without random access); leave --index-only out, or write "
        "it as Zarr or uncompressed"));
  }
  // A source may find out only now that it can't.
  std::array<char, sizeof(double)> sample{};
  ISOSCOPE_RETURN_IF_ERROR(source.ReadBox({.begin = {0, 0, 0}, .end = {1, 1, 1}}, sample.data(),
                                          base::ProcessInterrupt()));
  return *grid;
}

// The stride of a request: the samples between are decoded along.
std::int64_t StrideOf(const std::map<std::string, std::string>& request) {
  const auto member = request.find("stride");
  std::int64_t stride = 1;
  return member != request.end() && absl::SimpleAtoi(member->second, &stride) ? stride : 1;
}

}  // namespace

absl::Status PlanUnits(const source::VolumeSource& source, store::SourceSamples* samples) {
  const source::SourceInfo& info = source.info();
  ISOSCOPE_ASSIGN_OR_RETURN(const source::BoxGrid grid, GridOf(source));
  samples->unit_origin = grid.origin;
  math::Index3& dims = samples->unit_dims;
  const std::int64_t factor = source.decoding_factor();
  double bytes =  // that are decoded
      static_cast<double>(volume::SizeOf(info.type)) * static_cast<double>(factor);
  for (int axis = 0; axis < 3; ++axis) {
    // No unit is larger than the volume.
    dims[axis] = std::min(grid.box_dims[axis], info.geometry.sample_dims[axis] - grid.origin[axis]);
    bytes *= static_cast<double>(dims[axis]);
  }
  if (bytes > static_cast<double>(store::kMaxUnitBytes)) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: can't be indexed alone: its chunks of %d x %d x %d samples%s have %.0f MiB, at most "
        "%d "
        "MiB are read for a few blocks; write it with smaller chunks, or leave --index-only out",
        info.name, dims.x, dims.y, dims.z,
        factor > 1 ? ", with what is decoded along with them (other channels or steps)," : "",
        bytes / double{base::kMiB}, store::kMaxUnitBytes / base::kMiB));
  }
  const auto stride = static_cast<double>(StrideOf(samples->request));
  bytes *= stride * stride * stride;
  for (;;) {
    int least = 0;
    for (int axis = 1; axis < 3; ++axis) {
      least = dims[axis] < dims[least] ? axis : least;
    }
    const std::int64_t whole = info.geometry.sample_dims[least] - samples->unit_origin[least];
    if (dims[least] >= kMinUnitEdge || dims[least] >= whole ||
        2 * bytes > static_cast<double>(kJoinedUnitBytes)) {
      return absl::OkStatus();
    }
    dims[least] *= 2;
    bytes *= 2;
  }
}

absl::Status CheckRandomAccess(const source::VolumeSource& source) {
  return GridOf(source).status();
}

absl::Status CheckIndexOnly(const PartitionOptions& options, const volume::BlockLayout& layout) {
  if (options.distribution != store::Distribution::kRandom ||
      options.compression != store::BlockEncoding::kRaw) {
    return absl::InvalidArgumentError(
        "an index-only dataset deals out the chunks of its source at random, and stores no blocks "
        "of level 0: leave the distribution and the compression out");
  }
  const std::int64_t units = BlockUnits(layout, *options.in_source).unit_count();
  const math::Index3& dims = options.in_source->unit_dims;
  return options.shard_count <= units
             ? absl::OkStatus()
             : absl::InvalidArgumentError(absl::StrFormat(
                   "%d shards: an index-only dataset deals out chunks of %d x %d x %d samples, and "
                   "the source has %d of them; use at most as many shards",
                   options.shard_count, dims.x, dims.y, dims.z, units));
}

absl::StatusOr<store::Manifest> Partition(source::VolumeSource& source,
                                          const PartitionOptions& options,
                                          const base::Cancellation& cancellation) {
  const source::SourceInfo& info = source.info();
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(info.geometry));
  ISOSCOPE_RETURN_IF_ERROR(volume::ValidateLabels(options.labels));
  PartitionOptions cut = options;
  cut.block_cells =
      options.block_cells.value_or(volume::DefaultBlockCells(info.geometry.sample_dims));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::BlockLayout layout,
                            volume::BlockLayout::Make(info.geometry.sample_dims, *cut.block_cells));
  ISOSCOPE_RETURN_IF_ERROR(ValidateShardCount(options.shard_count, layout));
  if (cut.in_source.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(cut.keeps_units ? CheckRandomAccess(source)
                                             : PlanUnits(source, &*cut.in_source));
    ISOSCOPE_RETURN_IF_ERROR(CheckIndexOnly(cut, layout));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const LevelPlan levels,
                            PlanLevels(options.levels, info.geometry, info.type, *cut.block_cells,
                                       options.shard_count, !options.labels.empty()));
  std::int64_t source_bytes = options.reserved_bytes + info.memory_bytes +
                              (info.is_seekable ? 0 : PortionReader::StagingBytes(source));
  if (levels.highest > 0) {
    source_bytes +=
        LevelSpool::MemoryBytes(volume::LevelOf(info.geometry, info.type, levels.filter, 1));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      const PartitionPlan plan,
      PlanPartition(layout, info.type, options.shard_count, options.distribution, source_bytes,
                    options.memory_limit_bytes));
  PartitionOptions of_levels = cut;
  of_levels.reserved_bytes += info.memory_bytes;
  ISOSCOPE_RETURN_IF_ERROR(CheckLevelsFit(info.geometry, info.type, levels, of_levels));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<OutputFolder> output,
                            OutputFolder::Make(options.output_directory, options.name));
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());

  ISOSCOPE_RETURN_IF_ERROR(output->Create());
  ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest manifest,
                            Partitioner(&source, cut, levels, cancellation)
                                .Run(layout, plan, output->partial_path(), output->name()));
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  if (options.check_source) {
    ISOSCOPE_RETURN_IF_ERROR(options.check_source());
  }
  ISOSCOPE_RETURN_IF_ERROR(output->Commit());
  return manifest;
}

}  // namespace isoscope::partition
