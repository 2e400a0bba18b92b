#include "server/cluster/agent_metrics.h"

#include <string>
#include <utility>

namespace isoscope::server {
namespace {

using base::MetricFamily;
using base::MetricSample;

// "rendering occluders" -> "rendering_occluders".
std::string LabelOf(PartStage stage) {
  std::string label = NameOf(stage);
  for (char& c : label) {
    c = c == ' ' ? '_' : c;
  }
  return label;
}

// Returns true if the failure is counted from 0 on. A series that begins with its first failure
// would hide that failure from `increase` and `rate`.
bool IsExpected(PartStage stage, absl::StatusCode code) {
  return stage != PartStage::kDone && stage != PartStage::kEnded &&
         (code == absl::StatusCode::kUnavailable || code == absl::StatusCode::kDeadlineExceeded ||
          code == absl::StatusCode::kDataLoss || code == absl::StatusCode::kInternal);
}

}  // namespace

void AgentMetrics::CountFailure(PartStage stage, const absl::Status& status) {
  const auto code = static_cast<std::size_t>(status.code());
  failures_[static_cast<std::size_t>(stage)]
           [code < kCodeCount ? code : static_cast<std::size_t>(absl::StatusCode::kUnknown)]
               .Add();
}

void AgentMetrics::AppendMetrics(std::vector<MetricFamily>* families) const {
  using Type = MetricFamily::Type;
  families->push_back(
      {.name = "isoscope_replica_parts_total",
       .help = "Parts of frames that a second agent worked on: repeated because the first "
               "failed, hedged because it was slow; outrun: the second was done first.",
       .type = Type::kCounter,
       .samples = {MetricSample::Of(repeated, {{"event", "repeated"}}),
                   MetricSample::Of(hedged, {{"event", "hedged"}}),
                   MetricSample::Of(lost_hedges, {{"event", "outrun"}})}});
  families->push_back({.name = "isoscope_agent_parts_total",
                       .help = "Parts of frames by agent and outcome.",
                       .type = Type::kCounter,
                       .samples = parts_.Samples()});
  std::vector<MetricSample> failures;
  for (std::size_t i = 0; i < kPartStageCount; ++i) {
    const auto stage = static_cast<PartStage>(i);
    for (std::size_t k = 0; k < kCodeCount; ++k) {
      const auto code = static_cast<absl::StatusCode>(k);
      if (failures_[i][k].value() > 0 || IsExpected(stage, code)) {
        failures.push_back(MetricSample::Of(
            failures_[i][k],
            {{"stage", LabelOf(stage)}, {"code", absl::StatusCodeToString(code)}}));
      }
    }
  }
  families->push_back({.name = "isoscope_agent_failures_total",
                       .help = "Agents that made a frame or another request fail, by stage of the "
                               "frame and status code.",
                       .type = Type::kCounter,
                       .samples = std::move(failures)});
}

}  // namespace isoscope::server
