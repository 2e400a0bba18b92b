// The slider stays at each isovalue for one frame. The first two isovalues do not count: they
// allocate images, plans and buffers. New memory is the growth of the resident set during a frame.
// Kernel time is that of all threads of the process. The first touch of a page costs both.

#include "bench/slider_bench.h"

#include <utility>

#include "absl/status/status.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include <nlohmann/json.hpp>
#include <sys/resource.h>

#include "bench/sample_statistics.h"
#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/json_text.h"
#include "core/base/memory_info.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/cli/interrupt.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::bench {
namespace {

namespace v1 = isoscope::v1;

constexpr absl::Duration kMaxSliderWait = absl::Minutes(1);
constexpr int kUncounted = 2;

absl::Duration KernelTime() {
  struct rusage usage {};
  ::getrusage(RUSAGE_SELF, &usage);
  return absl::DurationFromTimeval(usage.ru_stime);
}

class SliderBench {
 public:
  SliderBench(const SliderBenchPlan& plan, const cli::Context& context)
      : plan_(plan), context_(context) {}

  absl::StatusOr<SliderBenchResult> Run() {
    ISOSCOPE_ASSIGN_OR_RETURN(stage_, OpenStage(plan_.session, plan_.request, context_));
    result_.drawers = stage_.drawers;
    result_.is_in_process = !plan_.session.server.has_value();
    std::vector<std::string> first_pngs;
    std::vector<std::string> second_pngs;
    ISOSCOPE_RETURN_IF_ERROR(Pass(&result_.first, &first_pngs));
    ISOSCOPE_RETURN_IF_ERROR(Pass(&result_.second, &second_pngs));
    result_.is_repeatable = first_pngs == second_pngs;
    return std::move(result_);
  }

 private:
  absl::Status Pass(std::vector<SliderFrame>* frames, std::vector<std::string>* pngs) {
    for (int step = 0; step < plan_.step_count; ++step) {
      ISOSCOPE_RETURN_IF_ERROR(context_.interrupt->cancellation().Check());
      absl::SleepFor(plan_.pause);
      ISOSCOPE_ASSIGN_OR_RETURN(const SliderFrame frame, Step(step, pngs));
      if (step >= kUncounted) {
        frames->push_back(frame);
      }
    }
    return absl::OkStatus();
  }

  absl::StatusOr<SliderFrame> Step(int step, std::vector<std::string>* pngs) {
    const double first = plan_.request.isovalue.value_or(0);
    v1::RenderIsosurfaceRequest request = stage_.scene.Frame();
    request.set_isovalue(first + (plan_.last_isovalue - first) * step / (plan_.step_count - 1));
    const auto resident = static_cast<double>(base::ResidentBytes());
    const absl::Duration kernel = KernelTime();
    const base::MonotonicTime start = base::MonotonicNow();
    ISOSCOPE_ASSIGN_OR_RETURN(v1::RenderIsosurfaceResponse response,
                              stage_.session->client().RenderIsosurface(request, kMaxSliderWait));
    const base::MonotonicTime end = base::MonotonicNow();
    pngs->push_back(std::move(*response.mutable_png()));
    return SliderFrame{
        .isovalue = request.isovalue(),
        .ms = absl::ToDoubleMilliseconds(end - start),
        .kernel_ms = absl::ToDoubleMilliseconds(KernelTime() - kernel),
        .grown_mib = (static_cast<double>(base::ResidentBytes()) - resident) / base::kMiB};
  }

  const SliderBenchPlan& plan_;
  const cli::Context& context_;
  Stage stage_;
  SliderBenchResult result_;
};

struct Summary {
  double median_ms = 0;
  double p95_ms = 0;
  double median_kernel_ms = 0;
  double median_grown_mib = 0;
};

Summary Summarize(const std::vector<SliderFrame>& frames) {
  std::vector<double> times;
  std::vector<double> kernel_times;
  std::vector<double> grown;
  for (const SliderFrame& frame : frames) {
    times.push_back(frame.ms);
    kernel_times.push_back(frame.kernel_ms);
    grown.push_back(frame.grown_mib);
  }
  return {Median(times), Percentile(times, 0.95), Median(kernel_times), Median(grown)};
}

nlohmann::ordered_json ToJson(const Summary& summary) {
  return {{"median_ms", summary.median_ms},
          {"p95_ms", summary.p95_ms},
          {"median_kernel_ms", summary.median_kernel_ms},
          {"median_grown_mib", summary.median_grown_mib}};
}

}  // namespace

absl::StatusOr<SliderBenchResult> RunSliderBench(const SliderBenchPlan& plan,
                                                 const cli::Context& context) {
  return SliderBench(plan, context).Run();
}

std::string DescribeSliderBench(const SliderBenchResult& result) {
  std::string text = absl::StrFormat("%-16s %10s %10s %10s %14s\n", "isovalue", "median", "p95",
                                     result.is_in_process ? "in kernel" : "",
                                     result.is_in_process ? "new memory" : "");
  for (const auto& [name, frames] :
       {std::pair("for the first time", &result.first), std::pair("once more", &result.second)}) {
    const Summary summary = Summarize(*frames);
    absl::StrAppendFormat(&text, "%-18s %7.1f ms %7.1f ms", name, summary.median_ms,
                          summary.p95_ms);
    if (result.is_in_process) {
      absl::StrAppendFormat(&text, " %7.1f ms %9.1f MiB", summary.median_kernel_ms,
                            summary.median_grown_mib);
    }
    text += "\n";
  }
  text += result.is_repeatable ? "the same bytes both times\n" : "NOT the same bytes both times\n";
  return text;
}

std::string SliderBenchJson(const Occasion& occasion, const SliderBenchPlan& plan,
                            const SliderBenchResult& result) {
  nlohmann::ordered_json json = JsonHead(occasion);
  json["volume"] = occasion.volume;
  json["isovalues"] = {plan.request.isovalue.value_or(0), plan.last_isovalue};
  AddFrame(plan.request, result.drawers, &json);
  json["new"] = ToJson(Summarize(result.first));
  json["again"] = ToJson(Summarize(result.second));
  return client::JsonText(json);
}

}  // namespace isoscope::bench
