#include "core/ingest/partitioner.h"

#include <unistd.h>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <utility>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "oneapi/tbb/parallel_for.h"

#include "core/base/crc32c.h"
#include "core/base/file.h"
#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/index/interval_tree_builder.h"
#include "core/ingest/block_cutter.h"
#include "core/ingest/distribution.h"
#include "core/store/shard_format.h"
#include "core/store/shard_writer.h"
#include "core/volume/block_samples.h"

namespace isoscope::ingest {
namespace {

// Larger slabs gain nothing: measured 2026-11 on 512 x 512 x 234 samples.
constexpr std::int64_t kMaxSlabBytes = 32 * base::kMiB;
// Between two looks at the cancellation.
constexpr std::int64_t kReadBytes = 8 * base::kMiB;
// Blocks that are cut in parallel before they are written.
constexpr std::int64_t kBatchBytes = 4 * base::kMiB;
// Tables beside the slab, for each block and beside two copies of the range table: its shard,
// ordinal and place in a list, its writer's entry, and the lists of the greedy distribution.
constexpr std::int64_t kTableBytesPerBlock = 48;
// The intervals of one shard and the tree that is built of them.
constexpr std::int64_t kIndexBytesPerBlock = 140;

std::string BaseName(const std::string& path) { return path.substr(path.rfind('/') + 1); }

// "a/b//" is "a/b".
std::string WithoutTrailingSlashes(std::string path) {
  while (path.size() > 1 && path.back() == '/') {
    path.pop_back();
  }
  return path;
}

absl::Status ValidateName(const std::string& name) {
  constexpr std::size_t kMaxNameBytes = 200;  // leaves room for ".partial-<pid>" in a file name
  const bool is_valid =
      !name.empty() && name.size() <= kMaxNameBytes &&
      (absl::ascii_isalnum(static_cast<unsigned char>(name[0])) || name[0] == '_') &&
      std::all_of(name.begin(), name.end(), [](char c) {
        return absl::ascii_isalnum(static_cast<unsigned char>(c)) || c == '.' || c == '_' ||
               c == '-';
      });
  if (!is_valid) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "output folder \"%s\": its name becomes the dataset's name; expected 1 to %d letters, "
        "digits, '.', '_' and '-', starting with a letter, a digit or '_'",
        name, kMaxNameBytes));
  }
  return absl::OkStatus();
}

absl::Status ValidateOutput(const std::string& output) {
  ISOSCOPE_RETURN_IF_ERROR(ValidateName(BaseName(output)));
  if (base::PathExists(output)) {
    return absl::AlreadyExistsError(absl::StrCat(
        "output ", output, " exists: remove it, or give a folder that does not exist yet"));
  }
  const std::size_t slash = output.rfind('/');
  const std::string parent = slash == std::string::npos ? "."
                             : slash == 0               ? "/"
                                                        : output.substr(0, slash);
  if (!base::IsDirectory(parent)) {
    return absl::NotFoundError(absl::StrFormat(
        "output %s: its parent folder %s does not exist: create it (mkdir -p)", output, parent));
  }
  return absl::OkStatus();
}

absl::Status ValidateShardCount(int shard_count, const volume::BlockLayout& layout) {
  const std::int64_t block_count = layout.block_count();
  const std::int64_t max = std::min<std::int64_t>(store::kMaxShardCount, block_count);
  if (shard_count < 1 || shard_count > max) {
    const math::Index3& cells = layout.block_cells();
    return absl::InvalidArgumentError(absl::StrFormat(
        "%d shards for %d blocks of %d x %d x %d cells: expected 1 to %d; fewer shards, or "
        "smaller blocks",
        shard_count, block_count, cells.x, cells.y, cells.z, max));
  }
  return absl::OkStatus();
}

// A folder that is removed with everything in it unless it was kept.
class PartialDirectory {
 public:
  static absl::StatusOr<std::unique_ptr<PartialDirectory>> Create(const std::string& path) {
    // What a killed process with our number left (numbers repeat in containers).
    ISOSCOPE_RETURN_IF_ERROR(base::RemoveRecursively(path));
    ISOSCOPE_RETURN_IF_ERROR(base::CreateDirectory(path));
    return std::make_unique<PartialDirectory>(path);
  }
  explicit PartialDirectory(std::string path) : path_(std::move(path)) {}
  ~PartialDirectory() {
    if (!is_kept_) {
      const absl::Status removed = base::RemoveRecursively(path_);
      if (!removed.ok()) {
        base::LogWarning("partial_dataset_left", {{"path", path_}, {"status", removed}});
      }
    }
  }
  PartialDirectory(const PartialDirectory&) = delete;
  PartialDirectory& operator=(const PartialDirectory&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  void Keep() { is_kept_ = true; }

 private:
  std::string path_;
  bool is_kept_ = false;
};

// How many layers of blocks a slab holds, so that everything stays under the limit.
struct MemoryPlan {
  std::int64_t layers_per_slab = 1;
  std::int64_t slab_planes = 0;
  std::int64_t batch_bytes = 0;
};

// Stored planes [begin, end) of block layers [first, last).
std::pair<std::int64_t, std::int64_t> PlanesOfLayers(const volume::BlockLayout& layout,
                                                     std::int64_t first, std::int64_t last) {
  const std::int64_t cells = layout.block_cells().z;
  return {std::max<std::int64_t>(first * cells - 1, 0),
          std::min(last * cells + 2, layout.sample_dims().z)};
}

absl::StatusOr<MemoryPlan> PlanMemory(const volume::BlockLayout& layout, volume::ScalarType type,
                                      const PartitionOptions& options) {
  const auto sample_size = static_cast<std::int64_t>(volume::SizeOf(type));
  const math::Index3& dims = layout.sample_dims();
  const math::Index3& cells = layout.block_cells();
  const std::int64_t plane_bytes = dims.x * dims.y * sample_size;
  const std::int64_t max_block_bytes = (cells.x + 3) * (cells.y + 3) * (cells.z + 3) * sample_size;
  MemoryPlan plan;
  plan.batch_bytes = std::max(kBatchBytes, max_block_bytes);
  const std::int64_t block_count = layout.block_count();
  const std::int64_t table_bytes = block_count * (kTableBytesPerBlock + 4 * sample_size);
  // A shard of a random distribution may hold a few blocks more than its part; 2 is generous.
  const std::int64_t index_bytes =
      std::min(block_count, 2 * block_count / options.shard_count + 1) * kIndexBytesPerBlock;
  const auto needed = [&](std::int64_t layers) {
    const std::int64_t planes = std::min(layers * cells.z + 3, dims.z);
    return table_bytes + std::max(planes * plane_bytes + plan.batch_bytes, index_bytes);
  };
  if (needed(1) > options.memory_limit_bytes) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "memory limit %d bytes: one layer of blocks (%d x %d x %d samples of %s) with tables for "
        "%d blocks needs %d bytes; raise --memory-limit%s",
        options.memory_limit_bytes, dims.x, dims.y, std::min(cells.z + 3, dims.z),
        volume::NameOf(type), block_count, needed(1),
        cells.z > 4 ? " or use blocks with fewer cells in z" : ""));
  }
  while (plan.layers_per_slab < layout.block_dims().z &&
         ((plan.layers_per_slab + 1) * cells.z + 3) * plane_bytes <= kMaxSlabBytes &&
         needed(plan.layers_per_slab + 1) <= options.memory_limit_bytes) {
    ++plan.layers_per_slab;
  }
  plan.slab_planes = std::min(plan.layers_per_slab * cells.z + 3, dims.z);
  return plan;
}

// One run of Partition.
class Partitioner {
 public:
  Partitioner(VolumeSource* source, const PartitionOptions& options, volume::BlockLayout layout,
              const MemoryPlan& plan, const base::Cancellation& cancellation)
      : source_(*source),
        options_(options),
        cancellation_(cancellation),
        layout_(layout),
        type_(source->scalar_type()),
        plan_(plan),
        plane_bytes_(layout.sample_dims().x * layout.sample_dims().y *
                     static_cast<std::int64_t>(volume::SizeOf(type_))),
        ranges_(type_, layout.block_count()) {
    progress_.total_bytes = plane_bytes_ * layout.sample_dims().z *
                            (options.distribution == store::Distribution::kGreedy ? 2 : 1);
  }

  // Writes the whole dataset into `directory`, which exists.
  absl::StatusOr<store::Manifest> Run(const std::string& directory, const std::string& name) {
    if (options_.distribution == store::Distribution::kGreedy) {
      progress_.phase = "reading ranges";
      ISOSCOPE_RETURN_IF_ERROR(
          ForEachSlab([&](const Slab& slab, volume::BlockId begin, volume::BlockId end) {
            FindSpans(slab, begin, end);
            return absl::OkStatus();
          }));
      shard_of_block_ = DistributeGreedily(ranges_, options_.shard_count);
      has_spans_ = true;
    } else {
      shard_of_block_ =
          DistributeRandomly(layout_.block_count(), options_.shard_count, options_.seed);
    }
    progress_.phase = "writing blocks";
    ISOSCOPE_RETURN_IF_ERROR(CreateShards(directory));
    ISOSCOPE_RETURN_IF_ERROR(
        ForEachSlab([&](const Slab& slab, volume::BlockId begin, volume::BlockId end) {
          return WriteBlocks(slab, begin, end);
        }));
    planes_ = {};
    batch_ = {};
    progress_.phase = "building index";
    Report();
    return Finish(directory, name);
  }

 private:
  template <typename Visit>  // absl::Status(const Slab&, BlockId begin, BlockId end)
  absl::Status ForEachSlab(const Visit& visit) {
    planes_.resize(static_cast<std::size_t>(plan_.slab_planes * plane_bytes_));
    const std::int64_t layer_count = layout_.block_dims().z;
    const std::int64_t layer_blocks = layout_.block_dims().x * layout_.block_dims().y;
    std::int64_t held_begin = 0;  // planes [held_begin, held_end) are in planes_
    std::int64_t held_end = 0;
    for (std::int64_t layer = 0; layer < layer_count; layer += plan_.layers_per_slab) {
      const std::int64_t end_layer = std::min(layer + plan_.layers_per_slab, layer_count);
      const auto [begin, end] = PlanesOfLayers(layout_, layer, end_layer);
      // The planes shared with the slab before are kept, so that the source is read once.
      const std::int64_t kept = std::max<std::int64_t>(held_end - begin, 0);
      std::copy_n(planes_.data() + (held_end - kept - held_begin) * plane_bytes_,
                  kept * plane_bytes_, planes_.data());
      ISOSCOPE_RETURN_IF_ERROR(ReadPlanes(begin + kept, end, planes_.data() + kept * plane_bytes_));
      held_begin = begin;
      held_end = end;
      ISOSCOPE_RETURN_IF_ERROR(visit(Slab{.samples = planes_.data(), .begin_z = begin},
                                     static_cast<volume::BlockId>(layer * layer_blocks),
                                     static_cast<volume::BlockId>(end_layer * layer_blocks)));
    }
    return absl::OkStatus();
  }

  absl::Status ReadPlanes(std::int64_t begin, std::int64_t end, char* out) {
    const std::int64_t step = std::max<std::int64_t>(kReadBytes / plane_bytes_, 1);
    for (std::int64_t z = begin; z < end; z += step) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      const std::int64_t count = std::min(step, end - z);
      ISOSCOPE_RETURN_IF_ERROR(source_.ReadSlab(z, z + count, out + (z - begin) * plane_bytes_));
      progress_.done_bytes += count * plane_bytes_;
      Report();
    }
    return absl::OkStatus();
  }

  void Report() const {
    if (options_.progress) {
      options_.progress(progress_);
    }
  }

  void FindSpans(const Slab& slab, volume::BlockId begin, volume::BlockId end) {
    tbb::parallel_for(begin, end, [&](volume::BlockId id) {
      ranges_.Set(id, SpanOfBlock(layout_, type_, slab, id));
    });
  }

  absl::Status CreateShards(const std::string& directory) {
    blocks_by_shard_ = store::BlocksByShard(layout_, shard_of_block_, options_.shard_count);
    ordinals_.resize(shard_of_block_.size());
    for (int shard = 0; shard < options_.shard_count; ++shard) {
      const std::vector<volume::BlockId>& blocks =
          blocks_by_shard_[static_cast<std::size_t>(shard)];
      for (std::size_t i = 0; i < blocks.size(); ++i) {
        ordinals_[blocks[i]] = static_cast<std::uint32_t>(i);
      }
      shard_directories_.push_back(
          absl::StrCat(directory, "/", store::ShardDirectoryName(shard, options_.shard_count)));
      ISOSCOPE_ASSIGN_OR_RETURN(
          std::unique_ptr<store::ShardWriter> writer,
          store::ShardWriter::Create(shard_directories_.back(), layout_, type_, blocks));
      writers_.push_back(std::move(writer));
    }
    return absl::OkStatus();
  }

  // Blocks [begin, end) in batches: cut in parallel, then written, each shard by one thread.
  absl::Status WriteBlocks(const Slab& slab, volume::BlockId begin, volume::BlockId end) {
    batch_.resize(static_cast<std::size_t>(plan_.batch_bytes));
    std::vector<std::size_t> offsets;
    for (volume::BlockId first = begin; first < end;) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      offsets.assign(1, 0);
      volume::BlockId last = first;
      for (; last < end; ++last) {
        const std::size_t next = offsets.back() + volume::StoredSizeBytes(layout_, last, type_);
        if (next > batch_.size()) {
          break;
        }
        offsets.push_back(next);
      }
      tbb::parallel_for(first, last, [&](volume::BlockId id) {
        if (!has_spans_) {
          ranges_.Set(id, SpanOfBlock(layout_, type_, slab, id));
        }
        CutBlock(layout_, type_, slab, id, batch_.data() + offsets[id - first]);
      });
      ISOSCOPE_RETURN_IF_ERROR(WriteBatch(first, offsets));
      first = last;
    }
    return absl::OkStatus();
  }

  absl::Status WriteBatch(volume::BlockId first, const std::vector<std::size_t>& offsets) {
    std::vector<std::size_t> order(offsets.size() - 1);
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return shard_of_block_[first + a] < shard_of_block_[first + b];
    });
    std::vector<std::size_t> run_begins;  // in `order`, one run a shard
    for (std::size_t i = 0; i < order.size(); ++i) {
      if (i == 0 || shard_of_block_[first + order[i]] != shard_of_block_[first + order[i - 1]]) {
        run_begins.push_back(i);
      }
    }
    run_begins.push_back(order.size());
    std::vector<absl::Status> statuses(run_begins.size() - 1);
    tbb::parallel_for(std::size_t{0}, statuses.size(), [&](std::size_t run) {
      for (std::size_t i = run_begins[run]; i < run_begins[run + 1] && statuses[run].ok(); ++i) {
        const std::size_t id = first + order[i];
        statuses[run] = writers_[shard_of_block_[id]]->WriteBlock(
            ordinals_[id], absl::string_view(batch_.data() + offsets[order[i]],
                                             offsets[order[i] + 1] - offsets[order[i]]));
      }
    });
    for (const absl::Status& status : statuses) {
      ISOSCOPE_RETURN_IF_ERROR(status);
    }
    return absl::OkStatus();
  }

  absl::Status WriteIndex(std::size_t shard) const {
    std::vector<index::BlockInterval> intervals;
    intervals.reserve(blocks_by_shard_[shard].size());
    for (const volume::BlockId id : blocks_by_shard_[shard]) {
      intervals.push_back({.span = ranges_.Get(id), .block_id = id, .ordinal = ordinals_[id]});
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<base::WritableFile> file,
                              base::CreateWritableFile(absl::StrCat(shard_directories_[shard], "/",
                                                                    store::kIntervalTreeFileName)));
    return index::BuildIntervalTree(std::move(intervals), file.get());
  }

  absl::StatusOr<store::Manifest> Finish(const std::string& directory, const std::string& name) {
    const std::string range_table = store::EncodeRangeTable(ranges_);
    const bool is_random = options_.distribution == store::Distribution::kRandom;
    store::Manifest manifest{.dataset_id = {},
                             .name = name,
                             .source = BaseName(source_.name()),
                             .geometry = source_.geometry(),
                             .scalar_type = type_,
                             .value_range = ranges_.Total(),
                             .block_cells = layout_.block_cells(),
                             .distribution = options_.distribution,
                             .seed = is_random ? options_.seed : 0,
                             .range_table_crc32c = base::Crc32c(range_table),
                             .shards = {}};
    for (std::size_t shard = 0; shard < writers_.size(); ++shard) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      ISOSCOPE_ASSIGN_OR_RETURN(store::ShardSummary summary, writers_[shard]->FinishBlocks());
      writers_[shard].reset();
      manifest.shards.push_back(summary);
      ISOSCOPE_RETURN_IF_ERROR(WriteIndex(shard));
    }
    manifest.dataset_id = store::ComputeDatasetId(manifest);
    for (std::size_t shard = 0; shard < shard_directories_.size(); ++shard) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      ISOSCOPE_RETURN_IF_ERROR(store::WriteDescriptions(shard_directories_[shard], manifest,
                                                        range_table, static_cast<int>(shard)));
      ISOSCOPE_RETURN_IF_ERROR(base::SyncDirectory(shard_directories_[shard]));
    }
    ISOSCOPE_RETURN_IF_ERROR(store::WriteDescriptions(directory, manifest, range_table, -1));
    ISOSCOPE_RETURN_IF_ERROR(base::SyncDirectory(directory));
    return manifest;
  }

  VolumeSource& source_;
  const PartitionOptions& options_;
  const base::Cancellation& cancellation_;
  const volume::BlockLayout layout_;
  const volume::ScalarType type_;
  const MemoryPlan plan_;
  const std::int64_t plane_bytes_;

  volume::RangeTable ranges_;
  bool has_spans_ = false;  // ranges_ was filled by a pass of its own
  PartitionProgress progress_;
  std::vector<char> planes_;
  std::vector<char> batch_;
  std::vector<std::uint16_t> shard_of_block_;                  // by block
  std::vector<std::uint32_t> ordinals_;                        // by block
  std::vector<std::vector<volume::BlockId>> blocks_by_shard_;  // by ordinal
  std::vector<std::string> shard_directories_;
  std::vector<std::unique_ptr<store::ShardWriter>> writers_;
};

}  // namespace

absl::StatusOr<store::Manifest> Partition(VolumeSource& source, const PartitionOptions& options,
                                          const base::Cancellation& cancellation) {
  const std::string output = WithoutTrailingSlashes(options.output_directory);
  ISOSCOPE_RETURN_IF_ERROR(volume::Validate(source.geometry()));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::BlockLayout layout,
      volume::BlockLayout::Make(source.geometry().sample_dims, options.block_cells));
  ISOSCOPE_RETURN_IF_ERROR(ValidateShardCount(options.shard_count, layout));
  ISOSCOPE_ASSIGN_OR_RETURN(const MemoryPlan plan,
                            PlanMemory(layout, source.scalar_type(), options));
  ISOSCOPE_RETURN_IF_ERROR(ValidateOutput(output));
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());

  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<PartialDirectory> partial,
                            PartialDirectory::Create(absl::StrCat(output, ".partial-", getpid())));
  // Closes its files before `partial` is removed.
  Partitioner partitioner(&source, options, layout, plan, cancellation);
  ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest manifest,
                            partitioner.Run(partial->path(), BaseName(output)));
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  ISOSCOPE_RETURN_IF_ERROR(base::RenamePath(partial->path(), output));
  partial->Keep();
  return manifest;
}

}  // namespace isoscope::ingest
