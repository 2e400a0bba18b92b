// isoscope-bench slider INPUT | DIR | --server HOST:PORT --isovalue V

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "bench/measurement.h"
#include "bench/program.h"
#include "bench/slider_bench.h"
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

struct SliderBenchFlags {
  cli::SessionFlags session;
  client::RequestFlags request;
  std::optional<double> last_isovalue;
  std::optional<std::int64_t> steps;
  std::optional<double> pause_ms;
  std::optional<std::string> json;
};

absl::StatusOr<std::int64_t> ParseSteps(absl::string_view text) {
  return client::ParseInteger(text, 4, 10000);
}

absl::Status CheckUsage(const SliderBenchFlags& flags) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags.session));
  if (!flags.last_isovalue) {
    return cli::UsageError("--to is missing: name the isovalue where the slider ends");
  }
  if (flags.request.isovalues().size() != 1) {
    return cli::UsageError("name one --isovalue, where the slider begins");
  }
  if (flags.pause_ms && (*flags.pause_ms < 0 || *flags.pause_ms > 10000)) {
    return cli::UsageError(
        absl::StrCat("--pause-ms is ", *flags.pause_ms, ": must lie in [0, 10000]"));
  }
  return CheckUsage(flags.request);
}

absl::Status Run(const SliderBenchFlags& flags, const cli::Context& context) {
  ISOSCOPE_RETURN_IF_ERROR(CheckUsage(flags));
  base::SetLogLevel(base::LogLevel::kOff);
  SliderBenchPlan plan;
  plan.session = flags.session;
  plan.request = flags.request;
  plan.last_isovalue = *flags.last_isovalue;
  plan.step_count = static_cast<int>(flags.steps.value_or(plan.step_count));
  plan.pause = absl::Milliseconds(flags.pause_ms.value_or(0));
  return RunMeasurement(
      flags.json, VolumeOf(flags.session), context,
      [&](const Occasion& occasion) -> absl::StatusOr<Report> {
        ISOSCOPE_ASSIGN_OR_RETURN(const SliderBenchResult result, RunSliderBench(plan, context));
        return Report{
            .json = SliderBenchJson(occasion, plan, result),
            .text = absl::StrCat(DescribeFrame(plan.request, result.drawers), ", ",
                                 result.drawers.renderer, "\n\n", DescribeSliderBench(result))};
      });
}

cli::Action RegisterSliderBenchFlags(cli::FlagSet* set) {
  const auto flags = std::make_shared<SliderBenchFlags>();
  cli::AddSessionFlags(set, &flags->session);
  cli::AddRendererFlag(set, &flags->session);
  cli::AddFlag(set, "--to", "V", &flags->last_isovalue, client::ParseNumber,
               "isovalue where the slider ends; --isovalue is where it begins");
  cli::AddFlag(set, "--steps", "N", &flags->steps, ParseSteps, "number of isovalues (default: 20)");
  cli::AddFlag(set, "--pause-ms", "T", &flags->pause_ms, client::ParseNumber,
               "pause between frames (default: 0)");
  cli::AddFlag(set, "--json", "FILE", &flags->json, cli::ParseText, "write the figures as JSON");
  client::AddRequestFlags(set, &flags->request);
  return [flags](const cli::Context& context) { return Run(*flags, context); };
}

}  // namespace

cli::Command SliderBenchCommand() {
  return {.name = "slider",
          .summary = "Moves an isovalue twice over the same range: times and new memory of a frame",
          .usage = "INPUT | DIR | --server HOST:PORT --isovalue V --to V [OPTIONS]",
          .examples =
              "  isoscope-bench slider head --isovalue 50 --to 70\n"
              "  isoscope-bench slider --server localhost:50051 --isovalue 50 --to 70 "
              "--json slider.json\n"
              "\nWithout --server, coordinator and agents run in this process.\n",
          .register_flags = RegisterSliderBenchFlags};
}

}  // namespace isoscope::bench
