// isoscope-bench paper INPUT --output DIR
//
// Tables, plots, pictures and report.md are written to a folder beside the output, which is renamed
// when it is complete. Datasets lie in a temporary folder. That of one shard stays to the end, any
// other until the next is made, so the disk holds two. report.md has the command line that repeats
// the evaluation, with every default written out.

#include <algorithm>
#include <cstdint>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "bench/machine.h"
#include "bench/paper_bench.h"
#include "bench/paper_bench_plots.h"
#include "bench/paper_bench_report.h"
#include "bench/program.h"
#include "client-cli/session/partition_volume.h"
#include "client-cli/session/source_flags.h"
#include "clients/cpp/request/camera_flags.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/cli/command.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/progress_line.h"
#include "core/cli/usage.h"
#include "core/io/atomic_file.h"
#include "core/io/file.h"
#include "core/io/temporary_folder.h"
#include "core/render/renderer_factory.h"
#include "core/store/shard_reader.h"

namespace isoscope::bench {
namespace {

constexpr std::int64_t kMaxRunCount = 100;
constexpr std::int64_t kMaxIsovalueCount = 1000;
constexpr std::int64_t kMaxAgentCount = 1024;

struct PaperBenchFlags {
  std::optional<std::string> input;
  std::optional<std::string> output;
  std::vector<std::optional<double>> isovalues;  // none: "auto"
  std::optional<std::int64_t> isovalue_count;
  std::vector<double> picture_isovalues;
  std::vector<std::int64_t> agent_counts;
  std::optional<store::Distribution> distribution;
  std::vector<std::int64_t> balance_counts;
  std::optional<std::int64_t> side_px;
  std::optional<std::int64_t> run_count;
  client::CameraFlags camera;
  std::optional<math::Index3> block_cells;
  std::optional<render::RendererKind> renderer;
  cli::SourceFlags source;
};

absl::StatusOr<std::optional<double>> ParseIsovalueOrAuto(absl::string_view text) {
  if (text == "auto") {
    return std::optional<double>();
  }
  const absl::StatusOr<double> number = client::ParseNumber(text);
  if (!number.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(number.status().message(), ", nor 'auto'"));
  }
  return std::optional<double>(*number);
}

absl::Status CheckUsage(const PaperBenchFlags& flags) {
  if (!flags.input) {
    return cli::UsageError("INPUT is missing: the volume file to evaluate on");
  }
  if (!flags.output) {
    return cli::UsageError(
        "--output DIR is missing: the folder to make for tables, plots and report");
  }
  const auto autos = std::count(flags.isovalues.begin(), flags.isovalues.end(), std::nullopt);
  if (autos > 0 && flags.isovalues.size() > 1) {
    return cli::UsageError("--isovalues takes levels, or 'auto' alone");
  }
  if (flags.isovalue_count && autos == 0 && !flags.isovalues.empty()) {
    return cli::UsageError("--levels is for --isovalues auto; the levels are given");
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.camera));
  return CheckUsage(flags.source, *flags.input);
}

// Returns " --azimuth 30": the given flags, as a user types them.
std::string DescribeFlags(const client::CameraFlags& flags) {
  std::string text;
  const auto add_vector = [&](const char* name, const std::optional<math::Vec3d>& value) {
    if (value) {
      absl::StrAppendFormat(&text, " %s %.9g,%.9g,%.9g", name, value->x, value->y, value->z);
    }
  };
  const auto add_number = [&](const char* name, const std::optional<double>& value) {
    if (value) {
      absl::StrAppendFormat(&text, " %s %.9g", name, *value);
    }
  };
  add_vector("--eye", flags.eye);
  add_vector("--target", flags.target);
  add_vector("--up", flags.up);
  add_number("--fov-y", flags.fov_y_degrees);
  add_number("--azimuth", flags.azimuth_degrees);
  add_number("--elevation", flags.elevation_degrees);
  add_number("--zoom", flags.zoom);
  return text;
}

std::vector<int> ToInts(const std::vector<std::int64_t>& values, std::vector<int> otherwise) {
  return values.empty() ? std::move(otherwise) : std::vector<int>(values.begin(), values.end());
}

PaperBenchPlan PlanOf(const PaperBenchFlags& flags) {
  PaperBenchPlan plan;
  for (const std::optional<double>& isovalue : flags.isovalues) {
    if (isovalue) {
      plan.isovalues.push_back(*isovalue);
    }
  }
  std::sort(plan.isovalues.begin(), plan.isovalues.end());
  plan.isovalues.erase(std::unique(plan.isovalues.begin(), plan.isovalues.end()),
                       plan.isovalues.end());
  plan.isovalue_count = static_cast<int>(flags.isovalue_count.value_or(plan.isovalue_count));
  plan.picture_isovalues = flags.picture_isovalues;
  plan.speedup_agent_counts = ToInts(flags.agent_counts, plan.speedup_agent_counts);
  plan.balance_agent_counts = ToInts(flags.balance_counts, plan.balance_agent_counts);
  plan.speedup_distribution = flags.distribution.value_or(plan.speedup_distribution);
  std::sort(plan.balance_agent_counts.begin(), plan.balance_agent_counts.end());
  plan.balance_agent_counts.erase(
      std::unique(plan.balance_agent_counts.begin(), plan.balance_agent_counts.end()),
      plan.balance_agent_counts.end());
  plan.side_px = static_cast<int>(flags.side_px.value_or(plan.side_px));
  plan.run_count = static_cast<int>(flags.run_count.value_or(plan.run_count));
  if (!DescribeFlags(flags.camera).empty()) {
    plan.camera = flags.camera;
  }
  return plan;
}

// Returns the command line that repeats the evaluation.
std::string CommandOf(const PaperBenchFlags& flags, const PaperBenchPlan& plan,
                      const PaperBenchResult& result) {
  const auto append_number = [](std::string* out, double value) {
    absl::StrAppendFormat(out, "%.9g", value);
  };
  return absl::StrFormat(
      "isoscope-bench paper %s --output %s --isovalues %s --picture-isovalues %s --agents %s "
      "--distribution %s --balance-agents %s --size %d --runs %d%s --block-cells %dx%dx%d "
      "--renderer %s",
      *flags.input, *flags.output, absl::StrJoin(result.isovalues, ",", append_number),
      plan.picture_isovalues.empty() ? absl::StrFormat("%.9g", result.speedup_isovalue)
                                     : absl::StrJoin(plan.picture_isovalues, ",", append_number),
      absl::StrJoin(plan.speedup_agent_counts, ","), store::NameOf(plan.speedup_distribution),
      absl::StrJoin(plan.balance_agent_counts, ","), plan.side_px, plan.run_count,
      DescribeFlags(plan.camera), result.manifest.block_cells.x, result.manifest.block_cells.y,
      result.manifest.block_cells.z,
      flags.renderer == render::RendererKind::kEgl    ? "egl"
      : flags.renderer == render::RendererKind::kAuto ? "auto"
                                                      : "cpu");
}

// The datasets of the measurements, in a temporary folder.
class Datasets {
 public:
  Datasets(const PaperBenchFlags& flags, const io::TemporaryFolder& folder,
           const cli::Context& context)
      : flags_(flags), folder_(folder), context_(context) {}

  absl::StatusOr<std::string> Make(store::Distribution distribution, int shard_count) {
    if (!last_.empty()) {
      ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(last_));
      last_.clear();
    }
    partition::PartitionOptions options;
    options.output_directory =
        folder_.Sub(absl::StrCat(store::NameOf(distribution), "-", shard_count));
    options.shard_count = shard_count;
    options.distribution = distribution;
    options.block_cells = flags_.block_cells;
    ISOSCOPE_RETURN_IF_ERROR(
        cli::PartitionVolume(cli::RequestOf(flags_.source, *flags_.input), options, context_)
            .status());
    if (shard_count > 1) {
      last_ = options.output_directory;
    }
    return options.output_directory;
  }

 private:
  const PaperBenchFlags& flags_;
  const io::TemporaryFolder& folder_;
  const cli::Context& context_;
  std::string last_;  // removed when the next one is made
};

absl::Status WriteFiles(const std::string& folder, const std::vector<OutputFile>& files) {
  for (const OutputFile& file : files) {
    ISOSCOPE_RETURN_IF_ERROR(io::WriteWholeFile(absl::StrCat(folder, "/", file.name), file.bytes));
  }
  return absl::OkStatus();
}

// Writes all results into `folder`, with plots if gnuplot is available; else sets
// facts->missing_plots.
absl::Status WriteResults(const std::string& folder, const PaperBenchResult& result,
                          const cli::Context& context, PaperReportFacts* facts) {
  ISOSCOPE_RETURN_IF_ERROR(WriteFiles(folder, PaperTables(result)));
  for (const PaperPicture& picture : result.pictures) {
    ISOSCOPE_RETURN_IF_ERROR(
        io::WriteWholeFile(absl::StrCat(folder, "/", picture.name, ".png"), picture.png));
  }
  const std::vector<OutputFile> scripts = PaperPlotScripts();
  ISOSCOPE_RETURN_IF_ERROR(WriteFiles(folder, scripts));
  const absl::Status drawn = DrawPlots(folder, scripts, context.interrupt);
  if (absl::IsNotFound(drawn)) {
    facts->missing_plots = std::string(drawn.message());
  } else {
    ISOSCOPE_RETURN_IF_ERROR(drawn);
  }
  return WriteFiles(folder, {{"report.md", PaperReport(result, *facts)}});
}

absl::Status Run(const PaperBenchFlags& flags, const cli::Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  if (store::IsDatasetDirectory(*flags.input)) {
    return cli::UsageError(
        absl::StrCat("'", *flags.input,
                     "' is a dataset; the evaluation cuts the volume anew for each "
                     "number of agents: give the volume"));
  }
  ISOSCOPE_RETURN_IF_ERROR(cli::SourceFiles(cli::RequestOf(flags.source, *flags.input)).status());
  std::string output = *flags.output;
  while (output.size() > 1 && output.back() == '/') {
    output.pop_back();
  }
  if (io::PathExists(output)) {
    return absl::AlreadyExistsError(
        absl::StrCat("'", output, "' exists; --output names a new folder"));
  }
  // Appears complete or not at all.
  const std::string partial = io::PartialName(output);
  ISOSCOPE_RETURN_IF_ERROR(io::RemoveRecursively(partial));
  ISOSCOPE_RETURN_IF_ERROR(io::CreateDirectory(partial));
  const absl::Cleanup remove_partial = [&] { io::RemoveRecursively(partial).IgnoreError(); };

  ISOSCOPE_ASSIGN_OR_RETURN(const io::TemporaryFolder folder, io::TemporaryFolder::Make());
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::unique_ptr<render::Renderer> renderer,
      render::MakeRenderer({.kind = flags.renderer.value_or(render::RendererKind::kCpu)}));
  const PaperBenchPlan plan = PlanOf(flags);
  PaperReportFacts facts{.machine = DescribeMachine(),
                         .timestamp = Timestamp(),
                         .renderer = renderer->description(),
                         .run_count = plan.run_count,
                         .side_px = plan.side_px};
  const base::MonotonicTime start = base::MonotonicNow();
  Datasets datasets(flags, folder, context);
  PaperBenchResult result;
  {
    cli::ProgressLine line(context.err, context.err_is_terminal);
    ISOSCOPE_ASSIGN_OR_RETURN(
        result, RunPaperBench(
                    plan,
                    [&](store::Distribution distribution, int shard_count) {
                      return datasets.Make(distribution, shard_count);
                    },
                    renderer.get(), [&](const std::string& text) { line.Update(text); },
                    context.interrupt->cancellation()));
  }
  facts.command = CommandOf(flags, plan, result);
  ISOSCOPE_RETURN_IF_ERROR(WriteResults(partial, result, context, &facts));
  ISOSCOPE_RETURN_IF_ERROR(io::RenamePath(partial, output));
  if (!facts.missing_plots.empty()) {
    *context.err << "isoscope: no plots: " << facts.missing_plots
                 << "; the tables are complete without" << std::endl;
  }
  *context.out << output << "/report.md: figures 1, 6, 7, 8 and 9 over " << result.isovalues.size()
               << " isovalues, in " << cli::FormatElapsed(base::MonotonicNow() - start) << "\n";
  return absl::OkStatus();
}

cli::Action RegisterPaperBenchFlags(cli::FlagSet* set) {
  const auto flags = std::make_shared<PaperBenchFlags>();
  const auto parse_agent_count = [](absl::string_view text) {
    return client::ParseInteger(text, 1, kMaxAgentCount);
  };
  cli::AddFlag(set, "input", "INPUT", &flags->input, cli::ParseSource,
               "a volume, as 'partition' takes it: it is cut anew for each number of agents");
  cli::AddFlag(set, "--output", "DIR", &flags->output, cli::ParseText,
               "folder for tables, plots and report.md; must not exist yet");
  cli::AddListFlag(set, "--isovalues", "V|auto", &flags->isovalues, ParseIsovalueOrAuto,
                   "levels of figures 1 and 6 (default: auto, evenly spread over the values)");
  cli::AddFlag(
      set, "--levels", "N", &flags->isovalue_count,
      [](absl::string_view text) { return client::ParseInteger(text, 1, kMaxIsovalueCount); },
      "how many of them with auto (default: 16)");
  cli::AddListFlag(
      set, "--picture-isovalues", "V", &flags->picture_isovalues, client::ParseNumber,
      "levels of figure 8; figures 7 and 9 take the first (default: the middle level)");
  cli::AddListFlag(set, "--agents", "P", &flags->agent_counts, parse_agent_count,
                   "numbers of agents of figure 7 (default: 2,4,8,16)");
  cli::AddFlag(set, "--distribution", "random|greedy", &flags->distribution,
               store::DistributionFromName,
               "how the blocks of figure 7 are dealt out (default: random); figure 1 has both");
  cli::AddListFlag(set, "--balance-agents", "P", &flags->balance_counts, parse_agent_count,
                   "numbers of agents of figure 1 (default: 2,4,8,16,32,64)");
  cli::AddFlag(
      set, "--size", "N", &flags->side_px,
      [](absl::string_view text) { return client::ParseInteger(text, 1, view::kMaxViewportPx); },
      "sides of the pictures, pixels (default: 1024)");
  cli::AddFlag(
      set, "--runs", "N", &flags->run_count,
      [](absl::string_view text) { return client::ParseInteger(text, 1, kMaxRunCount); },
      "times each figure is measured; the least time is kept (default: 3)");
  cli::AddFlag(set, "--block-cells", "N|NXxNYxNZ", &flags->block_cells, client::ParseBlockCells,
               "cells of a block (default: as 'isoscope partition')");
  cli::AddFlag(set, "--renderer", "auto|egl|cpu", &flags->renderer, render::RendererKindFromName,
               "back end (default: cpu, which keeps to the one thread of an isolated agent)");
  client::AddCameraFlags(set, &flags->camera);
  cli::AddSourceFlags(set, &flags->source);
  return [flags](const cli::Context& context) { return Run(*flags, context); };
}

}  // namespace

cli::Command PaperBenchCommand() {
  return {
      .name = "paper",
      .summary = "Repeats the evaluation of the paper on a volume: tables, plots, a report",
      .usage = "INPUT --output DIR [OPTIONS]",
      .examples =
          "  isoscope-bench paper head.nii.gz --output head-paper\n"
          "  isoscope-bench paper ct.nrrd --output ct-paper --isovalues 20,40,60,80 --runs 1\n"
          "\nFigures 1 (balance of random and greedy distributions, theorem 2.2), 6 (with and\n"
          "without culling), 7 (speed-up), 8 (stages of the picture) and 9 (the culled surface\n"
          "from the side), each as CSV, and through gnuplot as SVG and PNG. Agents are measured\n"
          "one at a time, each on one thread, whatever the number of cores. Takes minutes.\n"
          "Without camera flags the default camera turns by --azimuth 30 --elevation 20.\n",
      .register_flags = RegisterPaperBenchFlags};
}

}  // namespace isoscope::bench
