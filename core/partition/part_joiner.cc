// Joining takes these steps:
//
//   1  the records of all parts and volumes are read: none is missing, all are of one cut
//   2  for each volume, in "<output>.partial-XXXXXX":
//        shards      JoinShard (store/shard_joiner.h), the interval tree, the sum of the histograms
//        ranges.bin  those of the slabs, one after the other
//        manifest    the digest is a sum over rows, ranges and gradients are maxima: so the parts
//                    do not show
//        levels      a LevelSpool takes the samples of level 1 from the parts, and WriteLevels goes
//                    on as it does after one process has cut the volume
//   3  the manifests; the output gets its name; the parts are removed
//
// Parts are only read until the output has its name. A process that is killed before leaves them
// as they were; after it, the next one compares digests and removes them.

#include "core/partition/part_joiner.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/crc32c.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/index/interval_tree_builder.h"
#include "core/io/file.h"
#include "core/io/work_folder.h"
#include "core/partition/level_spool.h"
#include "core/partition/level_writer.h"
#include "core/partition/output_folder.h"
#include "core/partition/part_folder.h"
#include "core/partition/partition_plan.h"
#include "core/partition/samples_digest.h"
#include "core/partition/series_partitioner.h"
#include "core/partition/volume_writer.h"
#include "core/store/histogram_file.h"
#include "core/store/part_file.h"
#include "core/store/shard_joiner.h"
#include "core/store/shard_reader.h"
#include "core/store/shard_writer.h"

namespace isoscope::partition {
namespace {

constexpr char kJoining[] = "joining blocks";

// The pieces of a volume, by part.
struct Pieces {
  std::string volume;  // its folder
  std::vector<store::PieceRecord> records;
};

// "3", "3 and 5", "3, 5 and 7", "3, 5, 7, 9 and 12 more".
std::string ListOf(const std::vector<int>& parts) {
  constexpr std::size_t kMaxListed = 12;
  std::string text = absl::StrCat(parts.front());
  const std::size_t listed = std::min(parts.size(), kMaxListed);
  for (std::size_t i = 1; i < listed; ++i) {
    absl::StrAppend(&text, i + 1 == parts.size() ? " and " : ", ", parts[i]);
  }
  return listed < parts.size() ? absl::StrCat(text, " and ", parts.size() - listed, " more") : text;
}

absl::Status MissingError(const PartFolder& folder, const PartsState& state,
                          const std::vector<int>& missing) {
  const int count = state.cut.part.count;
  return absl::FailedPreconditionError(absl::StrFormat(
      "%s: %s %s of %d %s not finished: run `isoscope partition SOURCE --part %d/%d --output %s` "
      "with the source and the flags of the others%s; `isoscope info %s` shows all parts",
      folder.parts_path(), missing.size() == 1 ? "part" : "parts", ListOf(missing), count,
      missing.size() == 1 ? "is" : "are", missing.front(), count, base::ShellWord(folder.output()),
      missing.size() == 1 ? "" : ", and so for each", base::ShellWord(folder.path())));
}

// Step 1.
absl::StatusOr<std::vector<Pieces>> ReadPieces(const PartFolder& folder, const PartsState& state) {
  const std::string digest = state.cut.Digest();
  std::vector<Pieces> volumes;
  std::vector<int> missing;
  for (const PartState& part : state.parts) {
    if (!part.has_begun || part.finished_volumes < state.volume_count) {
      missing.push_back(part.part.index);
    }
  }
  if (!missing.empty()) {
    return MissingError(folder, state, missing);
  }
  for (const std::string& volume : VolumesOf(state.cut)) {
    Pieces& pieces = volumes.emplace_back();
    pieces.volume = volume;
    for (const PartState& part : state.parts) {
      ISOSCOPE_ASSIGN_OR_RETURN(std::optional<store::PieceRecord> record,
                                folder.ReadPiece(volume, part.part));
      if (!record.has_value()) {
        return MissingError(folder, state, {part.part.index});
      }
      if (record->cut_digest != digest || record->part != part.part ||
          (!pieces.records.empty() &&
           record->shards.size() != pieces.records.front().shards.size())) {
        return absl::FailedPreconditionError(absl::StrFormat(
            "%s: was cut of another source or with other flags than the other parts: run `isoscope "
            "partition SOURCE --part %d/%d --output %s` again",
            folder.PiecePath(volume, part.part), part.part.index, part.part.count,
            base::ShellWord(folder.output())));
      }
      pieces.records.push_back(*std::move(record));
    }
  }
  return volumes;
}

// Adds a histogram whose bins are narrower, or the same (volume/sample_histogram.h). False if they
// are not within those of the sum.
bool AddHistogram(const volume::SampleHistogram& part, volume::SampleHistogram* sum) {
  // Shifts of more bits than an index has move all of it.
  const int shift = std::min(sum->bins.exponent - part.bins.exponent, 63);
  if (part.bins.count > 0 && shift < 0) {
    return false;
  }
  for (std::int64_t i = 0; i < part.bins.count; ++i) {
    const std::int64_t index = ((part.bins.first + i) >> shift) - sum->bins.first;
    if (index < 0 || index >= sum->bins.count) {
      return false;
    }
    sum->counts[static_cast<std::size_t>(index)] += part.counts[static_cast<std::size_t>(i)];
  }
  sum->nan_count += part.nan_count;
  sum->negative_infinity_count += part.negative_infinity_count;
  sum->positive_infinity_count += part.positive_infinity_count;
  return true;
}

volume::ScalarSpan Union(const volume::ScalarSpan& a, const volume::ScalarSpan& b) {
  return {std::min(a.min, b.min), std::max(a.max, b.max)};
}

absl::Status Damaged(const std::string& path) {
  return absl::DataLossError(absl::StrCat(
      path, ": damaged: not what the part has written; remove its folder and run the part again"));
}

// Joins one volume.
class VolumeJoiner {
 public:
  // report: takes the bytes that were joined, and the phase
  VolumeJoiner(const PartFolder& folder, const Pieces& pieces, const volume::BlockLayout& layout,
               const JoinOptions& options, std::function<void(const char*, std::int64_t)> report,
               const base::Cancellation& cancellation)
      : folder_(folder),
        pieces_(pieces),
        layout_(layout),
        options_(options),
        report_(std::move(report)),
        cancellation_(cancellation) {}

  // Writes the shards and the range table into `directory`, which exists; the shards get their
  // descriptions.
  absl::StatusOr<store::Manifest> Join(const std::string& directory) {
    store::Manifest manifest = pieces_.records.front().manifest;
    ISOSCOPE_ASSIGN_OR_RETURN(const PartitionPlan plan, MakePlan(manifest));
    const auto shard_count = static_cast<int>(pieces_.records.front().shards.size());
    const volume::HistogramBins bins =
        volume::BinsOf(manifest.scalar_type, Sum(&store::PieceRecord::finite_range));
    manifest.shards.clear();
    for (int shard = 0; shard < shard_count; ++shard) {
      ISOSCOPE_ASSIGN_OR_RETURN(
          manifest.shards.emplace_back(),
          JoinShard(shard, manifest.scalar_type, bins, plan,
                    absl::StrCat(directory, "/", store::ShardDirectoryName(shard, shard_count))));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(manifest.range_table_crc32c,
                              JoinRanges(directory, manifest.scalar_type));
    Describe(&manifest);
    ISOSCOPE_RETURN_IF_ERROR(AddLevels(directory, &manifest));
    ISOSCOPE_RETURN_IF_ERROR(DescribeShards(directory, manifest, cancellation_));
    return manifest;
  }

  static std::string DigestOf(const Pieces& pieces) {
    SamplesDigest digest;
    for (const store::PieceRecord& record : pieces.records) {
      digest.AddSum(record.digest_sum);
    }
    const store::Manifest& manifest = pieces.records.front().manifest;
    return digest.Finish(manifest.geometry, manifest.scalar_type);
  }

 private:
  [[nodiscard]] volume::ScalarSpan Sum(volume::ScalarSpan store::PieceRecord::*member) const {
    volume::ScalarSpan span;
    for (const store::PieceRecord& record : pieces_.records) {
      span = Union(span, record.*member);
    }
    return span;
  }

  absl::StatusOr<PartitionPlan> MakePlan(const store::Manifest& manifest) const {
    std::int64_t largest = 0;
    for (const store::PieceRecord& record : pieces_.records) {
      largest = std::max(largest, record.ranges_bytes);
    }
    return PlanPartition(
        layout_, manifest.scalar_type, static_cast<int>(pieces_.records.front().shards.size()),
        store::Distribution::kRandom, options_.reserved_bytes + store::kJoinBytes + 2 * largest,
        options_.memory_limit_bytes);
  }

  // Whether blocks are written past the page cache, as those of one process are (CachedBytes).
  [[nodiscard]] bool IsDirect() const {
    std::int64_t bytes = 0;
    for (const store::PieceRecord& record : pieces_.records) {
      for (const store::ShardPiece& shard : record.shards) {
        bytes += shard.summary.block_bytes;
      }
    }
    return bytes > options_.max_cached_bytes.value_or(CachedBytes());
  }

  absl::StatusOr<store::ShardSummary> JoinShard(int shard, volume::ScalarType type,
                                                const volume::HistogramBins& bins,
                                                const PartitionPlan& plan,
                                                const std::string& directory) {
    ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(directory));
    std::vector<store::PieceOfShard> pieces;
    volume::SampleHistogram histogram{
        .bins = bins, .counts = std::vector<std::int64_t>(static_cast<std::size_t>(bins.count))};
    for (const store::PieceRecord& record : pieces_.records) {
      const store::ShardPiece& piece = record.shards[static_cast<std::size_t>(shard)];
      if (piece.summary.block_count == 0) {
        continue;
      }
      pieces.push_back(
          {.directory = absl::StrCat(
               folder_.PiecePath(pieces_.volume, record.part), "/",
               store::ShardDirectoryName(shard, static_cast<int>(record.shards.size()))),
           .piece = piece});
      ISOSCOPE_RETURN_IF_ERROR(ReadHistogram(pieces.back(), type, &histogram));
    }
    index::IntervalTreeBuilder tree({.scratch_directory = directory,
                                     .memory_bytes = plan.tree_bytes,
                                     .cancellation = &cancellation_});
    std::int64_t joined_bytes = 0;
    ISOSCOPE_ASSIGN_OR_RETURN(
        const store::ShardSummary summary,
        store::JoinShard(
            pieces, layout_, type, directory, IsDirect(),
            pieces_.records.front().manifest.in_source.has_value(),
            [&](const store::JoinedBlock& block) {
              constexpr std::uint32_t kBlocksBetweenReports = 4096;
              if (block.ordinal % kBlocksBetweenReports == 0) {
                report_(kJoining, joined_bytes);
              }
              return tree.Add({.span = block.span, .block_id = block.id, .ordinal = block.ordinal});
            },
            cancellation_));
    report_(kJoining, summary.block_bytes);
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::unique_ptr<io::WritableFile> file,
        io::CreateWritableFile(absl::StrCat(directory, "/", store::kIntervalTreeFileName)));
    ISOSCOPE_RETURN_IF_ERROR(tree.Finish(file.get()));
    ISOSCOPE_RETURN_IF_ERROR(
        io::WriteWholeFile(absl::StrCat(directory, "/", store::kHistogramFileName),
                           store::EncodeHistogram(type, histogram)));
    return summary;
  }

  static absl::Status ReadHistogram(const store::PieceOfShard& piece, volume::ScalarType type,
                                    volume::SampleHistogram* sum) {
    const std::string path = absl::StrCat(piece.directory, "/", store::kHistogramFileName);
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                              io::ReadWholeFile(path, store::kMaxHistogramFileBytes));
    if (base::Crc32c(bytes) != piece.piece.histogram_crc32c) {
      return Damaged(path);
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::SampleHistogram histogram,
                              store::DecodeHistogram(bytes, type, path));
    return AddHistogram(histogram, sum) ? absl::OkStatus() : Damaged(path);
  }

  absl::StatusOr<std::uint32_t> JoinRanges(const std::string& directory,
                                           volume::ScalarType type) const {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<store::RangeTableWriter> writer,
                              store::RangeTableWriter::Create(
                                  absl::StrCat(directory, "/", store::kRangeTableFileName), type));
    for (const store::PieceRecord& record : pieces_.records) {
      if (record.ranges_bytes == 0) {
        continue;
      }
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      const std::string path = absl::StrCat(folder_.PiecePath(pieces_.volume, record.part), "/",
                                            store::kRangeTableFileName);
      ISOSCOPE_ASSIGN_OR_RETURN(const std::string bytes,
                                io::ReadWholeFile(path, record.ranges_bytes));
      if (base::Crc32c(bytes) != record.ranges_crc32c) {
        return Damaged(path);
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const volume::RangeTable ranges,
                                store::DecodeRangeTable(bytes, path));
      if (ranges.type() != type) {
        return Damaged(path);
      }
      ISOSCOPE_RETURN_IF_ERROR(writer->Append(ranges));
    }
    return writer->Finish();
  }

  void Describe(store::Manifest* manifest) const {
    manifest->value_range = Sum(&store::PieceRecord::value_range);
    if (manifest->value_range.min <= manifest->value_range.max &&
        !volume::IsFinite(manifest->value_range)) {
      manifest->finite_range = Sum(&store::PieceRecord::finite_range);
    }
    double gradient = 0;
    for (const store::PieceRecord& record : pieces_.records) {
      gradient = std::max(gradient, record.max_gradient_magnitude);
    }
    manifest->max_gradient_magnitude = gradient;
    manifest->samples_digest = DigestOf(pieces_);
    manifest->dataset_id = store::ComputeDatasetId(*manifest);
  }

  absl::Status AddLevels(const std::string& directory, store::Manifest* manifest) {
    const store::PieceRecord& first = pieces_.records.front();
    const LevelPlan levels{.highest = first.highest_level, .filter = first.level_filter};
    if (levels.highest == 0) {
      return absl::OkStatus();
    }
    PartitionOptions options;
    options.shard_count = static_cast<int>(manifest->shards.size());
    options.block_cells = manifest->block_cells;
    options.seed = manifest->seed;
    options.compression = first.compression;
    options.memory_limit_bytes = options_.memory_limit_bytes;
    options.reserved_bytes = options_.reserved_bytes;
    options.progress = [this](const PartitionProgress& progress) {
      report_("writing levels", progress.done_bytes);
    };
    ISOSCOPE_RETURN_IF_ERROR(
        CheckLevelsFit(manifest->geometry, manifest->scalar_type, levels, options));
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<LevelSpool> level1,
        CreateSpoolOfLevel1(directory, manifest->geometry, manifest->scalar_type, levels));
    ISOSCOPE_RETURN_IF_ERROR(FillSpool(level1.get()));
    std::vector<std::string> shards;
    for (int shard = 0; shard < options.shard_count; ++shard) {
      shards.push_back(
          absl::StrCat(directory, "/", store::ShardDirectoryName(shard, options.shard_count)));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(manifest->levels,
                              WriteLevels(*manifest, shards, directory, levels, std::move(level1),
                                          options, cancellation_));
    manifest->level_filter = levels.filter;
    return absl::OkStatus();
  }

  absl::Status FillSpool(LevelSpool* level1) const {
    const math::Index3& dims = level1->level().grid.sample_dims;
    const std::int64_t row_bytes =
        dims.x * static_cast<std::int64_t>(volume::SizeOf(level1->level().type));
    const std::int64_t step = std::max<std::int64_t>(base::kMiB / row_bytes, 1);
    std::string buffer;
    for (const store::PieceRecord& record : pieces_.records) {
      if (record.level1_bytes == 0) {
        continue;
      }
      const LayerRange planes = level1->PlanesOf(layout_, LayersOfPart(layout_, record.part));
      const std::string path =
          absl::StrCat(folder_.PiecePath(pieces_.volume, record.part), "/", store::kLevel1FileName);
      ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(path));
      const std::int64_t rows = (planes.end - planes.begin) * dims.y;
      if (file->size_bytes() != record.level1_bytes || file->size_bytes() != rows * row_bytes) {
        return Damaged(path);
      }
      std::uint32_t crc32c = 0;
      for (std::int64_t row = 0; row < rows; row += step) {
        ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
        const std::int64_t count = std::min(step, rows - row);
        buffer.resize(static_cast<std::size_t>(count * row_bytes));
        ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(row * row_bytes, buffer.size(), buffer.data()));
        crc32c = base::ExtendCrc32c(crc32c, buffer.data(), buffer.size());
        ISOSCOPE_RETURN_IF_ERROR(
            level1->AddRows(planes.begin * dims.y + row, buffer.data(), count));
      }
      if (crc32c != record.level1_crc32c) {
        return Damaged(path);
      }
    }
    return absl::OkStatus();
  }

  const PartFolder& folder_;
  const Pieces& pieces_;
  const volume::BlockLayout& layout_;
  const JoinOptions& options_;
  const std::function<void(const char*, std::int64_t)> report_;
  const base::Cancellation& cancellation_;
};

// One call of JoinParts, once the parts are known.
class DatasetJoiner {
 public:
  DatasetJoiner(const PartFolder& folder, const PartsState& state,
                const std::vector<Pieces>& volumes, const JoinOptions& options,
                const base::Cancellation& cancellation)
      : folder_(folder),
        state_(state),
        volumes_(volumes),
        options_(options),
        cancellation_(cancellation) {
    for (const Pieces& pieces : volumes) {
      total_bytes_ += BytesOf(pieces);
    }
  }

  // Steps 2 and 3, but for the removal.
  absl::StatusOr<JoinedDataset> Run() {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<OutputFolder> output,
                              OutputFolder::Make(folder_.output(), state_.cut.name));
    ISOSCOPE_RETURN_IF_ERROR(output->Create());
    JoinedDataset joined{
        .directory = folder_.output(), .part_count = state_.cut.part.count, .volume = std::nullopt};
    if (state_.cut.series.has_value()) {
      ISOSCOPE_ASSIGN_OR_RETURN(joined.series, JoinSeries(output->partial_path()));
    } else {
      ISOSCOPE_ASSIGN_OR_RETURN(joined.volume,
                                JoinVolume(volumes_.front(), output->partial_path()));
      ISOSCOPE_RETURN_IF_ERROR(
          store::WriteDescriptions(output->partial_path(), *joined.volume, -1));
    }
    ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(output->partial_path()));
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    ISOSCOPE_RETURN_IF_ERROR(output->Commit());
    return joined;
  }

 private:
  static std::int64_t BytesOfBlocks(const Pieces& pieces) {
    std::int64_t bytes = 0;
    for (const store::PieceRecord& record : pieces.records) {
      for (const store::ShardPiece& shard : record.shards) {
        bytes += shard.summary.block_bytes;
      }
    }
    return bytes;
  }
  static std::int64_t BytesOf(const Pieces& pieces) {
    const store::PieceRecord& first = pieces.records.front();
    return BytesOfBlocks(pieces) +
           BytesOfLevels({.highest = first.highest_level, .filter = first.level_filter},
                         first.manifest.geometry, first.manifest.scalar_type);
  }

  absl::StatusOr<store::Manifest> JoinVolume(const Pieces& pieces, const std::string& directory) {
    const store::Manifest& manifest = pieces.records.front().manifest;
    ISOSCOPE_ASSIGN_OR_RETURN(
        const volume::BlockLayout layout,
        volume::BlockLayout::Make(manifest.geometry.sample_dims, manifest.block_cells));
    const std::int64_t block_bytes = BytesOfBlocks(pieces);
    std::int64_t shard_bytes = 0;  // of the shards that are whole
    std::int64_t last_bytes = 0;
    const auto report = [&](const char* phase, std::int64_t bytes) {
      if (!options_.progress) {
        return;
      }
      const bool is_level = phase != kJoining;
      if (!is_level && bytes < last_bytes) {
        shard_bytes += last_bytes;
      }
      last_bytes = is_level ? 0 : bytes;
      options_.progress({.phase = phase,
                         .done_bytes = done_bytes_ + (is_level ? block_bytes : shard_bytes) + bytes,
                         .total_bytes = total_bytes_});
    };
    VolumeJoiner joiner(folder_, pieces, layout, options_, report, cancellation_);
    ISOSCOPE_ASSIGN_OR_RETURN(store::Manifest joined, joiner.Join(directory));
    done_bytes_ += BytesOf(pieces);
    return joined;
  }

  absl::StatusOr<store::SeriesManifest> JoinSeries(const std::string& directory) {
    store::SeriesManifest series = *state_.cut.series;
    for (int shard = 0; shard < series.shard_count; ++shard) {
      ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(ShardPath(directory, shard, series)));
    }
    for (std::size_t i = 0; i < volumes_.size(); ++i) {
      const std::string work = directory + "/volume";
      ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(work));
      ISOSCOPE_ASSIGN_OR_RETURN(const store::Manifest manifest, JoinVolume(volumes_[i], work));
      for (int shard = 0; shard < series.shard_count; ++shard) {
        ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(
            ShardPath(work, shard, series),
            absl::StrCat(ShardPath(directory, shard, series), "/", volumes_[i].volume)));
      }
      ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(work));
      ISOSCOPE_ASSIGN_OR_RETURN(series.volumes.emplace_back(),
                                LineOf(state_.cut.keys[i], manifest));
    }
    std::sort(
        series.volumes.begin(), series.volumes.end(),
        [](const store::ScalarVolume& a, const store::ScalarVolume& b) { return a.key < b.key; });
    series.dataset_id = ComputeSeriesId(series);
    ISOSCOPE_RETURN_IF_ERROR(WriteSeriesManifests(directory, series));
    return series;
  }

  static std::string ShardPath(const std::string& directory, int shard,
                               const store::SeriesManifest& series) {
    return absl::StrCat(directory, "/", store::ShardDirectoryName(shard, series.shard_count));
  }

  static absl::StatusOr<store::ScalarVolume> LineOf(const store::ScalarVolumeKey& key,
                                                    const store::Manifest& manifest) {
    store::ScalarVolume volume;
    volume.key = key;
    volume.dataset_id = manifest.dataset_id;
    ISOSCOPE_ASSIGN_OR_RETURN(
        volume.manifest_crc32c,
        store::ManifestCrc32c(store::EncodeManifest(manifest), manifest.name));
    volume.value_range = manifest.value_range;
    volume.finite_range = manifest.finite_range;
    volume.max_gradient_magnitude = manifest.max_gradient_magnitude;
    volume.highest_level = manifest.highest_level();
    volume.level_filter = manifest.level_filter;
    return volume;
  }

  const PartFolder& folder_;
  const PartsState& state_;
  const std::vector<Pieces>& volumes_;
  const JoinOptions& options_;
  const base::Cancellation& cancellation_;
  std::int64_t total_bytes_ = 0;
  std::int64_t done_bytes_ = 0;  // of the volumes that are joined
};

bool HasBlocksOf(const store::Manifest& manifest, const Pieces& pieces) {
  std::vector<std::int64_t> bytes(pieces.records.front().shards.size());
  for (const store::PieceRecord& record : pieces.records) {
    for (std::size_t shard = 0; shard < bytes.size(); ++shard) {
      bytes[shard] += record.shards[shard].summary.block_bytes;
    }
  }
  return manifest.shards.size() == bytes.size() &&
         std::equal(
             bytes.begin(), bytes.end(), manifest.shards.begin(),
             [](std::int64_t size, const store::ShardSummary& s) { return s.block_bytes == size; });
}

// Whether the output was made of these parts: the samples of all volumes are the same, and so is
// the cut.
bool IsJoined(const PartFolder& folder, const std::vector<Pieces>& volumes) {
  for (const Pieces& pieces : volumes) {
    const store::PieceRecord& first = pieces.records.front();
    const std::string shard = absl::StrCat(
        folder.output(), "/", store::ShardDirectoryName(0, static_cast<int>(first.shards.size())));
    const std::string path =
        absl::StrCat(shard, "/", pieces.volume == kOnlyVolumeFolder ? "" : pieces.volume + "/",
                     store::kManifestFileName);
    const absl::StatusOr<std::string> bytes = io::ReadWholeFile(path, store::kMaxManifestBytes);
    const absl::StatusOr<store::Manifest> manifest =
        bytes.ok() ? store::DecodeManifest(*bytes, path) : bytes.status();
    if (!manifest.ok() || manifest->samples_digest != VolumeJoiner::DigestOf(pieces) ||
        manifest->block_cells != first.manifest.block_cells ||
        manifest->in_source != first.manifest.in_source || manifest->seed != first.manifest.seed ||
        manifest->name != first.manifest.name || manifest->highest_level() != first.highest_level ||
        !HasBlocksOf(*manifest, pieces)) {
      return false;
    }
  }
  return true;
}

}  // namespace

absl::StatusOr<JoinedDataset> JoinParts(const std::string& output, const JoinOptions& options,
                                        const base::Cancellation& cancellation) {
  const PartFolder folder(output);
  if (!folder.Exists()) {
    if (store::IsDatasetDirectory(folder.output())) {
      io::RemoveLeftLock(folder.output());
      ISOSCOPE_RETURN_IF_ERROR(folder.Remove());
      return JoinedDataset{.directory = folder.output(), .volume = std::nullopt};
    }
    return absl::NotFoundError(absl::StrCat(
        folder.parts_path(), ": no such folder, so there are no parts of ", folder.output(),
        "; cut them with `isoscope partition SOURCE --part I/N --output ",
        base::ShellWord(folder.output()), "`, I from 0 to N - 1"));
  }
  // 1
  ISOSCOPE_ASSIGN_OR_RETURN(const PartsState state, ReadPartsState(folder));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<Pieces> volumes, ReadPieces(folder, state));
  JoinedDataset joined{.directory = folder.output(), .volume = std::nullopt};
  if (!IsJoined(folder, volumes)) {
    // 2 and 3
    absl::StatusOr<JoinedDataset> made =
        DatasetJoiner(folder, state, volumes, options, cancellation).Run();
    if (made.ok()) {
      joined = *std::move(made);
    } else if (absl::IsCancelled(made.status()) || !IsJoined(folder, volumes)) {
      return made.status();
    }  // else another process was first, and may have removed the parts
  }
  // A process that was killed may have named the dataset, and done no more.
  io::RemoveLeftLock(folder.output());
  ISOSCOPE_RETURN_IF_ERROR(folder.Remove());
  return joined;
}

}  // namespace isoscope::partition
