#include "tests/support/level_files.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/cancellation.h"
#include "core/base/status_macros.h"
#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "core/partition/partitioner.h"
#include "core/source/volume_source.h"
#include "core/store/shard_format.h"
#include "core/store/shard_levels.h"
#include "core/store/shard_reader.h"
#include "tests/support/memory_source.h"

namespace isoscope::testing {
namespace {

constexpr std::int64_t kMaxManifest = 1 << 20;

std::string ManifestPathOf(const std::string& directory) {
  return absl::StrCat(directory, "/", store::kManifestFileName);
}

// Partitions a level into a folder beside the dataset, and moves its shards. Returns what the
// manifest of level 0 says of it.
absl::StatusOr<store::LevelSummary> AddLevel(const store::Manifest& whole,
                                             const volume::VolumeLevel& level,
                                             const std::string& samples,
                                             const std::string& directory) {
  const std::string folder = absl::StrCat(directory, ".level");
  const std::unique_ptr<source::VolumeSource> source =
      MakeMemorySource(level.grid, level.type, samples, whole.name);
  partition::PartitionOptions options;
  options.output_directory = folder;
  options.shard_count = static_cast<int>(whole.shards.size());
  options.block_cells = whole.block_cells;
  ISOSCOPE_ASSIGN_OR_RETURN(const store::Manifest manifest,
                            partition::Partition(*source, options, base::Cancellation()));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                            io::ReadWholeFile(ManifestPathOf(folder), kMaxManifest));
  store::LevelSummary summary{.dataset_id = manifest.dataset_id};
  ISOSCOPE_ASSIGN_OR_RETURN(summary.manifest_crc32c, store::ManifestCrc32c(bytes, folder));
  for (int shard = 0; shard < options.shard_count; ++shard) {
    const std::string name = store::ShardDirectoryName(shard, options.shard_count);
    std::filesystem::rename(absl::StrCat(folder, "/", name),
                            store::LevelDirectory(absl::StrCat(directory, "/", name), level.index));
  }
  std::filesystem::remove_all(folder);
  return summary;
}

}  // namespace

std::string ReducedSamples(const std::string& samples, const volume::VolumeLevel& level,
                           const volume::VolumeLevel& next, volume::LevelFilter filter) {
  const math::Index3& dims = level.grid.sample_dims;
  const math::Index3& out_dims = next.grid.sample_dims;
  const auto row_bytes = static_cast<std::size_t>(dims.x) * volume::SizeOf(level.type);
  const auto out_bytes = static_cast<std::size_t>(out_dims.x) * volume::SizeOf(next.type);
  std::string out(out_bytes * static_cast<std::size_t>(out_dims.y * out_dims.z), '\0');
  char* to = out.data();
  for (std::int64_t z = 0; z < out_dims.z; ++z) {
    for (std::int64_t y = 0; y < out_dims.y; ++y, to += out_bytes) {
      const auto row = [&](std::int64_t dy, std::int64_t dz) {
        return samples.data() +
               row_bytes * static_cast<std::size_t>((2 * z + dz) * dims.y + 2 * y + dy);
      };
      const std::array<const char*, 4> rows{row(0, 0), row(1, 0), row(0, 1), row(1, 1)};
      volume::ReduceRows(level.type, next.type, filter, rows, static_cast<std::size_t>(out_dims.x),
                         to);
    }
  }
  return out;
}

absl::StatusOr<store::Manifest> AddLevelFiles(const std::string& directory,
                                              const std::string& samples, int highest,
                                              volume::LevelFilter filter) {
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription dataset, store::OpenDataset(directory));
  store::Manifest manifest = dataset.manifest;
  manifest.level_filter = filter;
  std::string below = samples;
  for (int index = 1; index <= highest; ++index) {
    const volume::VolumeLevel level = manifest.Level(index);
    below = ReducedSamples(below, manifest.Level(index - 1), level, filter);
    ISOSCOPE_ASSIGN_OR_RETURN(store::LevelSummary summary,
                              AddLevel(manifest, level, below, directory));
    manifest.levels.push_back(std::move(summary));
  }
  const std::string bytes = store::EncodeManifest(manifest);
  for (const std::string& shard : dataset.shard_directories) {
    ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(ManifestPathOf(shard), bytes));
  }
  ISOSCOPE_RETURN_IF_ERROR(io::WriteFileAtomically(ManifestPathOf(directory), bytes));
  return manifest;
}

}  // namespace isoscope::testing
