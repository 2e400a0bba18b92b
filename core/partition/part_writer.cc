// A part of a dataset, cut by one process:
//
//   1  the plan: fields and steps as of the whole (series_plan.h), and a PartCut that says all that
//      decides the bytes
//   2  the cuts of other parts are compared with it, then it is written: parts/part-...json
//   3  for each volume that the part has not finished yet, in parts/VOLUME/part-....try-XXXXXX:
//        VolumeWriter::WriteSlab   the blocks of the slab, by shard, and their ranges
//        level_1.bin               the samples of level 1, of which --finish makes all levels
//        piece.json                last
//      then the folder loses its ".try-XXXXXX"
//
// Two processes that cut the same part write the same bytes into folders of their own. The first
// one to rename its folder has made the part; the rename of the other fails, because a folder with
// files in it is never replaced. So no lock is needed, and a reader sees whole parts only.
//
// A process that is killed leaves its try. The next one of this part removes it, if it began on
// the same machine (io::RemoveLeftovers); joining removes those of others.

#include "core/partition/part_writer.h"

#include <unistd.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"

#include "core/base/crc32c.h"
#include "core/base/monotonic_time.h"
#include "core/base/process_interrupt.h"
#include "core/base/sha256.h"
#include "core/base/status_macros.h"
#include "core/base/version.h"
#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "core/io/work_folder.h"
#include "core/partition/level_writer.h"
#include "core/partition/output_folder.h"
#include "core/partition/part_folder.h"
#include "core/partition/portion_reader.h"
#include "core/partition/series_partitioner.h"
#include "core/partition/series_plan.h"
#include "core/partition/series_writer.h"
#include "core/partition/volume_writer.h"
#include "core/store/block_codec.h"

namespace isoscope::partition {
namespace {

constexpr absl::Duration kProgressInterval = absl::Seconds(5);

std::string TextOf(const math::Index3& v) { return absl::StrFormat("%d x %d x %d", v.x, v.y, v.z); }
std::string TextOf(const math::Vec3d& v) {
  return absl::StrFormat("%.17g, %.17g, %.17g", v.x, v.y, v.z);
}

// What a dataset gets, before anything is written.
struct Plan {
  store::PartCut cut;
  std::vector<VolumeTask> tasks;
  volume::BlockLayout layout;
  PartitionOptions options;  // with the blocks and the levels in numbers
};

std::string TextOfLabels(const std::vector<volume::Label>& labels) {
  if (labels.empty()) {
    return "none";
  }
  std::string text;
  for (const volume::Label& label : labels) {
    absl::StrAppend(&text, absl::StrFormat("%a ", label.value), label.name.size(), " ", label.name,
                    " ", label.color.has_value() ? volume::ToHex(*label.color) : "-", "\n");
  }
  return absl::StrCat(labels.size(), " with the digest ", base::Sha256Hex(text).substr(0, 16));
}

std::string TextOfLevels(const LevelOptions& levels) {
  return absl::StrCat(
      levels.highest == LevelOptions::kAuto ? "auto" : absl::StrCat(levels.highest),
      levels.filter.has_value() ? absl::StrCat(" by ", volume::NameOf(*levels.filter)) : "");
}

// Agents read the source where the manifest says, so all parts name the same place.
std::string TextOfSource(const std::optional<store::SourceSamples>& in_source) {
  return !in_source.has_value() ? "not given"
                                : absl::StrCat("of ", in_source->request.at("path"),
                                               " in chunks of ", TextOf(in_source->unit_dims),
                                               " samples from ", TextOf(in_source->unit_origin));
}

void AddGrid(const volume::GridGeometry& grid, store::PartCut* cut) {
  cut->members.emplace_back("the size of the volume", TextOf(grid.sample_dims));
  cut->members.emplace_back("its spacing", TextOf(grid.spacing));
  cut->members.emplace_back("its origin", TextOf(grid.origin));
  cut->members.emplace_back("its directions", absl::StrCat(TextOf(grid.direction.columns[0]), "; ",
                                                           TextOf(grid.direction.columns[1]), "; ",
                                                           TextOf(grid.direction.columns[2])));
}

// Members for the flags come first: they say best what differs.
void AddMembers(const PartOptions& options, const volume::GridGeometry& grid, Plan* plan) {
  store::PartCut& cut = plan->cut;
  const PartitionOptions& of_volume = plan->options;
  cut.members.emplace_back("the program", std::string(base::Version()));
  cut.members.emplace_back("--shards", absl::StrCat(of_volume.shard_count));
  cut.members.emplace_back("--block-cells", TextOf(*of_volume.block_cells));
  cut.members.emplace_back("--seed", absl::StrCat(of_volume.seed));
  cut.members.emplace_back("--compression", std::string(store::NameOf(of_volume.compression)));
  cut.members.emplace_back("--levels", TextOfLevels(of_volume.levels));
  cut.members.emplace_back("--index-only", TextOfSource(of_volume.in_source));
  cut.members.insert(cut.members.end(), options.source_members.begin(),
                     options.source_members.end());
  cut.members.emplace_back("the list of labels", TextOfLabels(of_volume.labels));
  AddGrid(grid, &cut);
}

absl::StatusOr<Plan> MakePlan(source::VolumeSeries& source, const PartOptions& options,
                              const base::Cancellation& cancellation) {
  Plan plan;
  plan.options = options.volume;
  plan.options.distribution = store::Distribution::kRandom;
  plan.cut.part = options.part;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<OutputFolder> output,
      OutputFolder::Make(options.volume.output_directory, options.volume.name));
  plan.cut.name = output->name();
  ISOSCOPE_RETURN_IF_ERROR(volume::ValidateLabels(options.volume.labels));
  volume::GridGeometry grid;
  if (NeedsSeries(source)) {
    ISOSCOPE_ASSIGN_OR_RETURN(plan.cut.series, PlanSeries(source, plan.options, plan.cut.name));
    ISOSCOPE_ASSIGN_OR_RETURN(plan.tasks, PlanVolumes(source, *plan.cut.series));
    ISOSCOPE_RETURN_IF_ERROR(CheckGrids(source, plan.tasks, *plan.cut.series, cancellation));
    if (plan.options.in_source.has_value()) {
      ISOSCOPE_RETURN_IF_ERROR(
          PlanUnitsOfSeries(source, *plan.cut.series, &*plan.options.in_source));
    }
    for (const VolumeTask& task : plan.tasks) {
      plan.cut.keys.push_back(task.key);
    }
    grid = plan.cut.series->geometry;
  } else {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> volume,
                              source.Open(0, 0, 0));
    ISOSCOPE_RETURN_IF_ERROR(volume::Validate(volume->info().geometry));
    grid = volume->info().geometry;
    plan.tasks.emplace_back();
    if (plan.options.in_source.has_value()) {
      ISOSCOPE_RETURN_IF_ERROR(PlanUnits(*volume, &*plan.options.in_source));
    }
    plan.cut.members.emplace_back("the sample type",
                                  std::string(volume::NameOf(volume->info().type)));
  }
  plan.options.block_cells =
      options.volume.block_cells.value_or(volume::DefaultBlockCells(grid.sample_dims));
  ISOSCOPE_ASSIGN_OR_RETURN(plan.layout,
                            volume::BlockLayout::Make(grid.sample_dims, *plan.options.block_cells));
  ISOSCOPE_RETURN_IF_ERROR(ValidateShardCount(plan.options.shard_count, plan.layout));
  if (plan.options.in_source.has_value()) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIndexOnly(plan.options, plan.layout));
  }
  AddMembers(options, grid, &plan);
  return plan;
}

// Says in a file how far the process is, for `isoscope info`. Its errors do not matter.
class ProgressFile {
 public:
  ProgressFile(std::string path, std::function<void(const PartitionProgress&)> next)
      : path_(std::move(path)), next_(std::move(next)), host_(io::ThisMachine().host) {}

  void Report(const PartitionProgress& progress) {
    if (next_) {
      next_(progress);
    }
    const base::MonotonicTime now = base::MonotonicNow();
    if (last_.has_value() && now - *last_ < kProgressInterval) {
      return;
    }
    last_ = now;
    io::WriteFileAtomically(path_, store::EncodePartProgress(
                                       {.phase = progress.phase,
                                        .done_bytes = progress.done_bytes,
                                        .total_bytes = progress.total_bytes,
                                        .host = host_,
                                        .process_id = getpid(),
                                        .updated_unix_seconds = absl::ToUnixSeconds(absl::Now())}))
        .IgnoreError();
  }
  absl::Status Remove() const { return io::RemoveRecursively(path_); }

 private:
  const std::string path_;
  const std::function<void(const PartitionProgress&)> next_;
  const std::string host_;
  std::optional<base::MonotonicTime> last_;
};

// Copies the planes of level 1 that the slab makes into a file.
absl::Status WriteLevel1(const LevelSpool& spool, const LayerRange& planes, const std::string& path,
                         store::PieceRecord* record, const base::Cancellation& cancellation) {
  const std::unique_ptr<source::VolumeSource> samples = spool.MakeSource("level 1");
  const std::int64_t row_bytes = samples->info().row_bytes();
  const std::int64_t rows = samples->info().geometry.sample_dims.y;
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::CreateWritableFile(path));
  const std::int64_t step = std::max<std::int64_t>(base::kMiB / row_bytes, 1);
  std::string buffer;
  for (std::int64_t row = planes.begin * rows; row < planes.end * rows; row += step) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    const std::int64_t end = std::min(row + step, planes.end * rows);
    buffer.resize(static_cast<std::size_t>((end - row) * row_bytes));
    ISOSCOPE_RETURN_IF_ERROR(samples->ReadRows(row, end, buffer.data()));
    ISOSCOPE_RETURN_IF_ERROR(file->Append(buffer));
    record->level1_crc32c = base::ExtendCrc32c(record->level1_crc32c, buffer.data(), buffer.size());
  }
  record->level1_bytes = file->size_bytes();
  return file->Close();
}

// One call of PartitionPart.
class PartWriter {
 public:
  PartWriter(source::VolumeSeries* source, const PartOptions& options, const Plan& plan,
             const PartFolder& folder, const base::Cancellation& cancellation)
      : source_(*source),
        part_(options.part),
        plan_(plan),
        folder_(folder),
        cancellation_(cancellation),
        layers_(LayersOfPart(plan.layout, options.part)),
        cut_digest_(plan.cut.Digest()) {}

  absl::StatusOr<PartReport> Run() {
    PartReport report;
    const std::vector<std::string> volumes = VolumesOf(plan_.cut);
    for (std::size_t i = 0; i < volumes.size(); ++i) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      volume_number_ = i;
      ISOSCOPE_ASSIGN_OR_RETURN(const bool is_finished, IsFinished(volumes[i]));
      if (is_finished) {
        ++report.kept_volumes;
        continue;
      }
      ISOSCOPE_ASSIGN_OR_RETURN(const bool is_first, WriteVolume(plan_.tasks[i], volumes[i]));
      ++(is_first ? report.written_volumes : report.kept_volumes);
    }
    const math::Index3& dims = plan_.layout.block_dims();
    report.block_count =
        (layers_.end - layers_.begin) * dims.x * dims.y * static_cast<std::int64_t>(volumes.size());
    return report;
  }

 private:
  // Whether the part has this volume. What was made of another source, or was damaged, is removed.
  absl::StatusOr<bool> IsFinished(const std::string& volume) {
    const absl::StatusOr<std::optional<store::PieceRecord>> record =
        folder_.ReadPiece(volume, part_);
    const bool is_finished =
        record.ok() && record->has_value() && (*record)->cut_digest == cut_digest_;
    if (!is_finished) {
      if (!record.ok() && !absl::IsDataLoss(record.status())) {
        return record.status();
      }
      ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(folder_.PiecePath(volume, part_)));
    }
    return is_finished;
  }

  // True if this process has made the piece; false if another one was first.
  absl::StatusOr<bool> WriteVolume(const VolumeTask& task, const std::string& volume_name) {
    // Before the first byte is read.
    ISOSCOPE_RETURN_IF_ERROR(source_.IdentityOfStep(task.step).status());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> volume,
                              OpenTask(source_, task));
    if (plan_.cut.series.has_value()) {
      ISOSCOPE_RETURN_IF_ERROR(CheckFits(source_, task, *volume, *plan_.cut.series));
    }
    if (plan_.options.in_source.has_value()) {
      ISOSCOPE_RETURN_IF_ERROR(CheckRandomAccess(*volume));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(store::PieceRecord record, BeginRecord(task, *volume));
    const std::string parent = folder_.VolumePath(volume_name);
    const std::string prefix = store::PartName(part_) + kTryInfix;
    io::RemoveLeftovers(parent, prefix);
    std::optional<base::UnfinishedPath> unfinished;
    ISOSCOPE_ASSIGN_OR_RETURN(io::WorkFolder work, io::WorkFolder::Make(parent, prefix));
    unfinished.emplace(work.path());
    ISOSCOPE_RETURN_IF_ERROR(WriteSlab(volume.get(), work.path(), &record));
    ISOSCOPE_RETURN_IF_ERROR(source_.IdentityOfStep(task.step).status());
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(
        absl::StrCat(work.path(), "/", store::kPieceFileName), store::EncodePieceRecord(record)));
    ISOSCOPE_RETURN_IF_ERROR(io::SyncDirectory(work.path()));
    const absl::Status moved = work.MoveTo(folder_.PiecePath(volume_name, part_));
    if (moved.ok()) {
      return true;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<store::PieceRecord> other,
                              folder_.ReadPiece(volume_name, part_));
    if (other.has_value() && other->cut_digest == cut_digest_) {
      return false;
    }
    return moved;
  }

  absl::StatusOr<store::PieceRecord> BeginRecord(const VolumeTask& task,
                                                 const source::VolumeSource& volume) {
    const source::SourceInfo& info = volume.info();
    const std::vector<volume::Label>& labels = plan_.options.labels;
    ISOSCOPE_ASSIGN_OR_RETURN(
        const LevelPlan levels,
        PlanLevels(plan_.options.levels, info.geometry, info.type, plan_.layout.block_cells(),
                   plan_.options.shard_count, !labels.empty()));
    store::PieceRecord record;
    record.part = part_;
    record.cut_digest = cut_digest_;
    record.highest_level = levels.highest;
    record.level_filter = levels.filter;
    record.compression = plan_.options.compression;
    store::Manifest& manifest = record.manifest;
    manifest.dataset_id = std::string(32, '0');
    manifest.name = plan_.cut.name;
    manifest.source = !plan_.options.source_name.empty() ? plan_.options.source_name
                      : plan_.cut.series.has_value()     ? plan_.cut.series->source
                                                         : BaseName(info.name);
    manifest.geometry = info.geometry;
    manifest.patient_frame = info.patient_frame;
    if (!plan_.cut.series.has_value()) {
      manifest.labels = labels;  // those of a series are the series'
    }
    manifest.scalar_type = info.type;
    manifest.block_cells = plan_.layout.block_cells();
    manifest.distribution = store::Distribution::kRandom;
    manifest.seed = plan_.options.seed;
    manifest.shards = {{.block_count = plan_.layout.block_count()}};
    manifest.in_source = plan_.options.in_source;
    if (plan_.cut.series.has_value() && manifest.in_source.has_value()) {
      manifest.in_source = SamplesOfTask(source_, task, *manifest.in_source);
    }
    // Joining has the manifest from a file.
    const absl::StatusOr<store::Manifest> read =
        store::DecodeManifest(store::EncodeManifest(manifest), info.name);
    if (!read.ok() || *read != manifest) {
      return absl::InvalidArgumentError(absl::StrCat(
          info.name, ": can't be cut in parts: ",
          read.ok() ? "its name or those of its labels are not UTF-8" : read.status().message()));
    }
    return record;
  }

  // Writes the blocks of the slab into `work`, and says in the record what they are.
  absl::Status WriteSlab(source::VolumeSource* volume, const std::string& work,
                         store::PieceRecord* record) {
    record->shards.resize(static_cast<std::size_t>(plan_.options.shard_count));
    if (layers_.begin == layers_.end) {
      return absl::OkStatus();
    }
    const LevelPlan levels{.highest = record->highest_level, .filter = record->level_filter};
    const source::SourceInfo& info = volume->info();
    ISOSCOPE_ASSIGN_OR_RETURN(const PartitionPlan portions, PlanPortions(*volume, levels));
    ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<LevelSpool> level1,
                              CreateSpoolOfLevel1(work, info.geometry, info.type, levels));
    ProgressFile progress(absl::StrCat(work, "/", store::kPartProgressFileName),
                          plan_.options.progress);
    PartitionOptions options = plan_.options;
    options.progress = [&](PartitionProgress of_volume) {
      const auto count = static_cast<std::int64_t>(plan_.tasks.size());
      const auto before = static_cast<std::int64_t>(volume_number_) * of_volume.total_bytes;
      of_volume.done_bytes += before;
      of_volume.total_bytes *= count;
      progress.Report(of_volume);
    };
    VolumeWriter writer(volume, options, plan_.layout, portions, cancellation_);
    ISOSCOPE_ASSIGN_OR_RETURN(SlabSummary slab, writer.WriteSlab(work, layers_, level1.get()));
    record->digest_sum = slab.digest_sum;
    record->value_range = slab.value_range;
    record->finite_range = slab.finite_range;
    record->max_gradient_magnitude = slab.max_gradient_magnitude;
    record->ranges_crc32c = slab.ranges_crc32c;
    record->shards = std::move(slab.shards);
    ISOSCOPE_ASSIGN_OR_RETURN(const auto ranges, io::OpenRandomAccessFile(absl::StrCat(
                                                     work, "/", store::kRangeTableFileName)));
    record->ranges_bytes = ranges->size_bytes();
    if (level1 != nullptr) {
      ISOSCOPE_RETURN_IF_ERROR(WriteLevel1(*level1, level1->PlanesOf(plan_.layout, layers_),
                                           absl::StrCat(work, "/", store::kLevel1FileName), record,
                                           cancellation_));
    }
    return progress.Remove();
  }

  absl::StatusOr<PartitionPlan> PlanPortions(const source::VolumeSource& volume,
                                             const LevelPlan& levels) const {
    const source::SourceInfo& info = volume.info();
    std::int64_t source_bytes = plan_.options.reserved_bytes + info.memory_bytes +
                                (info.is_seekable ? 0 : PortionReader::StagingBytes(volume));
    if (levels.highest > 0) {
      source_bytes +=
          LevelSpool::MemoryBytes(volume::LevelOf(info.geometry, info.type, levels.filter, 1));
    }
    return PlanPartition(plan_.layout, info.type, plan_.options.shard_count,
                         store::Distribution::kRandom, source_bytes,
                         plan_.options.memory_limit_bytes);
  }

  source::VolumeSeries& source_;
  const store::PartNumber part_;
  const Plan& plan_;
  const PartFolder& folder_;
  const base::Cancellation& cancellation_;
  const LayerRange layers_;
  const std::string cut_digest_;
  std::size_t volume_number_ = 0;
};

}  // namespace

absl::StatusOr<PartReport> PartitionPart(source::VolumeSeries& source, const PartOptions& options,
                                         const base::Cancellation& cancellation) {
  // 1
  ISOSCOPE_ASSIGN_OR_RETURN(const Plan plan, MakePlan(source, options, cancellation));
  const PartFolder folder(options.volume.output_directory);
  // 2
  ISOSCOPE_RETURN_IF_ERROR(folder.Make(VolumesOf(plan.cut)));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<store::PartCut> cuts, folder.ReadCuts());
  for (const store::PartCut& cut : cuts) {
    ISOSCOPE_RETURN_IF_ERROR(CheckSameCut(cut, plan.cut, folder));
  }
  ISOSCOPE_RETURN_IF_ERROR(folder.WriteCut(plan.cut));
  // 3
  return PartWriter(&source, options, plan, folder, cancellation).Run();
}

}  // namespace isoscope::partition
