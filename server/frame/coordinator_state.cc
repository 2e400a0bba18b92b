#include "server/frame/coordinator_state.h"

#include "absl/status/status.h"
#include "absl/strings/str_join.h"

#include "core/base/log.h"

namespace isoscope::server {

CoordinatorState::CoordinatorState(const CoordinatorStateOptions& options)
    : registry(options.registry),
      max_concurrent_frames(options.max_concurrent_frames),
      max_queued_frames(options.max_queued_frames),
      arena(options.arena),
      mailboxes(options.mailboxes),
      calls{.access = options.access, .audit = options.audit},
      memory(options.memory_limit_bytes, options.agent_limit),
      images(image::FrameImagePool::Make(memory.unused_image_bytes())),
      frames({.limits = {.max_working = options.max_concurrent_frames,
                         .max_waiting = options.max_queued_frames}}) {
  if (options.expected_viewport) {
    // Two, because one may still be cleared when the next frame begins.
    for (int i = 0; i < 2; ++i) {
      images->Prepare(options.expected_viewport->width_px, options.expected_viewport->height_px);
    }
  }
}

void LogLostHedge(const base::TraceContext& request, std::int64_t frame_number,
                  const AgentIdentity& agent) {
  base::LogInfo("agent_outrun",
                {{"request", request.request_id()},
                 {"frame", frame_number},
                 {"agent", agent.address},
                 {"shards", base::OwnText{absl::StrJoin(agent.shard_indices, ",")}}});
}

void CoordinatorState::ReportFailures(const base::TraceContext& request, std::int64_t frame_number,
                                      const std::vector<AgentFailure>& failures) {
  for (const AgentFailure& failure : failures) {
    if (absl::IsCancelled(failure.status)) {
      continue;  // we cancelled the call: no failure of the agent
    }
    agent_metrics.CountFailure(failure.stage, failure.status);
    base::LogWarning("agent_failed",
                     {{"request", request.request_id()},
                      {"frame", frame_number},
                      {"agent", failure.agent.address},
                      {"shards", base::OwnText{absl::StrJoin(failure.agent.shard_indices, ",")}},
                      {"stage", NameOf(failure.stage)},
                      {"status", failure.status}});
    if (failure.IsLost() || absl::IsFailedPrecondition(failure.status)) {
      registry->ReportFailure(failure.agent.address);
    }
  }
}

void CoordinatorState::ReportQuery(const base::TraceContext& request, const QueryReport& report) {
  ReportFailures(request, /*frame_number=*/0, report.failures);
  for (const LostHedge& lost : report.lost_hedges) {
    replicas.NoteUnanswered(lost.agent.address, lost.waited);
    LogLostHedge(request, /*frame_number=*/0, lost.agent);
  }
}

CoordinatorState::FrameCounts CoordinatorState::CountFrames() const {
  FrameCounts counts;
  for (const FrameBoard::Frame& frame : board.Frames()) {
    ++(frame.phase == FramePhase::kQueued ? counts.queued : counts.working);
  }
  return counts;
}

void CoordinatorState::AppendMetrics(std::vector<base::MetricFamily>* families) const {
  using base::MetricSample;
  constexpr auto kGauge = base::MetricFamily::Type::kGauge;
  calls.metrics.AppendMetrics(families);
  frame_metrics.AppendMetrics(families);
  const FrameCounts on_board = CountFrames();
  families->push_back({.name = "isoscope_admission_frames",
                       .help = "Frames in work and waiting now.",
                       .type = kGauge,
                       .samples = {MetricSample::Of(on_board.working, {{"state", "working"}}),
                                   MetricSample::Of(on_board.queued, {{"state", "queued"}})}});
  const Admission::Counts counts = frames.counts();
  families->push_back(
      {.name = "isoscope_admission_clients",
       .help = "Clients with queued frames, and refused ones that keep their turn.",
       .type = kGauge,
       .samples = {MetricSample::Of(counts.waiting_clients, {{"state", "queued"}}),
                   MetricSample::Of(counts.outside_clients, {{"state", "refused"}})}});
  families->push_back({.name = "isoscope_admission_limit_frames",
                       .help = "Most frames in work (--max-concurrent-frames) and waiting "
                               "(--max-queued-frames).",
                       .type = kGauge,
                       .samples = {MetricSample::Of(max_concurrent_frames, {{"state", "working"}}),
                                   MetricSample::Of(max_queued_frames, {{"state", "queued"}})}});
  families->push_back({.name = "isoscope_frame_memory_bytes",
                       .help = "Memory that frames in work have reserved.",
                       .type = kGauge,
                       .samples = {MetricSample::Of(static_cast<double>(memory.frame_bytes()))}});
  families->push_back({.name = "isoscope_export_memory_bytes",
                       .help = "Memory that exports have reserved, of a share of their own.",
                       .type = kGauge,
                       .samples = {MetricSample::Of(static_cast<double>(memory.export_bytes()))}});
  calls.access->AppendMetrics(families);
  registry->AppendMetrics(families);
  agent_metrics.AppendMetrics(families);
}

}  // namespace isoscope::server
