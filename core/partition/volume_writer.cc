// Blocks are read in the order of the volume, and files are written in the order of each shard.
// Records that know both are sorted on disk, so no table of all blocks is in memory.
//
//    1  ShardMap: the shard of each block
//                |
//    2  all blocks in the order of shards (PlaceAll): next ordinal and offset of the shard
//                |
//                |  Placement {position, shard, ordinal, offset}
//                v
//       PlacementQueue, sorted by position: the order in which blocks are cut
//                |
//    3  portion -> Fill -> BatchCutter -> ShardSet -> blocks.bin of each shard, at the offset;
//                |                                    encoded blocks one after the other
//                |
//                |  Entry {shard, ordinal, id, span, CRC-32C, encoding, offset, size}
//                v
//       ShardSet, sorted by (shard, ordinal)
//                |
//    4  Finish, shard by shard: block_index.bin, interval_tree.bin, histogram.bin; encoded
//       blocks that were cut in another order than the shard's are copied into it
//                |
//    5  ranges.bin, which grows along with 3; Describe: shard.json and manifest.json of each shard;
//       the dataset's manifest.json
//
// A LevelSpool takes the samples of the next level along with 3.
//
// Example: blocks A, B, C of 100 stored bytes, in the order of shards, go to the shards 0, 1, 0.
// Their placements have the ordinals 0, 0, 1 and the offsets 0, 0, 100. If C is cut before B, its
// position is the lower one, and C is written first.
//
// The next portion is read, a batch is cut and the batches before it are written at the same time.
//
// Invariants: the placement taken next has the position that counts the blocks cut so far; the
// entries of a shard have the ordinals 0, 1, 2, ...; the bytes depend on source and options alone.
//
// Files: docs/format/dataset.md, docs/format/shard.md. Distributions: distribution.h.

#include "core/partition/volume_writer.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "absl/functional/function_ref.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "oneapi/tbb/enumerable_thread_specific.h"
#include "oneapi/tbb/parallel_for.h"

#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/partition/block_batch.h"
#include "core/partition/distribution.h"
#include "core/partition/output_folder.h"
#include "core/partition/partition_plan.h"
#include "core/partition/portion_reader.h"
#include "core/partition/samples_digest.h"
#include "core/partition/shard_set.h"
#include "core/store/block_order.h"
#include "core/store/shard_writer.h"

namespace isoscope::partition {
namespace {

// Encoded blocks of most volumes take less than this fraction of the raw ones.
constexpr std::int64_t kExpectedCompression = 2;

absl::Status CopyFile(const std::string& from, const std::string& to) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto in, io::OpenRandomAccessFile(from));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto out, io::CreateWritableFile(to));
  std::string buffer(static_cast<std::size_t>(base::kMiB), '\0');
  for (std::int64_t offset = 0; offset < in->size_bytes();) {
    const auto size = static_cast<std::size_t>(
        std::min(in->size_bytes() - offset, static_cast<std::int64_t>(buffer.size())));
    ISOSCOPE_RETURN_IF_ERROR(in->ReadAt(offset, size, buffer.data()));
    ISOSCOPE_RETURN_IF_ERROR(out->Append({buffer.data(), size}));
    offset += static_cast<std::int64_t>(size);
  }
  return out->Close();
}

// Sets the spans of a portion's blocks.
void FindSpans(const volume::BlockLayout& layout, volume::ScalarType type, const Slab& slab,
               const Portion& portion, volume::RangeTable* ranges) {
  const math::Index3& dims = layout.block_dims();
  const std::int64_t rows = portion.end_row - portion.begin_row;
  tbb::parallel_for(
      std::int64_t{0}, (portion.end_layer - portion.begin_layer) * rows, [&](std::int64_t row) {
        math::Index3 index{0, portion.begin_row + row % rows, portion.begin_layer + row / rows};
        for (; index.x < dims.x; ++index.x) {
          const volume::BlockId id = layout.IdOf(index);
          ranges->Set(id, SpanOfBlock(layout, type, slab, id));
        }
      });
}

// Adds the rows of samples that belong to this portion and to no other: those of its blocks'
// cells, and the last ones of the volume.
void AddToDigest(const volume::BlockLayout& layout, volume::ScalarType type, const Slab& slab,
                 const Portion& portion, SamplesDigest* sum) {
  const math::Index3& dims = layout.sample_dims();
  const math::Index3& cells = layout.block_cells();
  const auto end_of = [](std::int64_t blocks, std::int64_t all_blocks, std::int64_t edge,
                         std::int64_t samples) {
    return blocks == all_blocks ? samples : blocks * edge;
  };
  const std::int64_t begin_y = portion.begin_row * cells.y;
  const std::int64_t end_y = end_of(portion.end_row, layout.block_dims().y, cells.y, dims.y);
  const std::int64_t end_z = end_of(portion.end_layer, layout.block_dims().z, cells.z, dims.z);
  const std::int64_t slab_rows = slab.rows == 0 ? dims.y : slab.rows;
  const auto row_bytes = static_cast<std::size_t>(dims.x) * volume::SizeOf(type);
  tbb::enumerable_thread_specific<SamplesDigest> digests;
  tbb::parallel_for(portion.begin_layer * cells.z, end_z, [&](std::int64_t z) {
    SamplesDigest& digest = digests.local();
    for (std::int64_t y = begin_y; y < end_y; ++y) {
      const std::int64_t row = (z - slab.begin_z) * slab_rows + y - slab.begin_y;
      digest.AddRow(y, z, {slab.samples + static_cast<std::size_t>(row) * row_bytes, row_bytes});
    }
  });
  for (const SamplesDigest& digest : digests) {
    sum->Add(digest);
  }
}

}  // namespace

VolumeWriter::VolumeWriter(source::VolumeSource* source, const PartitionOptions& options,
                           volume::BlockLayout layout, const PartitionPlan& plan,
                           const base::Cancellation& cancellation)
    : source_(*source),
      options_(options),
      cancellation_(cancellation),
      layout_(layout),
      type_(source->info().type),
      plan_(plan),
      pass_bytes_(PassBytes(source->info())) {
  progress_.total_bytes = pass_bytes_ * PassCount(options);
}

int VolumeWriter::PassCount(const PartitionOptions& options) {
  return options.distribution == store::Distribution::kGreedy ? 2 : 1;
}

std::int64_t VolumeWriter::PassBytes(const source::SourceInfo& info) {
  return math::Volume(info.geometry.sample_dims) *
         static_cast<std::int64_t>(volume::SizeOf(info.type));
}

absl::StatusOr<store::Manifest> VolumeWriter::Write(const std::string& directory,
                                                    const std::string& name,
                                                    LevelSpool* next_level) {
  ISOSCOPE_RETURN_IF_ERROR(
      WriteLayers(directory, {.begin = 0, .end = layout_.block_dims().z}, next_level));
  return Finish(name);
}

absl::StatusOr<SlabSummary> VolumeWriter::WriteSlab(const std::string& directory,
                                                    const LayerRange& layers,
                                                    LevelSpool* next_level) {
  pass_bytes_ = static_cast<std::int64_t>(static_cast<double>(pass_bytes_) *
                                          static_cast<double>(layers.end - layers.begin) /
                                          static_cast<double>(layout_.block_dims().z));
  progress_.total_bytes = pass_bytes_;
  ISOSCOPE_RETURN_IF_ERROR(WriteLayers(directory, layers, next_level));
  SlabSummary summary{.shards = {},
                      .ranges_crc32c = 0,
                      .value_range = value_range_,
                      .finite_range = cutter_->histograms().finite_range(),
                      .max_gradient_magnitude = cutter_->max_gradient_magnitude(),
                      .digest_sum = samples_digest_.sum()};
  ISOSCOPE_ASSIGN_OR_RETURN(summary.shards,
                            shards_->FinishPieces(cutter_->histograms(), cancellation_));
  ISOSCOPE_ASSIGN_OR_RETURN(summary.ranges_crc32c, range_writer_->Finish());
  cutter_.reset();
  shards_.reset();
  return summary;
}

absl::Status VolumeWriter::WriteLayers(const std::string& directory, const LayerRange& layers,
                                       LevelSpool* next_level) {
  PortionReader reader(&source_, layout_, plan_, directory, &cancellation_);
  ISOSCOPE_ASSIGN_OR_RETURN(const ShardMap map, DealOut(&reader));
  progress_.phase = "writing blocks";
  placements_.emplace(directory, layout_, type_, plan_);
  ISOSCOPE_RETURN_IF_ERROR(placements_->PlaceAll(map, layers));
  shards_.emplace(directory, layout_, type_, plan_, options_.compression, options_.in_source);
  const std::int64_t raw_bytes = StoredBytes(layout_, type_, layers.begin, layers.end);
  const bool is_raw =
      options_.compression == store::BlockEncoding::kRaw && !options_.in_source.has_value();
  const std::int64_t expected_bytes = is_raw ? raw_bytes : raw_bytes / kExpectedCompression;
  const bool is_direct = expected_bytes > options_.max_cached_bytes.value_or(CachedBytes());
  ISOSCOPE_RETURN_IF_ERROR(shards_->Create(options_.shard_count, is_direct));
  batch_writer_.emplace(&*shards_, static_cast<std::size_t>(plan_.batch_count));
  ISOSCOPE_ASSIGN_OR_RETURN(range_writer_,
                            store::RangeTableWriter::Create(
                                absl::StrCat(directory, "/", store::kRangeTableFileName), type_));
  cutter_.emplace(layout_, type_, source_.info().geometry, options_.shard_count);
  const auto visit = [&](const Slab& slab, const Portion& portion) -> absl::Status {
    AddToDigest(layout_, type_, slab, portion, &samples_digest_);
    if (next_level != nullptr) {
      ISOSCOPE_RETURN_IF_ERROR(next_level->Add(layout_, slab, portion));
    }
    return WriteBlocks(slab, portion);
  };
  ISOSCOPE_RETURN_IF_ERROR(Pass(&reader, layers, visit));
  ISOSCOPE_RETURN_IF_ERROR(batch_writer_->Finish());
  batch_writer_.reset();
  placements_.reset();
  progress_.phase = "building index";
  Report();
  return absl::OkStatus();
}

absl::Status VolumeWriter::Pass(
    PortionReader* reader, const LayerRange& layers,
    absl::FunctionRef<absl::Status(const Slab&, const Portion&)> visit) {
  const std::int64_t done_before = progress_.done_bytes;
  ISOSCOPE_RETURN_IF_ERROR(
      reader->ForEachPortion(PortionsOf(layout_, plan_, layers), visit, [&](double share) {
        progress_.done_bytes =
            done_before + static_cast<std::int64_t>(static_cast<double>(pass_bytes_) * share);
        Report();
      }));
  progress_.done_bytes = done_before + pass_bytes_;
  Report();
  return absl::OkStatus();
}

void VolumeWriter::Report() const {
  if (options_.progress) {
    options_.progress(progress_);
  }
}

// Step 1 assigns blocks to shards. The greedy distribution takes a pass of its own.
absl::StatusOr<ShardMap> VolumeWriter::DealOut(PortionReader* reader) {
  if (options_.in_source.has_value()) {
    return ShardMap::RandomUnits(BlockUnits(layout_, *options_.in_source), options_.shard_count,
                                 options_.seed);
  }
  if (options_.distribution != store::Distribution::kGreedy) {
    return ShardMap::Random(layout_.block_count(), options_.shard_count, options_.seed);
  }
  progress_.phase = "reading ranges";
  volume::RangeTable ranges(type_, layout_.block_count());
  ISOSCOPE_RETURN_IF_ERROR(Pass(reader, {.begin = 0, .end = layout_.block_dims().z},
                                [&](const Slab& slab, const Portion& portion) {
                                  FindSpans(layout_, type_, slab, portion, &ranges);
                                  return absl::OkStatus();
                                }));
  return ShardMap::Greedy(ranges, options_.shard_count);
}

// Step 3 cuts the blocks of a portion in batches, in parallel, while those before are written.
absl::Status VolumeWriter::WriteBlocks(const Slab& slab, const Portion& portion) {
  store::BlocksInOrder blocks(BlocksOfPortion(layout_, portion));
  // The ids of a portion's blocks are consecutive.
  const volume::BlockId first_id = layout_.IdOf({0, portion.begin_row, portion.begin_layer});
  volume::RangeTable ranges(type_, (portion.end_layer - portion.begin_layer) *
                                       (portion.end_row - portion.begin_row) *
                                       layout_.block_dims().x);
  while (!blocks.is_at_end()) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    ISOSCOPE_ASSIGN_OR_RETURN(BlockBatch* const batch, batch_writer_->Take());
    ISOSCOPE_RETURN_IF_ERROR(placements_->Fill(&blocks, batch));
    cutter_->Cut(slab, batch);
    for (std::size_t i = 0; i < batch->blocks.size(); ++i) {
      ranges.Set(batch->blocks[i].id - first_id, batch->spans[i]);
    }
    batch_writer_->Write(batch);
  }
  const volume::ScalarSpan total = ranges.Total();
  value_range_.min = std::min(value_range_.min, total.min);
  value_range_.max = std::max(value_range_.max, total.max);
  return range_writer_->Append(ranges);
}

// Steps 4 and 5 finish all shards and the range table.
absl::StatusOr<store::Manifest> VolumeWriter::Finish(const std::string& name) {
  store::Manifest manifest;
  ISOSCOPE_ASSIGN_OR_RETURN(manifest.shards, shards_->Finish(cutter_->histograms(), cancellation_));
  ISOSCOPE_ASSIGN_OR_RETURN(manifest.range_table_crc32c, range_writer_->Finish());
  const bool is_random = options_.distribution == store::Distribution::kRandom;
  manifest.name = name;
  manifest.source =
      options_.source_name.empty() ? BaseName(source_.info().name) : options_.source_name;
  manifest.geometry = source_.info().geometry;
  manifest.patient_frame = source_.info().patient_frame;
  manifest.labels = options_.labels;
  manifest.scalar_type = type_;
  manifest.value_range = value_range_;
  if (value_range_.min <= value_range_.max && !volume::IsFinite(value_range_)) {
    manifest.finite_range = cutter_->histograms().finite_range();
  }
  manifest.max_gradient_magnitude = cutter_->max_gradient_magnitude();
  manifest.block_cells = layout_.block_cells();
  manifest.distribution = options_.distribution;
  manifest.seed = is_random ? options_.seed : 0;
  manifest.in_source = options_.in_source;
  manifest.samples_digest = samples_digest_.Finish(manifest.geometry, type_);
  manifest.dataset_id = store::ComputeDatasetId(manifest);
  cutter_.reset();
  shards_.reset();
  return manifest;
}

absl::Status DescribeShards(const std::string& directory, const store::Manifest& manifest,
                            const base::Cancellation& cancellation) {
  const auto shard_count = static_cast<int>(manifest.shards.size());
  for (int shard = 0; shard < shard_count; ++shard) {
    const std::string shard_directory =
        absl::StrCat(directory, "/", store::ShardDirectoryName(shard, shard_count));
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    ISOSCOPE_RETURN_IF_ERROR(
        CopyFile(absl::StrCat(directory, "/", store::kRangeTableFileName),
                 absl::StrCat(shard_directory, "/", store::kRangeTableFileName)));
    ISOSCOPE_RETURN_IF_ERROR(store::WriteDescriptions(shard_directory, manifest, shard));
    ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(shard_directory));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::partition
