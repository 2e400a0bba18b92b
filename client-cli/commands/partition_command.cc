// isoscope partition INPUT --output DIR [--part I/N] | --finish DIR | --append DIR | --add-levels DIR |
//                    --drop-levels DIR
//
// 1. CheckUsage refuses flags that contradict each other. With --append the series has fixed its
//    shards, blocks, distribution, seed, levels and label names, so these flags are refused.
//    --add-levels and --drop-levels take no input: they change a dataset that exists, and end here.
// 2. OpenIdentified opens the source and notes the stamps of its files (core/formats).
// 3. A source of one field, component and step, without a time, becomes a plain dataset
//    (PartitionVolume). Any other source becomes a series, and so does an appended one
//    (PartitionSeries).
//    With --part this process cuts its part of either (PartitionPart); --finish joins the parts.
// 4. Summarize prints samples, blocks or volumes, shards, and the elapsed time.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/string_view.h"

#include "client-cli/commands/program.h"
#include "client-cli/session/level_flags.h"
#include "client-cli/session/partition_volume.h"
#include "client-cli/session/series_flags.h"
#include "client-cli/session/source_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/monotonic_time.h"
#include "core/base/printable.h"
#include "core/base/shell_word.h"
#include "core/base/status_macros.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"
#include "core/formats/address_opening.h"
#include "core/formats/format_table.h"
#include "core/formats/open_request.h"
#include "core/formats/source_members.h"
#include "core/indexed/source_request.h"
#include "core/math/vec.h"
#include "core/partition/dataset_levels.h"
#include "core/partition/part_joiner.h"
#include "core/partition/part_writer.h"
#include "core/partition/partitioner.h"
#include "core/partition/series_partitioner.h"
#include "core/source/volume_series.h"
#include "core/store/block_codec.h"
#include "core/store/manifest.h"
#include "core/store/part_file.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/volume/scalar_type.h"

namespace isoscope::cli {
namespace {

struct PartitionFlags {
  bool is_quiet = false;
  std::optional<std::string> input;
  std::optional<std::string> output;
  std::optional<std::string> append;
  std::optional<store::PartNumber> part;
  std::optional<std::string> finish;
  std::optional<std::string> add_levels;
  std::optional<std::string> drop_levels;
  bool resumes = false;
  std::optional<std::int64_t> shard_count;
  std::optional<math::Index3> block_cells;
  std::optional<store::Distribution> distribution;
  std::optional<store::BlockEncoding> compression;
  bool is_compact = false;
  bool is_index_only = false;
  std::optional<std::uint64_t> seed;
  std::optional<std::int64_t> memory_limit_bytes;
  LevelFlags levels;
  SeriesFlags series;
  SourceFlags source;

  // The first flag of those that a series has for ever, or null.
  [[nodiscard]] const char* FirstOfCut() const {
    return output         ? "--output"
           : shard_count  ? "--shards"
           : block_cells  ? "--block-cells"
           : distribution ? "--distribution"
           : seed         ? "--seed"
           : part         ? "--part"
                          : nullptr;
  }
  // The first flag of those that levels have of their own, or null.
  [[nodiscard]] const char* FirstOfLevels() const {
    return compression ? "--compression" : is_compact ? "--compact" : levels.FirstGiven();
  }
  [[nodiscard]] store::BlockEncoding encoding() const {
    return is_compact ? store::BlockEncoding::kPacked
                      : compression.value_or(store::BlockEncoding::kRaw);
  }
  // The first flag of those that need an input, or null.
  [[nodiscard]] const char* FirstOfInput() const {
    return append                   ? "--append"
           : resumes                ? "--resume"
           : FirstOfCut()           ? FirstOfCut()
           : !series.fields.empty() ? "--field"
           : series.steps           ? "--step"
           : series.time            ? "--time"
                                    : source.FirstGiven();
  }
};

// Measured: docs/partitioning.md, "Smaller datasets".
constexpr char kCompactHelp[] =
    "blocks of few bits a sample: large volumes take 0.2 to 0.8 times the bytes of their samples, "
    "in place of 1.7; a first frame takes 5 to 12 % longer";

constexpr char kIndexOnlyHelp[] =
    "leave the samples in INPUT, which must stay where it is and as it is: tables and levels take "
    "a quarter of the disk, first frames longer; for Zarr, HDF5, VTI, and files without "
    "compression";

absl::Status GreedySeriesError() {
  return UsageError(
      "--distribution greedy deals out blocks by the values of one volume; a series, with fields "
      "or time steps, has its blocks in the same shard in every volume: --distribution random");
}

// "I/N": part I, from 0 on, of N.
absl::StatusOr<store::PartNumber> ParsePart(absl::string_view text) {
  const std::pair<absl::string_view, absl::string_view> halves =
      absl::StrSplit(text, absl::MaxSplits('/', 1));
  const absl::StatusOr<std::int64_t> count =
      client::ParseInteger(halves.second, 1, store::kMaxPartCount);
  const absl::StatusOr<std::int64_t> index =
      count.ok() ? client::ParseInteger(halves.first, 0, *count - 1) : count.status();
  if (!index.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat("'", text, "' is no part I/N: N parts are 1 to ", store::kMaxPartCount,
                     count.ok() ? absl::StrCat(", and I is from 0 to ", *count - 1, " of ", *count)
                                : ", and I is from 0 to N - 1, as in 0/16"));
  }
  return store::PartNumber{.index = static_cast<int>(*index), .count = static_cast<int>(*count)};
}

// --part
absl::Status CheckPartUsage(const PartitionFlags& flags) {
  if (flags.append) {
    return UsageError(
        "--part can't be used with --append DIR; parts make new datasets: append with one process");
  }
  if (flags.resumes) {
    return UsageError(
        "--resume can't be used with --part; a part that is run again always keeps what it has "
        "finished");
  }
  if (flags.distribution == store::Distribution::kGreedy) {
    return UsageError(
        "--distribution greedy deals out blocks by the values of the whole volume, which no part "
        "sees: --distribution random");
  }
  return absl::OkStatus();
}

// --finish
absl::Status CheckFinishUsage(const PartitionFlags& flags) {
  if (flags.add_levels || flags.drop_levels) {
    return UsageError("--finish DIR can't be used with --add-levels or --drop-levels");
  }
  if (flags.input) {
    return UsageError("INPUT can't be used with --finish DIR: the parts have all samples");
  }
  if (const char* given = flags.FirstOfInput(); given != nullptr) {
    return UsageError(absl::StrCat(
        given, " can't be used with --finish DIR; the parts were cut with their flags"));
  }
  if (const char* given = flags.FirstOfLevels(); given != nullptr) {
    return UsageError(
        absl::StrCat(given, " can't be used with --finish DIR; it is given to all parts"));
  }
  return absl::OkStatus();
}

// --add-levels and --drop-levels.
absl::Status CheckLevelUsage(const PartitionFlags& flags) {
  const char* const action = flags.add_levels ? "--add-levels DIR" : "--drop-levels DIR";
  if (flags.add_levels && flags.drop_levels) {
    return UsageError("--add-levels and --drop-levels exclude each other; drop first, then add");
  }
  if (flags.input) {
    return UsageError(absl::StrCat("INPUT can't be used with ", action,
                                   ": levels are made of the samples of the dataset"));
  }
  if (const char* given = flags.FirstOfInput(); given != nullptr) {
    return UsageError(absl::StrCat(given, " can't be used with ", action,
                                   "; the dataset stays as it is otherwise"));
  }
  if (flags.add_levels && flags.levels.highest == 0) {
    return UsageError(
        "--levels none can't be used with --add-levels DIR; --drop-levels removes levels");
  }
  if (const char* given = flags.FirstOfLevels(); flags.drop_levels && given != nullptr) {
    return UsageError(
        absl::StrCat(given, " can't be used with --drop-levels DIR, which drops all levels"));
  }
  return absl::OkStatus();
}

// --index-only
absl::Status CheckIndexOnlyUsage(const PartitionFlags& flags) {
  const char* const given = flags.append        ? "--append"
                            : flags.resumes     ? "--resume"
                            : flags.finish      ? "--finish"
                            : flags.add_levels  ? "--add-levels"
                            : flags.drop_levels ? "--drop-levels"
                            : flags.compression ? "--compression"
                            : flags.is_compact  ? "--compact"
                            : flags.distribution == store::Distribution::kGreedy
                                ? "--distribution greedy"
                                : nullptr;
  return given == nullptr ? absl::OkStatus()
                          : UsageError(absl::StrCat(
                                given,
                                " can't be used with --index-only, which makes a new dataset, "
                                "deals out the chunks of INPUT at random and stores no blocks of "
                                "it"));
}

absl::Status CheckUsage(const PartitionFlags& flags) {
  if (flags.is_compact && flags.compression && *flags.compression != flags.encoding()) {
    return UsageError(absl::StrCat("--compact can't be used with --compression ",
                                   store::NameOf(*flags.compression), ": it is --compression ",
                                   store::NameOf(flags.encoding())));
  }
  if (flags.is_index_only) {
    ISOSCOPE_RETURN_IF_ERROR(CheckIndexOnlyUsage(flags));
  }
  if (flags.finish) {
    return CheckFinishUsage(flags);
  }
  if (flags.part) {
    ISOSCOPE_RETURN_IF_ERROR(CheckPartUsage(flags));
  }
  if (flags.add_levels || flags.drop_levels) {
    return CheckLevelUsage(flags);
  }
  if (!flags.input) {
    return UsageError("INPUT is missing: the volume to partition");
  }
  if (flags.append) {
    if (const char* given = flags.FirstOfCut(); given != nullptr) {
      return UsageError(absl::StrCat(given,
                                     " can't be used with --append DIR; what is appended is "
                                     "cut as the series"));
    }
    if (const char* given = flags.levels.FirstGiven(); given != nullptr) {
      return UsageError(absl::StrCat(
          given,
          " can't be used with --append DIR; what is appended gets the levels of the series"));
    }
    if (flags.source.label_names) {
      return UsageError(
          "--label-names can't be used with --append DIR; the series keeps the names it has");
    }
  } else if (!flags.output) {
    return UsageError("--output DIR is missing: the dataset folder to make");
  }
  if (flags.series.time && flags.distribution == store::Distribution::kGreedy) {
    return GreedySeriesError();
  }
  return CheckUsage(flags.source, *flags.input);
}

std::string Summarize(const store::Manifest& manifest, const std::string& directory,
                      absl::Duration elapsed) {
  std::int64_t block_count = 0;
  std::int64_t block_bytes = 0;
  for (const store::ShardSummary& shard : manifest.shards) {
    block_count += shard.block_count;
    block_bytes += shard.block_bytes;
  }
  const math::Index3& dims = manifest.geometry.sample_dims;
  const std::int64_t source_bytes =
      math::Volume(dims) * static_cast<std::int64_t>(volume::SizeOf(manifest.scalar_type));
  return absl::StrCat(
      manifest.source, ": ", dims.x, " x ", dims.y, " x ", dims.z, " samples of ",
      volume::NameOf(manifest.scalar_type), ", ", FormatMebibytes(source_bytes), "\n", directory,
      ": ", FormatCount(block_count), " blocks in ", manifest.shards.size(),
      manifest.shards.size() == 1 ? " shard, " : " shards, ",
      manifest.in_source.has_value() ? "samples stay in the source" : FormatMebibytes(block_bytes),
      ", values ", manifest.value_range.min, " to ", manifest.value_range.max,
      manifest.highest_level() > 0 ? absl::StrCat(", levels 1 to ", manifest.highest_level()) : "",
      ", in ", FormatElapsed(elapsed), "\n");
}

// "5 fields, 50 steps from 0 to 4.9 s".
std::string FieldsAndSteps(const store::SeriesManifest& series) {
  const std::size_t fields = series.fields.size();
  std::string text =
      absl::StrCat(fields, fields == 1 ? " field, " : " fields, ", series.step_count(),
                   series.step_count() == 1 ? " step" : " steps");
  if (!series.times.empty()) {
    absl::StrAppend(
        &text,
        series.times.size() == 1 ? " at " : absl::StrCat(" from ", series.times.front(), " to "),
        series.times.back(), series.time_unit.empty() ? "" : " ", series.time_unit);
  }
  return text;
}

std::string Summarize(const store::SeriesManifest& series, const PartitionFlags& flags,
                      const std::string& directory, absl::Duration elapsed) {
  const math::Index3& dims = series.geometry.sample_dims;
  return absl::StrCat(
      base::Printable(*flags.input), flags.append ? " was appended" : "", ": ", dims.x, " x ",
      dims.y, " x ", dims.z, " samples\n", directory, ": ", base::Printable(FieldsAndSteps(series)),
      ", ", FormatCount(static_cast<std::int64_t>(series.volumes.size())),
      series.volumes.size() == 1 ? " volume in " : " volumes in ", series.shard_count,
      series.shard_count == 1 ? " shard" : " shards",
      series.highest_level() > 0 ? absl::StrCat(", levels 1 to ", series.highest_level()) : "",
      ", in ", FormatElapsed(elapsed), "\n");
}

partition::PartitionOptions OptionsOf(const PartitionFlags& flags) {
  partition::PartitionOptions options;
  options.output_directory = flags.append ? *flags.append : *flags.output;
  while (options.output_directory.size() > 1 && options.output_directory.back() == '/') {
    options.output_directory.pop_back();
  }
  options.shard_count = static_cast<int>(flags.shard_count.value_or(options.shard_count));
  options.block_cells = flags.block_cells;
  options.distribution = flags.distribution.value_or(options.distribution);
  options.compression = flags.encoding();
  options.seed = flags.seed.value_or(options.seed);
  options.memory_limit_bytes = flags.memory_limit_bytes.value_or(options.memory_limit_bytes);
  options.levels = LevelOptionsOf(flags.levels);
  return options;
}

// --part
absl::Status CutPart(const PartitionFlags& flags, const source::OpenRequest& request,
                     source::VolumeSeries& source, partition::PartitionOptions options,
                     const Context& context) {
  const base::MonotonicTime start = base::MonotonicNow();
  const store::PartNumber part = *flags.part;
  partition::PartOptions part_options{
      .volume = std::move(options), .part = part, .source_members{}};
  ISOSCOPE_ASSIGN_OR_RETURN(part_options.source_members, source::SourceMembers(request));
  const std::string output = part_options.volume.output_directory;
  ISOSCOPE_ASSIGN_OR_RETURN(const partition::PartReport report,
                            PartitionPart(source, std::move(part_options), context));
  *context.out << base::Printable(output) << ": part " << part.index << " of " << part.count
               << (report.written_volumes == 0 ? " was finished before"
                   : report.block_count == 0
                       ? " has no blocks: there are more parts than slabs of blocks"
                       : absl::StrCat(": ", FormatCount(report.block_count), " blocks in ",
                                      FormatElapsed(base::MonotonicNow() - start)))
               << "; once all are: isoscope partition --finish " << base::ShellWord(output) << "\n";
  return absl::OkStatus();
}

// --finish
absl::Status FinishParts(const PartitionFlags& flags, const Context& context) {
  const base::MonotonicTime start = base::MonotonicNow();
  partition::JoinOptions options;
  options.memory_limit_bytes = flags.memory_limit_bytes.value_or(options.memory_limit_bytes);
  ISOSCOPE_ASSIGN_OR_RETURN(const partition::JoinedDataset joined,
                            JoinParts(*flags.finish, options, context));
  const absl::Duration elapsed = base::MonotonicNow() - start;
  if (joined.volume) {
    *context.out << Summarize(*joined.volume, joined.directory, elapsed);
  } else if (joined.series) {
    *context.out << base::Printable(joined.directory) << ": "
                 << base::Printable(FieldsAndSteps(*joined.series)) << ", in "
                 << FormatElapsed(elapsed) << "\n";
  } else {
    *context.out << base::Printable(joined.directory) << ": was finished before\n";
  }
  return absl::OkStatus();
}

// What agents do that serve a dataset meanwhile: those of a series read its manifest again.
std::string WordOnAgents(const std::string& directory, bool are_added) {
  if (store::IsSeriesDirectory(directory)) {
    return are_added ? "; agents that serve it find them by themselves" : "";
  }
  return are_added ? "; agents that serve it show them after a restart"
                   : "; agents that serve it show those that it had until a restart";
}

// --add-levels and --drop-levels.
absl::Status ChangeLevels(const PartitionFlags& flags, const Context& context) {
  const base::MonotonicTime start = base::MonotonicNow();
  if (flags.drop_levels) {
    ISOSCOPE_RETURN_IF_ERROR(
        partition::DropLevels(*flags.drop_levels, context.interrupt->cancellation()));
    *context.out << base::Printable(*flags.drop_levels) << ": has no levels"
                 << WordOnAgents(*flags.drop_levels, /*are_added=*/false) << "\n";
    return absl::OkStatus();
  }
  partition::AddLevelsOptions options;
  options.levels = LevelOptionsOf(flags.levels);
  options.compression = flags.encoding();
  options.memory_limit_bytes = flags.memory_limit_bytes.value_or(options.memory_limit_bytes);
  ISOSCOPE_ASSIGN_OR_RETURN(const int highest, AddLevels(*flags.add_levels, options, context));
  *context.out << base::Printable(*flags.add_levels) << ": "
               << (highest > 0 ? absl::StrCat("has levels 1 to ", highest)
                               : "has no levels: it is too small for --levels auto")
               << ", in " << FormatElapsed(base::MonotonicNow() - start)
               << (highest > 0 ? WordOnAgents(*flags.add_levels, /*are_added=*/true) : "") << "\n";
  return absl::OkStatus();
}

absl::Status Run(const PartitionFlags& flags, const Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  if (flags.finish) {
    return FinishParts(flags, context);
  }
  if (flags.add_levels || flags.drop_levels) {
    return ChangeLevels(flags, context);
  }
  partition::PartitionOptions options = OptionsOf(flags);
  const base::MonotonicTime start = base::MonotonicNow();
  if (flags.append) {
    WarnIfIncomplete(options.output_directory, context);
  }
  const source::OpenRequest request = RequestOf(flags.source, flags.series, *flags.input);
  std::optional<source::AddressOpening> opening(std::in_place);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSeries> source,
                            source::OpenIdentified(request));
  if (!flags.append) {
    ISOSCOPE_ASSIGN_OR_RETURN(options.labels, LabelsOfSource(request, context.err));
  }
  opening.reset();
  if (flags.is_index_only) {
    ISOSCOPE_ASSIGN_OR_RETURN(options.in_source.emplace().request,
                              indexed::EncodeSourceRequest(request));
  }
  if (flags.part) {
    return CutPart(flags, request, *source, options, context);
  }
  if (!flags.append && !partition::NeedsSeries(*source)) {
    ISOSCOPE_ASSIGN_OR_RETURN(const store::Manifest manifest,
                              PartitionVolume(*source, options, context));
    *context.out << Summarize(manifest, options.output_directory, base::MonotonicNow() - start);
    return absl::OkStatus();
  }
  if (options.distribution == store::Distribution::kGreedy) {
    return GreedySeriesError();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      const store::SeriesManifest series,
      PartitionSeries(flags.append ? SeriesAction::kAppend : SeriesAction::kMake, *source,
                      {.volume = options, .resumes = flags.resumes}, context));
  *context.out << Summarize(series, flags, options.output_directory, base::MonotonicNow() - start);
  return absl::OkStatus();
}

Action RegisterPartitionFlags(FlagSet* set) {
  const auto flags = std::make_shared<PartitionFlags>();
  AddFlag(
      set, "input", "INPUT", &flags->input, ParseSource,
      absl::StrCat(
          "a NIfTI, NRRD or MetaImage file (NRRD and MetaImage: with samples in one file or "
          "several), file.vti[:array[:component]], file.h5:/dataset, 'pattern*.h5' of openPMD, ",
          source::ListedFormats(),
          ", a folder or a file of a DICOM series, a folder or 'pattern*.tif' of slices, or a "
          "raw file"));
  AddFlag(set, "-o,--output", "DIR", &flags->output, ParseText,
          "the dataset folder; must not exist yet");
  AddFlag(set, "--part", "I/N", &flags->part, ParsePart,
          "cut part I, from 0 to N - 1, of N alone, into DIR.partial; other processes cut the "
          "others, at any time, on any machine that sees this folder");
  AddFlag(set, "--finish", "DIR", &flags->finish, ParseText,
          "join all parts into the dataset folder that one process would have made; no INPUT");
  AddFlag(set, "--append", "DIR", &flags->append, ParseText,
          "a dataset folder with time steps, to which those of INPUT are appended");
  AddFlag(set, "--add-levels", "DIR", &flags->add_levels, ParseText,
          "a dataset folder, to which levels are added: see --levels; no INPUT");
  AddFlag(set, "--drop-levels", "DIR", &flags->drop_levels, ParseText,
          "a dataset folder, from which all levels are removed; no INPUT");
  set->AddSwitch("--resume", &flags->resumes,
                 "go on with what an interrupted run has finished of several fields or steps");
  AddFlag(set, "--shards", "P", &flags->shard_count, ParseShardCount,
          "shards to make, one for each agent (default: 1)");
  AddFlag(
      set, "--block-cells", "N|NXxNYxNZ", &flags->block_cells, client::ParseBlockCells,
      "cells of a block (default: 16 from about 512 x 512 x 512 samples on, 12 from 384 x 384 x "
      "384 on, 8 below)");
  AddFlag(set, "--distribution", "random|greedy", &flags->distribution, store::DistributionFromName,
          "how blocks are dealt out (default: random)");
  set->AddSwitch("--index-only", &flags->is_index_only, kIndexOnlyHelp);
  set->AddSwitch("--compact", &flags->is_compact, kCompactHelp);
  AddFlag(
      set, "--compression", "none|lz4|zstd|packed", &flags->compression, store::ParseBlockEncoding,
      "how blocks are stored: smaller, but slower to draw; packed is --compact (default: none)");
  AddFlag(set, "--seed", "S", &flags->seed, client::ParseUnsigned,
          "seed of the random distribution (default: 1)")
      .Group("Blocks and shards");
  AddLevelFlags(set, &flags->levels);
  AddFlag(set, "--memory-limit", "BYTES", &flags->memory_limit_bytes, client::ParseByteSize,
          "memory of the process at most, as in 128MiB or 2G (default: 1GiB)");
  AddSeriesFlags(set, &flags->series);
  AddSourceFlags(set, &flags->source);
  AddQuietFlag(set, &flags->is_quiet);
  return [flags](const Context& context) {
    return Run(*flags, flags->is_quiet ? QuietContext(context) : context);
  };
}

}  // namespace

Command PartitionCommand() {
  return {.name = "partition",
          .summary = "Cuts a volume into a dataset folder of one or more shards",
          .usage =
              "INPUT --output DIR [--part I/N] | INPUT --append DIR | --finish DIR | --add-levels "
              "DIR [OPTIONS]",
          .examples =
              "  isoscope partition head.nii.gz --output head --shards 4\n"
              "  isoscope partition ct.raw --dims 512,512,234 --type uint8 --output ct\n"
              "  isoscope partition run.h5:/fields/density --memory-limit 128MiB --output run\n"
              "  isoscope partition flow.pvd --shards 4 --output flow\n"
              "  isoscope partition p_0042.raw --dims 64,64,64 --type float32 --field p \\\n"
              "    --time 4.2 --append flow\n"
              "  isoscope partition --add-levels run --memory-limit 256MiB\n"
              "  isoscope partition big.raw --dims 4096,4096,4096 --type uint16 --part 3/16 \\\n"
              "    --shards 8 --output big          (and so for 0 to 15, on any machines)\n"
              "  isoscope partition --finish big\n"
              "  isoscope partition run.zarr --index-only --shards 4 --output run\n",
          .register_flags = RegisterPartitionFlags};
}

}  // namespace isoscope::cli
