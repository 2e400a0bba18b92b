// isoscope-bench frame INPUT | DIR --isovalue V...
//
// Flags become a FrameBenchPlan. A volume is partitioned once for each number of shards, into a
// temporary folder. A dataset folder is used as it is, and then flags for partitioning are wrong
// usage. The peer gets the samples as a raw file, and only those camera flags that differ from the
// default.

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "bench/frame_bench.h"
#include "bench/frame_bench_report.h"
#include "bench/measurement.h"
#include "bench/peer.h"
#include "bench/program.h"
#include "client-cli/session/level_flags.h"
#include "client-cli/session/partition_volume.h"
#include "client-cli/session/source_flags.h"
#include "clients/cpp/request/level_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "core/base/status_macros.h"
#include "core/cli/command.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"
#include "core/formats/open_request.h"
#include "core/io/file.h"
#include "core/io/temporary_folder.h"
#include "core/render/renderer_factory.h"
#include "core/source/volume_series.h"
#include "core/store/shard_reader.h"

namespace isoscope::bench {
namespace {

constexpr std::int64_t kMaxCount = 1000;

struct FrameBenchFlags {
  std::optional<std::string> input;
  std::vector<double> isovalues;
  std::vector<std::int64_t> shard_counts;
  std::vector<std::string> cullings;
  std::vector<std::string> renderers;
  std::optional<std::int64_t> run_count;
  std::optional<std::int64_t> frame_count;
  std::optional<double> orbit_degrees;
  std::optional<double> azimuth_degrees;
  std::optional<double> elevation_degrees;
  std::optional<std::int64_t> width;
  std::optional<std::int64_t> height;
  std::optional<std::int64_t> thread_count;
  client::LevelFlags level;
  cli::LevelFlags levels;  // that a volume gets
  std::optional<math::Index3> block_cells;
  std::optional<std::string> peer;
  std::optional<std::string> json;
  cli::SourceFlags source;

  [[nodiscard]] std::int64_t width_px() const {
    return width.value_or(view::kCommonViewport.width_px);
  }
  [[nodiscard]] std::int64_t height_px() const {
    return height.value_or(view::kCommonViewport.height_px);
  }
};

// Returns the name itself: it is passed to the rendering process.
absl::StatusOr<std::string> ParseCullingName(absl::string_view text) {
  return client::ParseChoice<std::string>(text,
                                          {{"depth", "depth"}, {"mask", "mask"}, {"none", "none"}});
}

absl::StatusOr<std::string> ParseRendererName(absl::string_view text) {
  ISOSCOPE_RETURN_IF_ERROR(render::RendererKindFromName(text).status());
  return std::string(text);
}

absl::Status CheckUsage(const FrameBenchFlags& flags) {
  if (!flags.input) {
    return cli::UsageError("give a volume file or a dataset folder");
  }
  if (flags.isovalues.empty()) {
    return cli::UsageError("--isovalue V is missing: one or more isovalues, in field units");
  }
  if (flags.peer && flags.width_px() != flags.height_px()) {
    return cli::UsageError(absl::StrCat("--peer draws squares: --width ", flags.width_px(),
                                        " and --height ", flags.height_px(), " must be equal"));
  }
  if (flags.peer && (flags.level.level || flags.level.max_spacing_px)) {
    return cli::UsageError("--peer draws the samples: leave --level and --max-spacing out");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.level));
  return CheckUsage(flags.source, *flags.input);
}

// UsageError for flags that do not apply to a dataset folder: it is partitioned already, and has no
// samples for a peer.
absl::Status CheckFolderUsage(const FrameBenchFlags& flags) {
  const char* given = !flags.shard_counts.empty()            ? "--shards"
                      : flags.block_cells                    ? "--block-cells"
                      : flags.peer                           ? "--peer"
                      : flags.levels.FirstGiven() != nullptr ? flags.levels.FirstGiven()
                                                             : flags.source.FirstGiven();
  if (given != nullptr) {
    return cli::UsageError(absl::StrCat(given, " is for volume files; '", *flags.input,
                                        "' is a folder: give the volume it was made from"));
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<BenchDataset>> UseFolder(const FrameBenchFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckFolderUsage(flags));
  ISOSCOPE_ASSIGN_OR_RETURN(const store::DatasetDescription dataset,
                            store::OpenDataset(*flags.input));
  return std::vector<BenchDataset>{
      {.shard_count = static_cast<int>(dataset.manifest.shards.size()), .directory = *flags.input}};
}

absl::StatusOr<std::vector<BenchDataset>> PartitionEach(const FrameBenchFlags& flags,
                                                        const io::TemporaryFolder& folder,
                                                        const cli::Context& context) {
  std::vector<std::int64_t> shard_counts = flags.shard_counts;
  if (shard_counts.empty()) {
    shard_counts = {1};
  }
  std::vector<BenchDataset> datasets;
  std::sort(shard_counts.begin(), shard_counts.end());
  shard_counts.erase(std::unique(shard_counts.begin(), shard_counts.end()), shard_counts.end());
  for (const std::int64_t shard_count : shard_counts) {
    partition::PartitionOptions options;
    options.output_directory = folder.Sub(absl::StrCat("shards-", shard_count));
    options.shard_count = static_cast<int>(shard_count);
    options.block_cells = flags.block_cells;
    options.levels = cli::LevelOptionsOf(flags.levels);
    ISOSCOPE_RETURN_IF_ERROR(
        cli::PartitionVolume(cli::RequestOf(flags.source, *flags.input), options, context)
            .status());
    datasets.push_back({.shard_count = options.shard_count, .directory = options.output_directory});
  }
  return datasets;
}

absl::StatusOr<PeerCall> PreparePeer(const FrameBenchFlags& flags, const FrameBenchPlan& plan,
                                     const io::TemporaryFolder& folder,
                                     const cli::Context& context) {
  if (!io::PathExists(*flags.peer)) {
    return absl::NotFoundError(
        absl::StrCat("'", *flags.peer, "' does not exist; --peer takes a Python script"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSeries> series,
                            source::Open(cli::RequestOf(flags.source, *flags.input)));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<source::VolumeSource> source,
                            series->Open(0, 0, 0));
  PeerCall call{.script = *flags.peer,
                .raw_path = folder.Sub("volume.raw"),
                .dims = source->info().geometry.sample_dims,
                .type = std::string(volume::NameOf(source->info().type)),
                .spacing = source->info().geometry.spacing,
                .frame_count = plan.frame_count,
                .orbit_degrees = plan.orbit_degrees,
                .side_px = plan.width_px};
  if (plan.azimuth_degrees != kDefaultAzimuth) {
    call.more.insert(call.more.end(),
                     {"--azimuth", absl::StrFormat("%.17g", plan.azimuth_degrees)});
  }
  if (plan.elevation_degrees != kDefaultElevation) {
    call.more.insert(call.more.end(),
                     {"--elevation", absl::StrFormat("%.17g", plan.elevation_degrees)});
  }
  ISOSCOPE_RETURN_IF_ERROR(WriteRawSamples(*source, call.raw_path, context));
  return call;
}

// Returns the path of `isoscope`, the measured program, from the folder of this program.
absl::StatusOr<std::string> RenderingProgram() {
  std::error_code error;
  const std::filesystem::path own = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) {
    return absl::NotFoundError(absl::StrCat("/proc/self/exe: ", error.message()));
  }
  std::string path = (own.parent_path() / "isoscope").string();
  if (!std::filesystem::exists(path, error)) {
    return absl::NotFoundError(absl::StrCat("isoscope-bench times the program ", path,
                                            ", which is not there; install both in one folder"));
  }
  return path;
}

FrameBenchPlan PlanOf(const FrameBenchFlags& flags) {
  FrameBenchPlan plan;
  plan.isovalues = flags.isovalues;
  plan.cullings = flags.cullings.empty() ? std::vector<std::string>{"depth"} : flags.cullings;
  plan.renderers = flags.renderers.empty() ? std::vector<std::string>{"auto"} : flags.renderers;
  plan.run_count = static_cast<int>(flags.run_count.value_or(plan.run_count));
  plan.frame_count = static_cast<int>(flags.frame_count.value_or(plan.frame_count));
  plan.orbit_degrees = flags.orbit_degrees.value_or(plan.orbit_degrees);
  plan.azimuth_degrees = flags.azimuth_degrees.value_or(kDefaultAzimuth);
  plan.elevation_degrees = flags.elevation_degrees.value_or(kDefaultElevation);
  plan.width_px = flags.width_px();
  plan.height_px = flags.height_px();
  plan.thread_count = flags.thread_count;
  plan.level = flags.level.level;
  plan.max_spacing_px = flags.level.max_spacing_px;
  return plan;
}

absl::Status Run(const FrameBenchFlags& flags, const cli::Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  const bool is_dataset = store::IsDatasetDirectory(*flags.input);
  if (!is_dataset) {
    ISOSCOPE_RETURN_IF_ERROR(cli::SourceFiles(cli::RequestOf(flags.source, *flags.input)).status());
  }
  const std::string volume = std::filesystem::path(*flags.input).filename().string();
  return RunMeasurement(
      flags.json, volume, context, [&](const Occasion& occasion) -> absl::StatusOr<Report> {
        FrameBenchPlan plan = PlanOf(flags);
        ISOSCOPE_ASSIGN_OR_RETURN(plan.program, RenderingProgram());
        ISOSCOPE_ASSIGN_OR_RETURN(const io::TemporaryFolder folder, io::TemporaryFolder::Make());
        ISOSCOPE_ASSIGN_OR_RETURN(
            plan.datasets, is_dataset ? UseFolder(flags) : PartitionEach(flags, folder, context));
        if (flags.peer) {
          ISOSCOPE_ASSIGN_OR_RETURN(plan.peer, PreparePeer(flags, plan, folder, context));
        }
        ISOSCOPE_ASSIGN_OR_RETURN(const FrameBenchResult result, RunFrameBench(plan, context));
        return Report{
            .json = FrameBenchJson(occasion, plan, result),
            .text = absl::StrCat(plan.width_px, " x ", plan.height_px, " pixels; medians of ",
                                 plan.run_count, plan.run_count == 1 ? " run" : " runs",
                                 ", each a fresh process of ", plan.frame_count, " frames ",
                                 plan.orbit_degrees, " degrees apart\n\n",
                                 DescribeFrameBench(volume, result))};
      });
}

cli::Action RegisterFrameBenchFlags(cli::FlagSet* set) {
  const auto flags = std::make_shared<FrameBenchFlags>();
  const auto parse_side = [](absl::string_view text) {
    return client::ParseInteger(text, 1, view::kMaxViewportPx);
  };
  cli::AddFlag(set, "input", "INPUT|DIR", &flags->input, cli::ParseSource,
               "a volume, as 'partition' takes it (cut into a temporary folder for each P), or a "
               "dataset folder");
  cli::AddListFlag(set, "--isovalue", "V", &flags->isovalues, client::ParseNumber,
                   "one or more isovalues, in field units");
  cli::AddListFlag(set, "--shards", "P", &flags->shard_counts, cli::ParseShardCount,
                   "numbers of shards, one agent each (default: 1; of a folder its own)");
  cli::AddListFlag(set, "--culling", "depth|mask|none", &flags->cullings, ParseCullingName,
                   "one or more ways of culling (default: depth)");
  cli::AddListFlag(set, "--renderer", "auto|egl|cpu", &flags->renderers, ParseRendererName,
                   "one or more back ends (default: auto)");
  cli::AddFlag(
      set, "--runs", "N", &flags->run_count,
      [](absl::string_view text) { return client::ParseInteger(text, 1, kMaxCount); },
      "fresh processes for each row; medians are printed (default: 3)");
  cli::AddFlag(
      set, "--frames", "N", &flags->frame_count,
      [](absl::string_view text) { return client::ParseInteger(text, 2, kMaxCount); },
      "frames of a run: the first is the cold one, 2 or more (default: 6)");
  cli::AddFlag(set, "--orbit", "DEG", &flags->orbit_degrees, client::ParseNumber,
               "turn the camera about up after each frame (default: 7)");
  cli::AddFlag(set, "--azimuth", "DEG", &flags->azimuth_degrees, client::ParseNumber,
               "turn the default camera about up before the first frame (default: 30)");
  cli::AddFlag(set, "--elevation", "DEG", &flags->elevation_degrees, client::ParseNumber,
               "then about its right axis (default: 20)");
  cli::AddFlag(set, "--width", "W", &flags->width, parse_side, "pixels (default: 1024)");
  cli::AddFlag(set, "--height", "H", &flags->height, parse_side, "pixels (default: 1024)");
  cli::AddFlag(
      set, "--threads", "T", &flags->thread_count,
      [](absl::string_view text) { return client::ParseInteger(text, 1, kMaxCount); },
      "threads of all agents together (default: one for each core)");
  cli::AddFlag(set, "--block-cells", "N|NXxNYxNZ", &flags->block_cells, client::ParseBlockCells,
               "cells of a block when partitioning (default: as 'isoscope partition')");
  client::AddLevelFlags(set, &flags->level);
  cli::AddLevelFlags(set, &flags->levels);
  cli::AddFlag(set, "--peer", "SCRIPT", &flags->peer, cli::ParseText,
               "a yardstick to run in turns with ours: see below");
  cli::AddFlag(set, "--json", "FILE", &flags->json, cli::ParseText, "write every figure as JSON");
  cli::AddSourceFlags(set, &flags->source);
  return [flags](const cli::Context& context) { return Run(*flags, context); };
}

}  // namespace

cli::Command FrameBenchCommand() {
  return {
      .name = "frame",
      .summary = "Times whole frames as a client sees them, beside another program",
      .usage = "INPUT | DIR --isovalue V... [OPTIONS]",
      .examples =
          "  isoscope-bench frame head.nii.gz --isovalue 60 --shards 1 4 --culling depth none\n"
          "  isoscope-bench frame ct.nrrd --isovalue 30,60 --peer yardstick.py --json ct.json\n"
          "\nCold is the first frame of a fresh process with the files in the page cache;\n"
          "following is the median of the others, from new places of the camera. A time is the\n"
          "client's clock around one request, PNG included.\n"
          "\nThe peer is called as\n"
          "  xvfb-run -a -s \"-screen 0 1280x1024x24\" /usr/bin/python3 SCRIPT RAW --dims X,Y,Z "
          "\\\n"
          "    --type TYPE --isovalue V --frames N --orbit DEG --size W\n"
          "(--spacing, --azimuth and --elevation where they are not 1,1,1, 30 and 20) and\n"
          "prints a JSON object with \"cold_total\" and \"next_total\" in milliseconds. \"cold "
          "x\" and\n\"next x\" are its times over ours.\n",
      .register_flags = RegisterFrameBenchFlags};
}

}  // namespace isoscope::bench
