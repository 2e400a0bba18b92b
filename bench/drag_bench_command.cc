// isoscope-bench drag INPUT | DIR | --server HOST:PORT --isovalue V

#include <memory>
#include <optional>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "bench/drag_bench.h"
#include "bench/measurement.h"
#include "bench/program.h"
#include "client-cli/session/session.h"
#include "clients/cpp/request/parse_value.h"
#include "clients/cpp/request/render_request.h"
#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/cli/command.h"
#include "core/cli/flags.h"
#include "core/cli/usage.h"

namespace isoscope::bench {
namespace {

struct DragBenchFlags {
  cli::SessionFlags session;
  client::RequestFlags request;
  std::optional<double> seconds;
  std::optional<double> rate;
  std::optional<double> states;
  std::optional<double> decode_ms;
  std::optional<std::string> json;
};

absl::Status CheckRange(const std::optional<double>& value, double min, double max,
                        const char* flag) {
  return !value || (*value >= min && *value <= max)
             ? absl::OkStatus()
             : cli::UsageError(
                   absl::StrCat(flag, " is ", *value, ": must lie in [", min, ", ", max, "]"));
}

absl::Status CheckUsage(const DragBenchFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  ISOSCOPE_RETURN_IF_ERROR(CheckRange(flags.seconds, 1, 3600, "--seconds"));
  ISOSCOPE_RETURN_IF_ERROR(CheckRange(flags.rate, 1, 120, "--rate"));
  ISOSCOPE_RETURN_IF_ERROR(CheckRange(flags.states, 1, 1000, "--states"));
  ISOSCOPE_RETURN_IF_ERROR(CheckRange(flags.decode_ms, 0, 1000, "--decode-ms"));
  return CheckUsage(flags.request);
}

absl::Status Run(const DragBenchFlags& flags, const cli::Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  base::SetLogLevel(base::LogLevel::kOff);
  DragBenchPlan plan;
  plan.session = flags.session;
  plan.request = flags.request;
  plan.duration = absl::Seconds(flags.seconds.value_or(absl::ToDoubleSeconds(plan.duration)));
  plan.states_per_second = flags.states.value_or(plan.states_per_second);
  plan.target_frames_per_second = flags.rate.value_or(0);
  plan.decode = absl::Milliseconds(flags.decode_ms.value_or(0));
  return RunMeasurement(
      flags.json, VolumeOf(flags.session), context,
      [&](const Occasion& occasion) -> absl::StatusOr<Report> {
        ISOSCOPE_ASSIGN_OR_RETURN(const DragBenchResult result, RunDragBench(plan, context));
        return Report{
            .json = DragBenchJson(occasion, plan, result),
            .text = absl::StrCat(DescribeFrame(plan.request, result.drawers), ", ",
                                 result.drawers.renderer, "\n\n", DescribeDragBench(result))};
      });
}

cli::Action RegisterDragBenchFlags(cli::FlagSet* set) {
  const auto flags = std::make_shared<DragBenchFlags>();
  cli::AddSessionFlags(set, &flags->session);
  cli::AddRendererFlag(set, &flags->session);
  cli::AddFlag(set, "--seconds", "S", &flags->seconds, client::ParseNumber,
               "how long to drag (default: 10)");
  cli::AddFlag(set, "--rate", "N", &flags->rate, client::ParseNumber,
               "frames a second that the server aims for; 1 keeps the full size (default: 30)");
  cli::AddFlag(set, "--states", "N", &flags->states, client::ParseNumber,
               "views a second that the client sends (default: 60)");
  cli::AddFlag(set, "--decode-ms", "T", &flags->decode_ms, client::ParseNumber,
               "time that the client takes to decode a frame (default: 0)");
  cli::AddFlag(set, "--json", "FILE", &flags->json, cli::ParseText, "write the figures as JSON");
  client::AddRequestFlags(set, &flags->request);
  return [flags](const cli::Context& context) { return Run(*flags, context); };
}

}  // namespace

cli::Command DragBenchCommand() {
  return {.name = "drag",
          .summary = "Drags a view: frames a second, latency, time until it is exact",
          .usage = "INPUT | DIR | --server HOST:PORT --isovalue V [OPTIONS]",
          .examples =
              "  isoscope-bench drag head --isovalue 60 --width 1024 --height 1024\n"
              "  isoscope-bench drag --server localhost:50051 --isovalue 60 --rate 1 "
              "--json drag.json\n"
              "\nWithout --server, coordinator and agents run in this process. The client sends 60 "
              "views a second,\n"
              "each a degree further, and acknowledges frames as they come.\n",
          .register_flags = RegisterDragBenchFlags};
}

}  // namespace isoscope::bench
