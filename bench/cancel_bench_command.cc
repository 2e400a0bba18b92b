// isoscope-bench cancel INPUT | DIR --isovalue V

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "bench/cancel_bench.h"
#include "bench/measurement.h"
#include "bench/program.h"
#include "client-cli/session/partition_volume.h"
#include "client-cli/session/source_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/cli/command.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/usage.h"
#include "core/io/temporary_folder.h"
#include "core/render/renderer_factory.h"
#include "core/store/shard_reader.h"

namespace isoscope::bench {
namespace {

constexpr std::int64_t kMaxCancelCount = 1'000'000;
constexpr std::int64_t kMaxThreadCount = 1024;

struct CancelBenchFlags {
  std::optional<std::string> input;
  client::RequestFlags request;
  std::optional<std::int64_t> shard_count;
  std::optional<std::int64_t> cancel_count;
  std::optional<std::int64_t> frames_per_start;
  std::optional<std::uint64_t> seed;
  std::optional<std::int64_t> thread_count;
  std::optional<render::RendererKind> renderer;
  std::optional<std::string> json;
  cli::SourceFlags source;
};

absl::Status CheckUsage(const CancelBenchFlags& flags) {
  if (!flags.input) {
    return cli::UsageError("give a volume file or a dataset folder");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.request));
  if (store::IsDatasetDirectory(*flags.input)) {
    const char* given = flags.shard_count ? "--shards" : flags.source.FirstGiven();
    return given == nullptr
               ? absl::OkStatus()
               : cli::UsageError(absl::StrCat(given, " is for volume files; '", *flags.input,
                                              "' is a dataset, which is cut already"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.source, *flags.input));
  return cli::SourceFiles(cli::RequestOf(flags.source, *flags.input)).status();
}

// Returns the dataset folder: the input itself, or one made from it in `folder`.
absl::StatusOr<std::string> PrepareDataset(const CancelBenchFlags& flags,
                                           const io::TemporaryFolder& folder,
                                           const cli::Context& context) {
  if (store::IsDatasetDirectory(*flags.input)) {
    return *flags.input;
  }
  partition::PartitionOptions options;
  options.output_directory = folder.Sub("dataset");
  options.shard_count = static_cast<int>(flags.shard_count.value_or(1));
  ISOSCOPE_RETURN_IF_ERROR(
      cli::PartitionVolume(cli::RequestOf(flags.source, *flags.input), options, context).status());
  return options.output_directory;
}

CancelBenchPlan PlanOf(const CancelBenchFlags& flags) {
  CancelBenchPlan plan;
  plan.cluster.renderer = flags.renderer.value_or(render::RendererKind::kAuto);
  plan.cluster.thread_count = static_cast<int>(flags.thread_count.value_or(0));
  plan.cluster.max_frame_duration = absl::Hours(24);
  plan.cluster.expected_viewport = flags.request.viewport();
  plan.request = flags.request;
  client::CameraFlags& camera = plan.request.camera;
  if (!camera.eye && !camera.target && !camera.up && !camera.fov_y_degrees) {
    camera.azimuth_degrees = camera.azimuth_degrees.value_or(kDefaultAzimuth);
    camera.elevation_degrees = camera.elevation_degrees.value_or(kDefaultElevation);
  }
  plan.cancel_count = static_cast<int>(flags.cancel_count.value_or(plan.cancel_count));
  plan.frames_per_start = static_cast<int>(flags.frames_per_start.value_or(plan.frames_per_start));
  plan.seed = flags.seed.value_or(plan.seed);
  return plan;
}

absl::Status Run(const CancelBenchFlags& flags, const cli::Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  base::SetLogLevel(base::LogLevel::kOff);
  return RunMeasurement(
      flags.json, std::filesystem::path(*flags.input).filename().string(), context,
      [&](const Occasion& occasion) -> absl::StatusOr<Report> {
        ISOSCOPE_ASSIGN_OR_RETURN(const io::TemporaryFolder folder, io::TemporaryFolder::Make());
        CancelBenchPlan plan = PlanOf(flags);
        ISOSCOPE_ASSIGN_OR_RETURN(plan.cluster.dataset_directory,
                                  PrepareDataset(flags, folder, context));
        ISOSCOPE_ASSIGN_OR_RETURN(const CancelBenchResult result, RunCancelBench(plan, context));
        return Report{
            .json = CancelBenchJson(occasion, plan, result),
            .text = absl::StrCat(DescribeFrame(plan.request, result.drawers), " in this process, ",
                                 result.drawers.renderer, "; a whole frame takes ",
                                 cli::FormatMilliseconds(result.cold_ms), " ms cold, ",
                                 cli::FormatMilliseconds(result.following_ms), " ms following\n\n",
                                 DescribeCancelBench(result))};
      });
}

cli::Action RegisterCancelBenchFlags(cli::FlagSet* set) {
  const auto flags = std::make_shared<CancelBenchFlags>();
  cli::AddFlag(set, "input", "INPUT|DIR", &flags->input, cli::ParseText,
               "a volume, as 'partition' takes it, or a dataset folder");
  cli::AddFlag(set, "--shards", "P", &flags->shard_count, cli::ParseShardCount,
               "cut a volume into P shards, one agent each (default: 1)");
  cli::AddFlag(
      set, "--cancels", "N", &flags->cancel_count,
      [](absl::string_view text) { return client::ParseInteger(text, 1, kMaxCancelCount); },
      "frames to cancel (default: 500)");
  cli::AddFlag(
      set, "--frames-per-start", "N", &flags->frames_per_start,
      [](absl::string_view text) { return client::ParseInteger(text, 1, kMaxCancelCount); },
      "frames before the cluster is started anew; the first of them is cold (default: 5)");
  cli::AddFlag(set, "--seed", "S", &flags->seed, client::ParseUnsigned,
               "of the moments at which frames are cancelled (default: 1)");
  cli::AddFlag(
      set, "--threads", "T", &flags->thread_count,
      [](absl::string_view text) { return client::ParseInteger(text, 1, kMaxThreadCount); },
      "threads of the agents together (default: one for each core)");
  cli::AddFlag(set, "--renderer", "auto|egl|cpu", &flags->renderer, render::RendererKindFromName,
               "back end (default: auto, EGL on a GPU, else the CPU)");
  cli::AddFlag(set, "--json", "FILE", &flags->json, cli::ParseText, "write every figure as JSON");
  client::AddRequestFlags(set, &flags->request);
  cli::AddSourceFlags(set, &flags->source);
  return [flags](const cli::Context& context) { return Run(*flags, context); };
}

}  // namespace

cli::Command CancelBenchCommand() {
  return {
      .name = "cancel",
      .summary = "Cancels frames at random moments: how long until all agents are idle",
      .usage = "INPUT | DIR --isovalue V [OPTIONS]",
      .examples =
          "  isoscope-bench cancel head.nii.gz --isovalue 60 --shards 4\n"
          "  isoscope-bench cancel head --isovalue 60 --cancels 100 --json cancel.json\n"
          "\nCoordinator and agents run in this process. Median and p99 of the time from the\n"
          "client's cancel until its call has returned, and until all agents are idle.\n"
          "Without camera flags the default camera turns by --azimuth 30 --elevation 20, and by\n"
          "7 degrees more after each frame.\n",
      .register_flags = RegisterCancelBenchFlags};
}

}  // namespace isoscope::bench
