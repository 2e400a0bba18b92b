#include "server/frame/frame_runner.h"

#include <algorithm>
#include <deque>
#include <iterator>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/frame/drawn_window.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/proto_convert.h"
#include "core/view/camera_fit.h"
#include "server/frame/agent_client.h"
#include "server/frame/agent_queries.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

// FAILED_PRECONDITION if the back end of the agents can't draw the frame.
absl::Status CheckBackEnd(const frame::FrameSpec& spec, const DatasetState& dataset) {
  if (dataset.picture_revision.back_end == frame::BackEnd::kCpu) {
    return absl::OkStatus();
  }
  const view::Viewport drawn = frame::DrawnWindowOf(spec).viewport;
  if (std::max(drawn.width_px, drawn.height_px) > view::kMaxViewportPx) {
    return absl::FailedPreconditionError(absl::StrCat(
        "viewport of ", spec.viewport.width_px, " x ", spec.viewport.height_px, " pixels",
        spec.effects.samples() > 1
            ? absl::StrCat(" with samples ", spec.effects.samples(), " is drawn with ",
                           drawn.width_px, " x ", drawn.height_px)
            : "",
        ": the agents draw with OpenGL, which takes at most ", view::kMaxViewportPx,
        " a side, also for a region; start them with --renderer cpu"));
  }
  return absl::OkStatus();
}

std::string ActiveKeyOf(const FrameTarget& target, const std::vector<FramePart>& parts,
                        const frame::FrameSpec& spec) {
  std::vector<std::vector<int>> shard_indices;
  shard_indices.reserve(parts.size());
  for (const FramePart& part : parts) {
    shard_indices.push_back(part.shard_indices);
  }
  return ActiveBlocksCache::KeyOf(target.dataset->dataset.dataset_id(), shard_indices,
                                  frame::IsovaluesOf(spec));
}

void LogOutrun(const base::TraceContext& request, std::int64_t frame_number,
               const AgentIdentity& agent) {
  base::LogInfo("agent_outrun", {{"request", request.request_id()},
                                 {"frame", frame_number},
                                 {"agent", agent.address},
                                 {"shards", absl::StrJoin(agent.shard_indices, ",")}});
}

}  // namespace

absl::StatusOr<volume::BlockLayout> LayoutOf(const isoscope::v1::Dataset& dataset,
                                             const volume::GridGeometry& geometry) {
  const isoscope::v1::Dimensions& cells = dataset.block_cells();
  return volume::BlockLayout::Make(geometry.sample_dims, {cells.x(), cells.y(), cells.z()});
}

FrameRunner::FrameRunner(const FrameRunnerOptions& options)
    : options_(options),
      memory_(options.memory_limit_bytes),
      active_blocks_(memory_.active_blocks_bytes()),
      images_(image::FrameImagePool::Make(memory_.unused_image_bytes())),
      admission_({.limits = {.max_working = options.max_concurrent_frames,
                             .max_waiting = options.max_queued_frames}}) {
  if (options.expected_viewport) {
    // Two, because one may still be cleared when the next frame begins.
    for (int i = 0; i < 2; ++i) {
      images_->Prepare(options.expected_viewport->width_px, options.expected_viewport->height_px);
    }
  }
}

absl::StatusOr<Admission::Place> FrameRunner::Admit(const std::string& client,
                                                    const frame::FrameSpec& spec, Delivery delivery,
                                                    bool has_trace) {
  if (absl::Status fits = memory_.CheckFits(spec, delivery, TraceBytes(has_trace)); !fits.ok()) {
    metrics_.too_large_frames.Add();
    return fits;
  }
  absl::StatusOr<Admission::Place> place = admission_.Admit(client);
  if (!place.ok()) {
    metrics_.refused_frames.Add();
  }
  return place;
}

absl::StatusOr<FrameTarget> FrameRunner::FindTarget(isoscope::v1::RenderIsosurfaceRequest* request,
                                                    frame::FrameSpec* spec,
                                                    const base::TraceContext& identity,
                                                    const base::Cancellation& cancellation,
                                                    const Caller& caller) {
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const DatasetState> found,
                            options_.registry->FindComplete(request->dataset(), cancellation,
                                                            caller, request->allow_partial()));
  const DatasetState& dataset = *found;
  ISOSCOPE_RETURN_IF_ERROR(CheckDatasetId(dataset.dataset, request->dataset_id()));
  ISOSCOPE_RETURN_IF_ERROR(CheckBackEnd(*spec, dataset));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            rpc::GeometryFromProto(dataset.dataset.geometry(), "dataset.geometry"));
  ISOSCOPE_ASSIGN_OR_RETURN(volume::BlockLayout layout, LayoutOf(dataset.dataset, geometry));
  std::vector<FramePart> parts = replicas_.Choose(
      dataset.replica_sets, ReplicaKeyOf(dataset.dataset.dataset_id(), frame::IsovaluesOf(*spec)));
  ISOSCOPE_RETURN_IF_ERROR(PlaceCamera({dataset.dataset.dataset_id(), parts, NextTurn()}, geometry,
                                       layout, identity, cancellation, request, spec));
  ISOSCOPE_ASSIGN_OR_RETURN(
      view::View view, view::View::Make(*spec->camera, spec->viewport, geometry, spec->region));
  ISOSCOPE_RETURN_IF_ERROR(
      frame::CheckOwners(frame::OwnerSurfaceCount(*spec), layout.block_count()));
  const frame::BackEnd drawn_by = frame::DrawnBy(*spec, dataset.picture_revision.back_end);
  const image::FragmentOrder order{.block_count = static_cast<std::uint32_t>(layout.block_count()),
                                   .ties = frame::TieRuleOf(drawn_by)};
  return FrameTarget{std::move(found), std::move(parts), view, layout, order};
}

absl::Status FrameRunner::PlaceCamera(const QueryTarget& query,
                                      const volume::GridGeometry& geometry,
                                      const volume::BlockLayout& layout,
                                      const base::TraceContext& identity,
                                      const base::Cancellation& cancellation,
                                      isoscope::v1::RenderIsosurfaceRequest* request,
                                      frame::FrameSpec* spec) {
  std::optional<math::Box3d> surface_bounds;
  if (request->camera_fit() == isoscope::v1::CAMERA_FIT_SURFACE) {
    const QueryOutcome<ActiveExtent> outcome = AskActiveBox(
        query, layout, frame::IsovaluesOf(*spec), request->clip(), identity, cancellation);
    ReportQuery(identity, outcome.report);
    ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
    if (outcome.result->cells.has_value()) {
      surface_bounds =
          view::ClippedBounds(view::BoundsOfCells(geometry, *outcome.result->cells), spec->clip);
    }
  }
  return rpc::ResolveCamera(geometry.Bounds(), request, spec, surface_bounds);
}

absl::StatusOr<FrameResult> FrameRunner::Run(const FrameIdentity& identity,
                                             const isoscope::v1::RenderIsosurfaceRequest& request,
                                             const frame::FrameSpec& spec,
                                             const FrameTarget& target,
                                             const base::Cancellation& cancellation,
                                             std::vector<FramePart>* parts) {
  isoscope::v1::RenderIsosurfaceRequest of_agents = request;
  of_agents.clear_allow_partial();  // nothing to an agent
  of_agents.clear_dataset_id();     // older agents refuse it
  while (true) {
    std::vector<std::size_t> lost_parts;
    absl::StatusOr<FrameResult> result =
        RunParts(identity, of_agents, spec, target, *parts, cancellation, &lost_parts);
    const bool goes_on =
        request.allow_partial() && !lost_parts.empty() && lost_parts.size() < parts->size();
    if (!goes_on) {
      return result;
    }
    // From the beginning: a part that was lost has left some of its pixels in the picture.
    std::reverse(lost_parts.begin(), lost_parts.end());  // those that stay keep their places
    for (const std::size_t lost : lost_parts) {
      parts->erase(parts->begin() + static_cast<std::ptrdiff_t>(lost));
    }
  }
}

absl::StatusOr<FrameResult> FrameRunner::RunParts(
    const FrameIdentity& identity, const isoscope::v1::RenderIsosurfaceRequest& request,
    const frame::FrameSpec& spec, const FrameTarget& target, const std::vector<FramePart>& parts,
    const base::Cancellation& cancellation, std::vector<std::size_t>* lost_parts) {
  const std::string active_key = ActiveKeyOf(target, parts, spec);
  FrameSetup setup;
  setup.spec = &spec;
  setup.view = &target.view;
  setup.layout = &target.layout;
  setup.ties = target.order.ties;
  setup.active = active_blocks_.Find(active_key);
  setup.max_waiting_bytes = WaitingBandBytes(spec);
  setup.images = images_.get();
  setup.arena = options_.arena.get();
  setup.trace = identity.trace;
  setup.step = identity.step;
  for (const FramePart& part : parts) {
    setup.replica_counts.push_back(static_cast<int>(part.replicas.size()));
  }
  const auto replica_of = [&parts](int part_index, int replica_index) -> const ServingAgent& {
    return parts[static_cast<std::size_t>(part_index)]
        .replicas[static_cast<std::size_t>(replica_index)];
  };
  setup.is_lost = [&](int part_index, int replica_index) {
    return !options_.registry->IsReachable(replica_of(part_index, replica_index).address);
  };
  Attempts attempts;
  setup.may_hedge = [&](int part_index, int replica_index) {
    if (!replicas_.TryHedge(replica_of(part_index, replica_index).address)) {
      return false;
    }
    attempts.slow.insert(replica_of(part_index, replica_index - 1).address);
    return true;
  };
  (setup.active != nullptr ? metrics_.active_blocks_hits : metrics_.active_blocks_misses).Add();
  internal::BeginFrame begin;
  begin.set_frame_number(identity.number);
  begin.set_dataset_id(target.dataset->dataset.dataset_id());
  *begin.mutable_request() = request;
  begin.set_agent_count(static_cast<std::int32_t>(parts.size()));
  begin.set_report_active_blocks(setup.active == nullptr);
  begin.set_sends_normals(spec.sends_normals);
  begin.set_sends_map_steps(spec.sends_map_steps);
  std::deque<isoscope::v1::ProcessTrace> traces;  // of the attempts, each with a place of its own
  std::vector<ReplicaBoard::Lease> leases;
  const auto begin_on_agent =
      [&](int part_index, int replica_index,
          AgentListener* listener) -> absl::StatusOr<std::unique_ptr<AgentLink>> {
    internal::BeginFrame of_part = begin;
    of_part.set_agent_index(part_index);
    const FramePart& part = parts[static_cast<std::size_t>(part_index)];
    const AgentAssignment agent = part.On(static_cast<std::size_t>(replica_index));
    AgentTraceTarget trace_target;
    if (identity.trace != nullptr) {
      trace_target = {.zero = identity.trace_zero,
                      .trace = &traces.emplace_back(),
                      .max_spans = memory_.max_trace_spans() / 4 * 3 / parts.size()};
    }
    leases.push_back(replicas_.Take(agent.address));
    attempts.begins.emplace(agent.address, absl::Now());
    return BeginFrameOnAgent(agent, std::move(of_part), target.dataset->dataset.block_count(),
                             cancellation.deadline(), options_.mailboxes.get(), *identity.request,
                             trace_target, listener);
  };
  FrameOutcome outcome = RunFrame(setup, begin_on_agent, cancellation);
  LearnFrom(identity, attempts, outcome);
  *lost_parts = outcome.lost_parts;
  if (!outcome.status.ok()) {
    return outcome.status;
  }
  if (identity.trace != nullptr) {
    identity.agent_traces->insert(identity.agent_traces->end(),
                                  std::make_move_iterator(traces.begin()),
                                  std::make_move_iterator(traces.end()));
  }
  if (setup.active == nullptr && outcome.result.active != nullptr) {
    active_blocks_.Insert(active_key, outcome.result.active);
  }
  return std::move(outcome.result);
}

// Remembers which agents did well, so that the next frames begin with those.
void FrameRunner::LearnFrom(const FrameIdentity& identity, const Attempts& attempts,
                            const FrameOutcome& outcome) {
  const absl::Time now = absl::Now();
  const auto note_unanswered = [&](const std::string& address) {
    const auto begin = attempts.begins.find(address);
    if (attempts.slow.contains(address) || !options_.registry->IsReachable(address)) {
      replicas_.NoteTrouble(address, now);
    } else if (begin != attempts.begins.end()) {
      replicas_.NoteUnanswered(address, now - begin->second, now);
    }
  };
  ReportFailures(*identity.request, identity.number, outcome.failures);
  metrics_.hedged_parts.Add(outcome.hedge_count);
  metrics_.outrun_parts.Add(static_cast<std::int64_t>(outcome.outrun.size()));
  if (outcome.status.ok()) {
    metrics_.repeated_parts.Add(static_cast<std::int64_t>(outcome.failures.size()));
    for (const frame::AgentStatistics& agent : outcome.result.agents) {
      replicas_.NoteSuccess(agent.agent_address);
      metrics_.CountPart(agent.agent_address, CoordinatorMetrics::PartOutcome::kDone);
    }
  }
  for (const AgentFailure& failure : outcome.failures) {
    if (absl::IsDeadlineExceeded(failure.status)) {
      note_unanswered(failure.agent.address);
    } else {
      replicas_.NoteTrouble(failure.agent.address, now);
    }
    metrics_.CountPart(failure.agent.address, CoordinatorMetrics::PartOutcome::kFailed);
  }
  for (const AgentIdentity& agent : outcome.outrun) {
    note_unanswered(agent.address);
    metrics_.CountPart(agent.address, CoordinatorMetrics::PartOutcome::kOutrun);
    LogOutrun(*identity.request, identity.number, agent);
  }
}

void FrameRunner::ReportQuery(const base::TraceContext& request, const QueryReport& report) {
  ReportFailures(request, /*frame_number=*/0, report.failures);
  for (const OutrunAgent& outrun : report.outrun) {
    replicas_.NoteUnanswered(outrun.agent.address, outrun.waited);
    LogOutrun(request, /*frame_number=*/0, outrun.agent);
  }
}

void FrameRunner::ReportFailures(const base::TraceContext& request, std::int64_t frame_number,
                                 const std::vector<AgentFailure>& failures) {
  for (const AgentFailure& failure : failures) {
    metrics_.CountAgentFailure(failure.stage, failure.status);
    base::LogWarning("agent_failed", {{"request", request.request_id()},
                                      {"frame", frame_number},
                                      {"agent", failure.agent.address},
                                      {"shards", absl::StrJoin(failure.agent.shard_indices, ",")},
                                      {"stage", NameOf(failure.stage)},
                                      {"status", failure.status}});
    if (absl::IsUnavailable(failure.status) || absl::IsFailedPrecondition(failure.status)) {
      options_.registry->ReportFailure(failure.agent.address);
    }
  }
}

void FrameRunner::EndRequest(RequestMethod method, const AuditRecord& record,
                             const base::TraceContext& request, const absl::Status& status,
                             absl::Duration duration) {
  metrics_.CountRequest(method, status, duration);
  if (options_.audit != nullptr) {
    options_.audit->Write(NameOf(method), record, request.request_id(), status);
  }
}

CoordinatorGauges FrameRunner::gauges() const {
  CoordinatorGauges gauges;
  for (const FrameBoard::Frame& frame : board_.Frames()) {
    ++(frame.step == FrameStep::kQueued ? gauges.queued_frames : gauges.working_frames);
  }
  const Admission::Counts counts = admission_.counts();
  gauges.waiting_clients = counts.waiting_clients;
  gauges.outside_clients = counts.outside_clients;
  gauges.max_working_frames = options_.max_concurrent_frames;
  gauges.max_queued_frames = options_.max_queued_frames;
  gauges.memory_limit_bytes = memory_.limit_bytes();
  gauges.frame_memory_bytes = memory_.frame_bytes();
  gauges.export_memory_bytes = memory_.export_bytes();
  return gauges;
}

}  // namespace isoscope::server
