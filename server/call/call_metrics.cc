#include "server/call/call_metrics.h"

#include <utility>

namespace isoscope::server {
namespace {

using base::MetricFamily;
using base::MetricSample;

// Indexed by RequestMethod.
constexpr std::array<const char*, 10> kMethodNames = {
    "RenderIsosurface", "RenderIsosurfaceStream", "PickSurface", "ExportIsosurface",
    "Interact",         "ListDatasets",           "GetDataset",  "GetHistogram",
    "GetCapabilities",  "GetClusterStatus"};

// The names of the reasons, in the order of the enumerators.
constexpr std::array<const char*, kCutReasonCount> kCutReasonNames = {"too_slow", "too_long",
                                                                      "made_room", "withdrawn"};

}  // namespace

const char* NameOf(RequestMethod method) { return kMethodNames[static_cast<std::size_t>(method)]; }

CallMetrics::CallMetrics() : requests_({kMethodNames.begin(), kMethodNames.end()}) {}

void CallMetrics::AppendMetrics(std::vector<MetricFamily>* families) const {
  using Type = MetricFamily::Type;
  families->push_back({.name = "isoscope_requests_total",
                       .help = "Calls that ended, by method and status code.",
                       .type = Type::kCounter,
                       .samples = requests_.Counts()});
  families->push_back({.name = "isoscope_request_duration_seconds",
                       .help = "Time of calls, by method.",
                       .type = Type::kHistogram,
                       .samples = requests_.Durations()});
  families->push_back({.name = "isoscope_unsent_bytes",
                       .help = "Bytes of answers that wait until their clients take them.",
                       .type = Type::kGauge,
                       .samples = {MetricSample::Of(static_cast<double>(unsent_bytes.value()))}});
  std::vector<MetricSample> cuts;
  for (std::size_t i = 0; i < kCutReasonCount; ++i) {
    cuts.push_back(MetricSample::Of(cuts_[i], {{"reason", kCutReasonNames[i]}}));
  }
  families->push_back(
      {.name = "isoscope_cut_calls_total",
       .help = "Exports and interactive streams that the coordinator ended, by reason.",
       .type = Type::kCounter,
       .samples = std::move(cuts)});
}

}  // namespace isoscope::server
