// isoscope-bench owners DIR --isovalue V

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "bench/measurement.h"
#include "bench/owner_bench.h"
#include "bench/program.h"
#include "client-cli/session/embedded_cluster.h"
#include "clients/cpp/request/parse_value.h"
#include "core/base/status_macros.h"
#include "core/cli/command.h"
#include "core/cli/flags.h"
#include "core/cli/format.h"
#include "core/cli/table.h"
#include "core/cli/usage.h"

namespace isoscope::bench {
namespace {

constexpr std::int64_t kMaxCount = 1000;

struct OwnerBenchFlags {
  std::optional<std::string> input;
  std::optional<double> isovalue;
  std::optional<std::int64_t> run_count;
  std::optional<std::int64_t> frame_count;
  std::optional<double> orbit_degrees;
  std::optional<double> azimuth_degrees;
  std::optional<double> elevation_degrees;
  std::optional<std::int64_t> width;
  std::optional<std::int64_t> height;
  std::optional<std::int64_t> thread_count;
  std::optional<std::int64_t> memory_limit;
  std::optional<std::string> json;
};

OwnerBenchPlan PlanOf(const OwnerBenchFlags& flags) {
  OwnerBenchPlan plan;
  plan.directory = *flags.input;
  plan.isovalue = *flags.isovalue;
  plan.run_count = static_cast<int>(flags.run_count.value_or(plan.run_count));
  plan.frame_count = static_cast<int>(flags.frame_count.value_or(plan.frame_count));
  plan.orbit_degrees = flags.orbit_degrees.value_or(plan.orbit_degrees);
  plan.azimuth_degrees = flags.azimuth_degrees.value_or(plan.azimuth_degrees);
  plan.elevation_degrees = flags.elevation_degrees.value_or(plan.elevation_degrees);
  plan.viewport.width_px = static_cast<int>(flags.width.value_or(plan.viewport.width_px));
  plan.viewport.height_px = static_cast<int>(flags.height.value_or(plan.viewport.height_px));
  plan.thread_count = static_cast<int>(flags.thread_count.value_or(plan.thread_count));
  plan.memory_limit_bytes = static_cast<std::size_t>(
      flags.memory_limit.value_or(static_cast<std::int64_t>(plan.memory_limit_bytes)));
  return plan;
}

std::string TextOf(const OwnerBenchPlan& plan, const OwnerBenchResult& result) {
  cli::Table table({"frame", "following ms", "blocks", "triangles"});
  const auto add = [&](const char* name, const OwnerFigures& of) {
    table.AddRow({name, cli::FormatMilliseconds(of.ms),
                  cli::FormatCount(static_cast<std::int64_t>(of.block_count)),
                  cli::FormatCount(static_cast<std::int64_t>(of.triangle_count))});
  };
  add("whole", result.whole);
  add("blocks that own a pixel", result.owners);
  return absl::StrCat(plan.viewport.width_px, " x ", plan.viewport.height_px,
                      " pixels; medians of ", plan.run_count, " runs of ", plan.frame_count,
                      " frames ", plan.orbit_degrees,
                      " degrees apart; the same pictures both ways\n\n", table.ToString(),
                      absl::StrFormat("\nwhole / owners: %.3f; %.0f blocks are active\n",
                                      result.ratio(), result.active_block_count));
}

nlohmann::ordered_json ToJson(const OwnerFigures& of) {
  return {{"following_ms", of.ms},
          {"block_count", of.block_count},
          {"triangle_count", of.triangle_count}};
}

std::string JsonOf(const Occasion& occasion, const OwnerBenchPlan& plan,
                   const OwnerBenchResult& result) {
  nlohmann::ordered_json json = JsonHead(occasion);
  json["volume"] = occasion.volume;
  json["isovalue"] = plan.isovalue;
  json["width"] = plan.viewport.width_px;
  json["height"] = plan.viewport.height_px;
  json["memory_limit_bytes"] = plan.memory_limit_bytes;
  json["active_block_count"] = result.active_block_count;
  json["whole"] = ToJson(result.whole);
  json["owners"] = ToJson(result.owners);
  json["ratio"] = result.ratio();
  json["whole_ms"] = result.whole_ms;
  json["owners_ms"] = result.owners_ms;
  return json.dump(2) + "\n";
}

absl::Status Run(const OwnerBenchFlags& flags, const cli::Context& context) {
  if (!flags.input) {
    return cli::UsageError("DIR is missing: a dataset folder");
  }
  if (!flags.isovalue) {
    return cli::UsageError("--isovalue V is missing: an isovalue, in field units");
  }
  const OwnerBenchPlan plan = PlanOf(flags);
  const std::string volume = std::filesystem::path(plan.directory).filename().string();
  return RunMeasurement(
      flags.json, volume, context, [&](const Occasion& occasion) -> absl::StatusOr<Report> {
        ISOSCOPE_ASSIGN_OR_RETURN(const OwnerBenchResult result, RunOwnerBench(plan, context));
        return Report{.json = JsonOf(occasion, plan, result), .text = TextOf(plan, result)};
      });
}

cli::Action RegisterOwnerBenchFlags(cli::FlagSet* set) {
  const auto flags = std::make_shared<OwnerBenchFlags>();
  const auto parse_side = [](absl::string_view text) {
    return client::ParseInteger(text, 1, view::kMaxViewportPx);
  };
  const auto parse_count = [](absl::string_view text) {
    return client::ParseInteger(text, 1, kMaxCount);
  };
  cli::AddFlag(set, "input", "DIR", &flags->input, cli::ParseText, "a dataset folder");
  cli::AddFlag(set, "--isovalue", "V", &flags->isovalue, client::ParseNumber,
               "an isovalue, in field units");
  cli::AddFlag(set, "--runs", "N", &flags->run_count, parse_count, "runs of each way (default: 3)");
  cli::AddFlag(
      set, "--frames", "N", &flags->frame_count,
      [](absl::string_view text) { return client::ParseInteger(text, 2, kMaxCount); },
      "frames of a run, 2 or more (default: 6)");
  cli::AddFlag(set, "--orbit", "DEG", &flags->orbit_degrees, client::ParseNumber,
               "turn the camera about up after each frame (default: 7)");
  cli::AddFlag(set, "--azimuth", "DEG", &flags->azimuth_degrees, client::ParseNumber,
               "turn the default camera about up before the first frame (default: 30)");
  cli::AddFlag(set, "--elevation", "DEG", &flags->elevation_degrees, client::ParseNumber,
               "then about its right axis (default: 20)");
  cli::AddFlag(set, "--width", "W", &flags->width, parse_side, "pixels (default: 1024)");
  cli::AddFlag(set, "--height", "H", &flags->height, parse_side, "pixels (default: 1024)");
  cli::AddFlag(set, "--threads", "T", &flags->thread_count, parse_count,
               "threads (default: one for each core)");
  cli::AddFlag(set, "--memory-limit", "BYTES", &flags->memory_limit, cli::ParseAgentMemory,
               "memory of the agent, as in 1GiB, of which half is its cache (default: 1GiB)");
  cli::AddFlag(set, "--json", "FILE", &flags->json, cli::ParseText, "write every figure as JSON");
  return [flags](const cli::Context& context) { return Run(*flags, context); };
}

}  // namespace

cli::Command OwnerBenchCommand() {
  return {.name = "owners",
          .summary = "Times exact frames beside frames of the blocks that own a pixel",
          .usage = "DIR --isovalue V [OPTIONS]",
          .examples =
              "  isoscope-bench owners head --isovalue 60\n"
              "\nA frame that is handed exactly the blocks that own a pixel is the least\n"
              "that an exact frame could draw: it finds no blocks, casts no rays and tests\n"
              "nothing. Both ways give the same bytes, which is checked. One agent of this\n"
              "process serves all shards, and the CPU draws.\n",
          .register_flags = RegisterOwnerBenchFlags};
}

}  // namespace isoscope::bench
