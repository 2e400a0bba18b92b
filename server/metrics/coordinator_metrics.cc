// Counters and histograms are atomics, updated where the event happens. Collect reads them when a
// monitor asks, adds the gauges, and gives each family its name, unit suffix and help.
//
// Series by caller and by agent are bounded: names above the limit share one series. Failures that
// operators watch for have a series from the start, with the value 0 (IsExpected).

#include "server/metrics/coordinator_metrics.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <utility>

namespace isoscope::server {
namespace {

// Indexed by RequestMethod.
constexpr std::array<const char*, 10> kMethodNames = {
    "RenderIsosurface", "RenderIsosurfaceStream", "PickSurface", "ExportIsosurface",
    "Interact",         "ListDatasets",           "GetDataset",  "GetHistogram",
    "GetCapabilities",  "GetClusterStatus"};

using base::MetricFamily;
using base::MetricLabels;
using base::MetricSample;

// In the order of the enumerators.
constexpr std::array<const char*, kTokenLimitCount> kTokenLimitNames = {
    "frame_rate", "frames", "streams", "exports", "bytes"};
constexpr std::array<const char*, kCutReasonCount> kCutReasonNames = {"too_slow", "too_long",
                                                                      "made_room", "withdrawn"};

MetricSample Value(double value, const char* label = nullptr, const char* label_value = "") {
  return MetricSample::Of(value,
                          label == nullptr ? MetricLabels() : MetricLabels{{label, label_value}});
}

MetricSample Value(const base::Counter& counter, const char* label = nullptr,
                   const char* label_value = "") {
  return Value(static_cast<double>(counter.value()), label, label_value);
}

MetricFamily Of(MetricFamily::Type type, const char* name, const char* help,
                std::vector<MetricSample> samples) {
  return {.name = name, .help = help, .type = type, .samples = std::move(samples)};
}

absl::string_view NameOfCaller(absl::string_view caller) {
  return caller.empty() ? "(no token)" : caller;
}

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

void AppendFrames(const CoordinatorMetrics& metrics, const CoordinatorGauges& gauges,
                  std::vector<MetricFamily>* families) {
  using Type = MetricFamily::Type;
  families->push_back(Of(Type::kCounter, "isoscope_frames_total",
                         "Frames and picks that ended, by outcome.",
                         {Value(metrics.frames.done, "outcome", "done"),
                          Value(metrics.frames.failed, "outcome", "failed"),
                          Value(metrics.frames.cancelled, "outcome", "cancelled"),
                          Value(metrics.frames.refused, "outcome", "refused")}));
  families->push_back(Of(Type::kHistogram, "isoscope_frame_duration_seconds",
                         "Time from the arrival of a frame or a pick to its end, waiting included.",
                         {MetricSample::Of(metrics.durations.exact, {{"kind", "exact"}}),
                          MetricSample::Of(metrics.durations.moving, {{"kind", "moving"}})}));
  families->push_back(
      Of(Type::kHistogram, "isoscope_frame_step_duration_seconds",
         "Time of each step of frames that ended well.",
         {MetricSample::Of(metrics.durations.occluder_selection, {{"step", "occluder_selection"}}),
          MetricSample::Of(metrics.durations.occluder_rendering, {{"step", "occluder_rendering"}}),
          MetricSample::Of(metrics.durations.visibility_culling, {{"step", "visibility_culling"}}),
          MetricSample::Of(metrics.durations.composite, {{"step", "composite"}}),
          MetricSample::Of(metrics.durations.encode, {{"step", "encode"}})}));
  families->push_back(Of(Type::kHistogram, "isoscope_admission_wait_seconds",
                         "Time that frames waited before they began: for a thread, and for memory.",
                         {MetricSample::Of(metrics.durations.queue_wait, {{"for", "thread"}}),
                          MetricSample::Of(metrics.durations.memory_wait, {{"for", "memory"}})}));
  families->push_back(Of(Type::kGauge, "isoscope_admission_frames",
                         "Frames in work and waiting now.",
                         {Value(gauges.working_frames, "state", "working"),
                          Value(gauges.queued_frames, "state", "queued")}));
  families->push_back(Of(Type::kGauge, "isoscope_admission_clients",
                         "Clients with queued frames, and refused ones that keep their turn.",
                         {Value(gauges.waiting_clients, "state", "queued"),
                          Value(gauges.outside_clients, "state", "refused")}));
  const std::int64_t displaced = metrics.frames.displaced.value();
  const std::int64_t full = std::max(metrics.frames.refused.value() - displaced, std::int64_t{0});
  families->push_back(Of(Type::kCounter, "isoscope_admission_refused_frames_total",
                         "Frames and picks that were not drawn, by reason.",
                         {Value(static_cast<double>(full), "reason", "queue_full"),
                          Value(static_cast<double>(displaced), "reason", "made_room"),
                          Value(metrics.frames.expired, "reason", "deadline"),
                          Value(metrics.frames.rate_limited, "reason", "token_rate"),
                          Value(metrics.frames.too_large, "reason", "memory_limit")}));
  families->push_back(Of(Type::kGauge, "isoscope_admission_limit_frames",
                         "Most frames in work (--max-concurrent-frames) and waiting "
                         "(--max-queued-frames).",
                         {Value(gauges.max_working_frames, "state", "working"),
                          Value(gauges.max_queued_frames, "state", "queued")}));
  families->push_back(Of(Type::kGauge, "isoscope_frame_memory_bytes",
                         "Memory that frames in work have reserved.",
                         {Value(static_cast<double>(gauges.frame_memory_bytes))}));
  families->push_back(Of(Type::kGauge, "isoscope_export_memory_bytes",
                         "Memory that exports have reserved, of a share of their own.",
                         {Value(static_cast<double>(gauges.export_memory_bytes))}));
  families->push_back(Of(Type::kGauge, "isoscope_unsent_bytes",
                         "Bytes of answers that wait until their clients take them.",
                         {Value(static_cast<double>(metrics.unsent_bytes.value()))}));
  families->push_back(Of(Type::kCounter, "isoscope_response_bytes_total",
                         "Bytes of pictures and planes of frames that ended well.",
                         {Value(metrics.response_bytes)}));
}

void AppendAgents(const CoordinatorMetrics& metrics, const CoordinatorGauges& gauges,
                  std::vector<MetricFamily>* families) {
  using Type = MetricFamily::Type;
  families->push_back(Of(Type::kCounter, "isoscope_agent_network_bytes_total",
                         "Bytes of messages between coordinator and agents for frames, both ways.",
                         {Value(metrics.network_bytes)}));
  families->push_back(
      Of(Type::kCounter, "isoscope_cache_lookups_total", "Looks into a cache, by result.",
         {MetricSample::Of(static_cast<double>(metrics.active_blocks_hits.value()),
                           {{"cache", "active_blocks"}, {"result", "hit"}}),
          MetricSample::Of(static_cast<double>(metrics.active_blocks_misses.value()),
                           {{"cache", "active_blocks"}, {"result", "miss"}})}));
  families->push_back(Of(Type::kGauge, "isoscope_agents", "Agents, as they were last seen.",
                         {Value(gauges.reachable_agents, "state", "reachable"),
                          Value(gauges.unreachable_agents, "state", "unreachable"),
                          Value(gauges.opening_agents, "state", "opening")}));
  families->push_back(Of(Type::kGauge, "isoscope_damaged_shards",
                         "Shards with files that their agents could not read.",
                         {MetricSample::Of(static_cast<double>(gauges.damaged_shards))}));
  families->push_back(Of(Type::kGauge, "isoscope_datasets",
                         "Datasets; of a complete one all shards are served, by agents of one "
                         "picture revision.",
                         {Value(gauges.complete_datasets, "state", "complete"),
                          Value(gauges.incomplete_datasets, "state", "incomplete")}));
  families->push_back(
      Of(Type::kCounter, "isoscope_replica_parts_total",
         "Parts of frames that a second agent worked on: repeated because the first "
         "failed, hedged because it was slow; outrun: the second was done first.",
         {Value(metrics.parts.repeated, "event", "repeated"),
          Value(metrics.parts.hedged, "event", "hedged"),
          Value(metrics.parts.lost_hedges, "event", "outrun")}));
  families->push_back(Of(Type::kCounter, "isoscope_partial_frames_total",
                         "Frames without some shards, as their request allowed.",
                         {Value(metrics.frames.partial)}));
}

// Files that are read again when they have changed, and the audit log.
void AppendFiles(const CoordinatorGauges& gauges, std::vector<MetricFamily>* families) {
  using Type = MetricFamily::Type;
  families->push_back(Of(Type::kGauge, "isoscope_certificate_days_left",
                         "Days until the own certificate expires; 0 if it can't be read, infinity "
                         "without one.",
                         {Value(gauges.certificate_days_left)}));
  families->push_back(
      Of(Type::kCounter, "isoscope_reload_failures_total",
         "Files that were wrong, or could not be read, after a change; what was read before holds.",
         {Value(static_cast<double>(gauges.token_failures), "file", "tokens"),
          Value(static_cast<double>(gauges.certificate_failures), "file", "certificate")}));
  families->push_back(Of(Type::kCounter, "isoscope_audit_lines_total",
                         "Lines of the audit log, by result.",
                         {Value(static_cast<double>(gauges.audit_lines), "result", "written"),
                          Value(static_cast<double>(gauges.audit_failures), "result", "failed")}));
}

}  // namespace

const char* NameOf(RequestMethod method) { return kMethodNames[static_cast<std::size_t>(method)]; }

CoordinatorMetrics::CoordinatorMetrics()
    : requests_({kMethodNames.begin(), kMethodNames.end()}),
      callers_("caller", {"done", "failed", "cancelled", "refused"}, kMaxCallers),
      agents_("agent", {"done", "failed", "outrun"}, kMaxAgents) {}

void CoordinatorMetrics::CountRequest(RequestMethod method, const absl::Status& status,
                                      absl::Duration duration) {
  requests_.Count(static_cast<std::size_t>(method), status.code(), duration);
}

void CoordinatorMetrics::CountFrame(const absl::Status& status, absl::Duration duration,
                                    bool is_moving, absl::string_view caller) {
  if (absl::IsCancelled(status)) {
    frames.cancelled.Add();
    callers_.Add(NameOfCaller(caller), kCancelled);
    return;
  }
  (status.ok() ? frames.done : frames.failed).Add();
  (is_moving ? durations.moving : durations.exact).Observe(duration);
  callers_.Add(NameOfCaller(caller), status.ok() ? kDone : kFailed);
}

void CoordinatorMetrics::CountRefused(absl::string_view caller) {
  callers_.Add(NameOfCaller(caller), kRefused);
}

void CoordinatorMetrics::CountPart(absl::string_view agent_address, PartOutcome outcome) {
  agents_.Add(agent_address, static_cast<std::size_t>(outcome));
}

absl::Status CoordinatorMetrics::CountRefusal(TokenLimit limit, absl::Status status) {
  if (!status.ok()) {
    token_refusals_[static_cast<std::size_t>(limit)].Add();
  }
  return status;
}

void CoordinatorMetrics::CountAgentFailure(PartStage stage, const absl::Status& status) {
  const auto code = static_cast<std::size_t>(status.code());
  agent_failures_[static_cast<std::size_t>(stage)]
                 [code < kCodeCount ? code : static_cast<std::size_t>(absl::StatusCode::kUnknown)]
                     .Add();
}

std::vector<MetricFamily> CoordinatorMetrics::Collect(const CoordinatorGauges& gauges) const {
  using Type = MetricFamily::Type;
  std::vector<MetricFamily> families = base::ProcessMetrics(
      "isoscope-coordinator", static_cast<std::int64_t>(gauges.memory_limit_bytes));
  families.push_back(Of(Type::kCounter, "isoscope_requests_total",
                        "Calls that ended, by method and status code.", requests_.Counts()));
  families.push_back(Of(Type::kHistogram, "isoscope_request_duration_seconds",
                        "Time of calls, by method.", requests_.Durations()));
  AppendFrames(*this, gauges, &families);
  std::vector<MetricSample> refusals;
  for (std::size_t i = 0; i < kTokenLimitCount; ++i) {
    refusals.push_back(Value(token_refusals_[i], "limit", kTokenLimitNames[i]));
  }
  families.push_back(Of(Type::kCounter, "isoscope_token_refusals_total",
                        "Frames, streams and exports that a token's limit refused, by limit.",
                        std::move(refusals)));
  std::vector<MetricSample> cuts;
  for (std::size_t i = 0; i < kCutReasonCount; ++i) {
    cuts.push_back(Value(cuts_[i], "reason", kCutReasonNames[i]));
  }
  families.push_back(Of(Type::kCounter, "isoscope_cut_calls_total",
                        "Exports and interactive streams that the coordinator ended, by reason.",
                        std::move(cuts)));
  AppendAgents(*this, gauges, &families);
  families.push_back(Of(Type::kCounter, "isoscope_caller_frames_total",
                        "Frames and picks by caller, the name of its token, and outcome.",
                        callers_.Samples()));
  families.push_back(Of(Type::kCounter, "isoscope_agent_parts_total",
                        "Parts of frames by agent and outcome.", agents_.Samples()));
  AppendFiles(gauges, &families);
  std::vector<MetricSample> failures;
  for (std::size_t stage = 0; stage < kPartStageCount; ++stage) {
    for (std::size_t code = 0; code < kCodeCount; ++code) {
      const std::int64_t count = agent_failures_[stage][code].value();
      if (count > 0 ||
          IsExpected(static_cast<PartStage>(stage), static_cast<absl::StatusCode>(code))) {
        failures.push_back(MetricSample::Of(
            static_cast<double>(count),
            {{"stage", LabelOf(static_cast<PartStage>(stage))},
             {"code", absl::StatusCodeToString(static_cast<absl::StatusCode>(code))}}));
      }
    }
  }
  families.push_back(Of(Type::kCounter, "isoscope_agent_failures_total",
                        "Agents that made a frame or another request fail, by stage of the frame "
                        "and status code.",
                        std::move(failures)));
  return families;
}

}  // namespace isoscope::server
