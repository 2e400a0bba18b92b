#include "server/frame_runner.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/log.h"
#include "core/base/status_macros.h"
#include "core/frame/drawn_window.h"
#include "core/rpc/frame_convert.h"
#include "core/rpc/proto_convert.h"
#include "core/view/camera_fit.h"
#include "server/agent_client.h"
#include "server/agent_queries.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

// Splits agents of several shards into one for each shard.
std::vector<AgentAssignment> EachShardApart(const std::vector<AgentAssignment>& agents) {
  std::vector<AgentAssignment> apart;
  for (const AgentAssignment& agent : agents) {
    if (agent.shard_indices.size() > FrameRunner::kMaxShardsApart) {
      apart.push_back(agent);
      continue;
    }
    for (const int shard : agent.shard_indices) {
      apart.push_back({agent.address, agent.channel, {shard}});
    }
  }
  return apart;
}

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

std::string ActiveKeyOf(const FrameTarget& target, const frame::FrameSpec& spec) {
  std::vector<std::vector<int>> shard_indices;
  for (const AgentAssignment& agent : target.dataset.agents) {
    shard_indices.push_back(agent.shard_indices);
  }
  return ActiveBlocksCache::KeyOf(target.dataset.dataset.dataset_id(), shard_indices,
                                  frame::IsovaluesOf(spec));
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
                                                    const frame::FrameSpec& spec,
                                                    Delivery delivery) {
  if (absl::Status fits = memory_.CheckFits(spec, delivery); !fits.ok()) {
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
                                                    bool is_each_shard_apart,
                                                    const base::TraceContext& identity,
                                                    const base::Cancellation& cancellation,
                                                    const Caller& caller) {
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  ISOSCOPE_ASSIGN_OR_RETURN(DatasetState dataset, options_.registry->FindComplete(
                                                      request->dataset(), cancellation, caller));
  ISOSCOPE_RETURN_IF_ERROR(CheckBackEnd(*spec, dataset));
  ISOSCOPE_ASSIGN_OR_RETURN(const volume::GridGeometry geometry,
                            rpc::GeometryFromProto(dataset.dataset.geometry(), "dataset.geometry"));
  ISOSCOPE_ASSIGN_OR_RETURN(volume::BlockLayout layout, LayoutOf(dataset.dataset, geometry));
  ISOSCOPE_RETURN_IF_ERROR(
      PlaceCamera(dataset, geometry, layout, identity, cancellation, request, spec));
  ISOSCOPE_ASSIGN_OR_RETURN(
      view::View view, view::View::Make(*spec->camera, spec->viewport, geometry, spec->region));
  ISOSCOPE_RETURN_IF_ERROR(
      frame::CheckOwners(frame::OwnerSurfaceCount(*spec), layout.block_count()));
  if (is_each_shard_apart) {
    dataset.agents = EachShardApart(dataset.agents);
  }
  const frame::BackEnd drawn_by =
      frame::ShowsGradient(*spec) ? frame::BackEnd::kCpu : dataset.picture_revision.back_end;
  const image::FragmentOrder order{.block_count = static_cast<std::uint32_t>(layout.block_count()),
                                   .ties = frame::TieRuleOf(drawn_by)};
  return FrameTarget{std::move(dataset), std::move(view), std::move(layout), order};
}

absl::Status FrameRunner::PlaceCamera(const DatasetState& dataset,
                                      const volume::GridGeometry& geometry,
                                      const volume::BlockLayout& layout,
                                      const base::TraceContext& identity,
                                      const base::Cancellation& cancellation,
                                      isoscope::v1::RenderIsosurfaceRequest* request,
                                      frame::FrameSpec* spec) {
  std::optional<math::Box3d> surface_bounds;
  if (request->camera_fit() == isoscope::v1::CAMERA_FIT_SURFACE) {
    const QueryOutcome<std::optional<math::IndexBox>> outcome = AskActiveBox(
        dataset, layout, frame::IsovaluesOf(*spec), request->clip(), identity, cancellation);
    ReportFailures(identity, /*frame_number=*/0, outcome.failures);
    ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
    if (outcome.result->has_value()) {
      surface_bounds =
          view::ClippedBounds(view::BoundsOfCells(geometry, **outcome.result), spec->clip);
    }
  }
  return rpc::ResolveCamera(geometry.Bounds(), request, spec, surface_bounds);
}

absl::StatusOr<FrameResult> FrameRunner::Run(const FrameIdentity& identity,
                                             const isoscope::v1::RenderIsosurfaceRequest& request,
                                             const frame::FrameSpec& spec,
                                             const FrameTarget& target,
                                             const base::Cancellation& cancellation) {
  const DatasetState& dataset = target.dataset;
  const std::string active_key = ActiveKeyOf(target, spec);
  FrameSetup setup;
  setup.spec = &spec;
  setup.view = &target.view;
  setup.layout = &target.layout;
  setup.ties = target.order.ties;
  setup.agent_count = static_cast<int>(dataset.agents.size());
  setup.active = active_blocks_.Find(active_key);
  setup.images = images_.get();
  setup.arena = options_.arena.get();
  setup.trace = identity.trace;
  setup.step = identity.step;
  (setup.active != nullptr ? metrics_.active_blocks_hits : metrics_.active_blocks_misses).Add();
  internal::BeginFrame begin;
  begin.set_frame_number(identity.number);
  begin.set_dataset_id(dataset.dataset.dataset_id());
  *begin.mutable_request() = request;
  begin.set_agent_count(setup.agent_count);
  begin.set_report_active_blocks(setup.active == nullptr);
  begin.set_sends_normals(spec.sends_normals);
  begin.set_sends_map_steps(spec.sends_map_steps);
  std::size_t first_trace = 0;
  if (identity.trace != nullptr) {
    first_trace = identity.agent_traces->size();
    identity.agent_traces->resize(first_trace + dataset.agents.size());
  }
  const auto begin_on_agent =
      [&](int agent_index, AgentListener* listener) -> absl::StatusOr<std::unique_ptr<AgentLink>> {
    internal::BeginFrame of_agent = begin;
    of_agent.set_agent_index(agent_index);
    const auto index = static_cast<std::size_t>(agent_index);
    AgentTraceTarget trace_target;
    if (identity.trace != nullptr) {
      trace_target = {.zero = identity.trace_zero,
                      .trace = &(*identity.agent_traces)[first_trace + index]};
    }
    return BeginFrameOnAgent(dataset.agents[index], std::move(of_agent),
                             dataset.dataset.block_count(), cancellation.deadline(),
                             options_.mailboxes.get(), *identity.request, trace_target, listener);
  };
  FrameOutcome outcome = RunFrame(setup, begin_on_agent, cancellation);
  if (!outcome.status.ok()) {
    ReportFailures(*identity.request, identity.number, outcome.failures);
    return outcome.status;
  }
  if (setup.active == nullptr && outcome.result.active != nullptr) {
    active_blocks_.Insert(active_key, outcome.result.active);
  }
  return std::move(outcome.result);
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
  return gauges;
}

}  // namespace isoscope::server
