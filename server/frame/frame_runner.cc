// A frame of a call, after its ticket has a place:
//
// 1. FindTarget finds the dataset, chooses the replicas of each part, and resolves the camera; then
//    PlaceLevel chooses the level.
// 2. Attempt begins every part on an agent, runs RunFrame, and collects traces and active blocks.
// 3. Learn reports the agents to the replica board: done, failed, late, or the loser of a hedge.
// 4. If parts are lost and the request allows a partial picture, Run starts again without them.
//
// Invariant: `parts` keeps its order, so that a part's index is the same in RunFrame and in
// Attempt.

#include "server/frame/frame_runner.h"

#include <algorithm>
#include <deque>
#include <iterator>
#include <map>
#include <set>

#include "absl/strings/str_cat.h"

#include "core/base/error_reason.h"
#include "core/base/log.h"
#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/frame/drawn_window.h"
#include "core/picture/color_map.h"
#include "core/view/camera_fit.h"
#include "core/view/level_choice.h"
#include "core/volume/patient_frame.h"
#include "core/volume/volume_level.h"
#include "server/cluster/served_levels.h"
#include "server/frame/agent_call.h"
#include "server/frame/agent_client.h"
#include "server/frame/agent_queries.h"
#include "wire/frame_convert.h"
#include "wire/proto_convert.h"

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

bool ShowsPosition(const frame::ColorBy& color_by) {
  using Quantity = frame::ColorBy::Quantity;
  return color_by.quantity == Quantity::kPositionX || color_by.quantity == Quantity::kPositionY ||
         color_by.quantity == Quantity::kPositionZ;
}

// The finest level of at most CoarserLevel::kQuickSampleCount samples.
int QuickLevelOf(const math::Index3& dims) {
  double sample_count =
      static_cast<double>(dims.x) * static_cast<double>(dims.y) * static_cast<double>(dims.z);
  int level = 0;
  while (sample_count > static_cast<double>(CoarserLevel::kQuickSampleCount)) {
    sample_count /= 8;
    ++level;
  }
  return level;
}

std::string ActiveKeyOf(const FrameTarget& target, const std::vector<FramePart>& parts,
                        const frame::FrameSpec& spec) {
  std::vector<std::vector<int>> shard_indices;
  shard_indices.reserve(parts.size());
  for (const FramePart& part : parts) {
    shard_indices.push_back(part.shard_indices);
  }
  return ActiveBlocksCache::KeyOf(target.dataset->dataset.dataset_id(), target.level, shard_indices,
                                  frame::RulesOf(spec));
}

}  // namespace

bool MayWorkSmaller(const absl::Status& status) {
  return absl::IsResourceExhausted(status) &&
         base::ReasonOf(status) == base::ErrorReason::kTooLarge;
}

absl::StatusOr<volume::BlockLayout> LayoutOf(const isoscope::v1::Dataset& dataset,
                                             const volume::GridGeometry& grid) {
  const isoscope::v1::Dimensions& cells = dataset.block_cells();
  return volume::BlockLayout::Make(grid.sample_dims, {cells.x(), cells.y(), cells.z()});
}

volume::GridGeometry GridOfLevel(const volume::GridGeometry& whole, int level) {
  // Type and filter do not change the grid.
  return volume::LevelOf(whole, volume::ScalarType::kUint8, volume::LevelFilter::kMean, level).grid;
}

absl::StatusOr<view::View> FrameTarget::ViewOf(const view::Camera& camera,
                                               const view::Viewport& viewport,
                                               const std::optional<view::Region>& region) const {
  ISOSCOPE_ASSIGN_OR_RETURN(view::View of_whole, view::View::Make(camera, viewport, whole, region));
  if (level == 0) {
    return of_whole;
  }
  return of_whole.OnGrid(GridOfLevel(whole, level));
}

absl::StatusOr<FrameTarget> FrameRunner::Prepare(FrameTicket* ticket, AskedFrame* asked,
                                                 base::TraceRecorder* trace,
                                                 const std::optional<CoarserLevel>& coarser) {
  {
    const base::TraceScope scope(trace, "memory");
    ISOSCOPE_RETURN_IF_ERROR(ticket->TakeMemory(asked->spec));
  }
  const base::TraceScope scope(trace, "find dataset");
  ISOSCOPE_ASSIGN_OR_RETURN(FrameTarget target, FindTarget(ticket->Identity(), asked, coarser));
  ticket->NoteDataset(target.dataset->dataset);
  return target;
}

absl::StatusOr<FrameTarget> FrameRunner::FindTarget(const FrameIdentity& identity,
                                                    AskedFrame* asked,
                                                    const std::optional<CoarserLevel>& coarser) {
  ISOSCOPE_RETURN_IF_ERROR(identity.cancellation->Check());
  const frame::FrameSpec& spec = asked->spec;
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const DatasetState> found,
                            state_.registry->FindComplete(asked->dataset, *identity.cancellation,
                                                          *identity.caller, asked->allow_partial));
  ISOSCOPE_RETURN_IF_ERROR(CheckDatasetId(found->dataset, asked->dataset_id));
  ISOSCOPE_ASSIGN_OR_RETURN(
      SelectedVolume selected,
      SelectVolume(found, asked->selection.has_value() ? &*asked->selection : nullptr,
                   &asked->spec.surfaces, asked->with_all_fields));
  const DatasetState& dataset = *selected.dataset;
  const std::string& id = dataset.dataset.dataset_id();
  ISOSCOPE_RETURN_IF_ERROR(CheckBackEnd(spec, dataset));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::GridGeometry geometry,
      wire::GeometryFromProto(dataset.dataset.geometry(), "dataset.geometry"));
  ISOSCOPE_ASSIGN_OR_RETURN(volume::BlockLayout layout, LayoutOf(dataset.dataset, geometry));
  std::vector<FramePart> parts =
      state_.replicas.Choose(dataset.replica_sets, ReplicaKeyOf(id, frame::RulesOf(spec)));
  ISOSCOPE_RETURN_IF_ERROR(PlaceCamera(identity, {id, parts, state_.NextTurn()}, dataset.dataset,
                                       geometry, layout, asked));
  ISOSCOPE_ASSIGN_OR_RETURN(view::View view,
                            view::View::Make(*spec.camera, spec.viewport, geometry, spec.region));
  const frame::BackEnd drawn_by = frame::DrawnBy(spec, dataset.picture_revision.back_end);
  const image::FragmentOrder order{.block_count = static_cast<std::uint32_t>(layout.block_count()),
                                   .ties = frame::TieRuleOf(drawn_by)};
  std::shared_ptr<const DatasetState> of_volume = selected.dataset;
  FrameTarget target{std::move(of_volume), std::move(parts), view, layout, order,
                     std::move(selected),  geometry};
  ISOSCOPE_RETURN_IF_ERROR(PlaceLevel(coarser, asked, &target));
  ISOSCOPE_RETURN_IF_ERROR(
      frame::CheckOwners(frame::OwnerSurfaceCount(spec), target.layout.block_count()));
  return target;
}

absl::Status FrameRunner::PlaceLevel(const std::optional<CoarserLevel>& coarser, AskedFrame* asked,
                                     FrameTarget* target) {
  asked->spec.level = 0;
  if (!asked->level.has_value() && !coarser.has_value()) {
    return absl::OkStatus();
  }
  const DatasetState& dataset = *target->dataset;
  const std::vector<volume::InsideRule> rules = frame::RulesOf(asked->spec);
  const double pixels_per_unit = view::PixelsPerUnit(target->view, asked->spec.clip.box);
  const ServedLevel* chosen = nullptr;
  if (asked->level.has_value()) {
    ISOSCOPE_ASSIGN_OR_RETURN(chosen, ChooseLevel(dataset.levels, dataset.dataset, target->whole,
                                                  rules, *asked->level, pixels_per_unit));
  }
  target->asked_level = chosen == nullptr ? 0 : chosen->level;
  target->coarsest_level = std::max(CoarsestOf(dataset.levels, rules), target->asked_level);
  if (coarser.has_value()) {
    chosen = CoarserOf(dataset.levels, rules, chosen,
                       coarser->least.value_or(QuickLevelOf(target->whole.sample_dims)));
  }
  target->level = chosen == nullptr ? 0 : chosen->level;
  asked->spec.level = target->level;
  const volume::GridGeometry grid = GridOfLevel(target->whole, target->level);
  target->spacing_px = view::SpacingPx(grid, pixels_per_unit);
  if (chosen == nullptr) {
    return absl::OkStatus();
  }
  target->parts = state_.replicas.Choose(chosen->replica_sets,
                                         ReplicaKeyOf(dataset.dataset.dataset_id(), rules));
  ISOSCOPE_ASSIGN_OR_RETURN(target->layout, LayoutOf(dataset.dataset, grid));
  target->order.block_count = static_cast<std::uint32_t>(target->layout.block_count());
  ISOSCOPE_ASSIGN_OR_RETURN(target->view, target->view.OnGrid(grid));
  // Colours of a position show the box of the samples, at every level.
  for (frame::Surface& surface : asked->spec.surfaces) {
    if (surface.color_by.has_value() && ShowsPosition(*surface.color_by)) {
      surface.color_by->range = picture::ColorRangeOf(*surface.color_by, target->whole);
    }
  }
  return absl::OkStatus();
}

absl::Status FrameRunner::PlaceCamera(const FrameIdentity& identity, const QueryTarget& query,
                                      const isoscope::v1::Dataset& dataset,
                                      const volume::GridGeometry& geometry,
                                      const volume::BlockLayout& layout, AskedFrame* asked) {
  const auto bounds_of = [&](const math::IndexBox& cells) {
    return view::ClippedBounds(view::BoundsOfCells(geometry, cells), asked->spec.clip);
  };
  if (asked->fit == isoscope::v1::CAMERA_FIT_CELLS) {
    ISOSCOPE_ASSIGN_OR_RETURN(const CellBoxCache::CellBox cells,
                              FindCellBox(identity, query, dataset.shard_count(), layout, *asked));
    std::optional<volume::PatientFrame> patient_frame;
    if (!dataset.patient_frame().empty()) {
      ISOSCOPE_ASSIGN_OR_RETURN(patient_frame,
                                volume::PatientFrame::FromName(dataset.patient_frame()));
    }
    return wire::ResolveCellsCamera(
        geometry.Bounds(),
        cells.has_value() ? std::optional<math::Box3d>(bounds_of(*cells)) : std::nullopt,
        patient_frame, asked->fit_viewport, &asked->spec);
  }
  std::optional<math::Box3d> surface_bounds;
  if (asked->fit == isoscope::v1::CAMERA_FIT_SURFACE) {
    const QueryOutcome<ActiveExtent> outcome =
        AskActiveBox(query, layout, frame::RulesOf(asked->spec), asked->spec.clip,
                     *identity.request, *identity.cancellation);
    state_.ReportQuery(*identity.request, outcome.report);
    ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
    if (outcome.result->cells.has_value()) {
      surface_bounds = bounds_of(*outcome.result->cells);
    }
  }
  return wire::ResolveCamera(geometry.Bounds(), &asked->spec, surface_bounds);
}

absl::StatusOr<CellBoxCache::CellBox> FrameRunner::FindCellBox(const FrameIdentity& identity,
                                                               const QueryTarget& query,
                                                               int shard_count,
                                                               const volume::BlockLayout& layout,
                                                               const AskedFrame& asked) {
  const std::vector<volume::InsideRule> rules = frame::RulesOf(asked.spec);
  const view::ClipRegion& clip = asked.spec.clip;
  const std::string key = CellBoxCache::KeyOf(query.dataset_id, rules, clip);
  if (const std::shared_ptr<const CellBoxCache::CellBox> known = cell_boxes_.Find(key)) {
    return *known;
  }
  QueryOutcome<CellBoxCache::CellBox> outcome =
      AskCellBox(query, layout, rules, clip, *identity.request, *identity.cancellation);
  state_.ReportQuery(*identity.request, outcome.report);
  const absl::Status& status = outcome.result.status();
  if (asked.allow_partial && LacksParts(status)) {
    return std::nullopt;  // the picture will lack the shards of that agent
  }
  // Without some shards the box is that of the others.
  if (status.ok() && MissingShards(shard_count, query.parts).empty()) {
    cell_boxes_.Insert(key, *outcome.result);
  }
  return std::move(outcome.result);
}

absl::StatusOr<std::int64_t> FrameRunner::FindActiveBytes(const FrameIdentity& identity,
                                                          const frame::FrameSpec& spec,
                                                          const FrameTarget& target) {
  const std::string& dataset_id = target.dataset->dataset.dataset_id();
  const std::vector<volume::InsideRule> rules = frame::RulesOf(spec);
  const std::string key = ActiveCounts::KeyOf(dataset_id, target.level, rules, spec.clip);
  if (const std::optional<std::int64_t> known = active_counts_.Find(key)) {
    return BytesOfBlocks(target, *known);
  }
  const QueryOutcome<ActiveExtent> outcome =
      AskActiveBox({dataset_id, target.parts, state_.NextTurn(), target.level}, target.layout,
                   rules, spec.clip, *identity.request, *identity.cancellation);
  state_.ReportQuery(*identity.request, outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  active_counts_.Insert(key, outcome.result->active_block_count);
  return BytesOfBlocks(target, outcome.result->active_block_count);
}

// A block has a sample more than cells on each axis, and a ghost on each side.
std::int64_t BytesOfBlocks(const FrameTarget& target, std::int64_t block_count) {
  const isoscope::v1::Dataset& dataset = target.dataset->dataset;
  constexpr std::int64_t kBesides = 3;
  const isoscope::v1::Dimensions& cells = dataset.block_cells();
  const std::int64_t samples =
      (cells.x() + kBesides) * (cells.y() + kBesides) * (cells.z() + kBesides);
  const absl::StatusOr<volume::ScalarType> type =
      wire::ScalarTypeFromProto(dataset.sample_type(), "sample_type");
  if (!type.ok()) {
    return block_count * samples;
  }
  const auto served =
      std::find_if(target.dataset->levels.begin(), target.dataset->levels.end(),
                   [&](const ServedLevel& of_dataset) { return of_dataset.level == target.level; });
  const volume::ScalarType of_level =
      served == target.dataset->levels.end()
          ? *type
          : volume::LevelOf(target.whole, *type, served->filter, served->level).type;
  return block_count * samples * static_cast<std::int64_t>(volume::SizeOf(of_level));
}

// One try of a frame with some parts: begins them on agents, and records the agents' success.
class FrameRunner::Attempt {
 public:
  // All of them outlive the attempt.
  Attempt(FrameRunner* runner, const FrameIdentity& identity, const AskedFrame& asked,
          const FrameTarget& target, const std::vector<FramePart>& parts,
          const DrawingContext& context)
      : runner_(*runner),
        identity_(identity),
        spec_(asked.spec),
        target_(target),
        parts_(parts),
        context_(context),
        active_key_(ActiveKeyOf(target, parts, asked.spec)),
        active_(runner->active_blocks_.Find(active_key_)) {
    begin_.set_frame_number(identity.number);
    begin_.set_dataset_id(target.dataset->dataset.dataset_id());
    *begin_.mutable_frame() = wire::ToProto(spec_);
    begin_.set_with_trace(identity.trace != nullptr);
    begin_.mutable_color_dataset_ids()->Assign(target.selected.color_dataset_ids.begin(),
                                               target.selected.color_dataset_ids.end());
    begin_.set_agent_count(static_cast<std::int32_t>(parts.size()));
    begin_.set_report_active_blocks(active_ == nullptr);
    begin_.set_others_follow(context.others_follow);
  }

  // With an error, `lost_parts` are those of FrameOutcome.
  absl::StatusOr<FrameResult> Run(std::vector<std::size_t>* lost_parts) {
    FrameOutcome outcome = RunFrame(
        Setup(),
        [this](int part, int replica, AgentListener* listener) {
          return Begin(static_cast<std::size_t>(part), static_cast<std::size_t>(replica), listener);
        },
        *identity_.cancellation);
    Learn(outcome);
    *lost_parts = outcome.lost_parts;
    if (!outcome.status.ok()) {
      return outcome.status;
    }
    if (identity_.trace != nullptr) {
      identity_.agent_traces->insert(identity_.agent_traces->end(),
                                     std::make_move_iterator(traces_.begin()),
                                     std::make_move_iterator(traces_.end()));
    }
    if (active_ == nullptr && outcome.result.active != nullptr) {
      runner_.active_blocks_.Insert(active_key_, outcome.result.active);
    }
    return std::move(outcome.result);
  }

 private:
  [[nodiscard]] const std::string& AddressOf(int part, int replica) const {
    return parts_[static_cast<std::size_t>(part)]
        .replicas[static_cast<std::size_t>(replica)]
        .address;
  }

  FrameSetup Setup() {
    FrameSetup setup;
    setup.spec = &spec_;
    setup.view = &target_.view;
    setup.layout = &target_.layout;
    setup.ties = target_.order.ties;
    setup.active = active_;
    setup.max_waiting_bytes = WaitingBandBytes(spec_);
    setup.images = runner_.state_.images.get();
    setup.arena = runner_.state_.arena.get();
    setup.trace = identity_.trace;
    setup.keeps_blocks = context_.drawn != nullptr;
    setup.phase = identity_.phase;
    for (const FramePart& part : parts_) {
      setup.replica_counts.push_back(static_cast<int>(part.replicas.size()));
    }
    setup.is_lost = [this](int part, int replica) {
      return !runner_.state_.registry->IsReachable(AddressOf(part, replica));
    };
    setup.may_hedge = [this](int part, int replica) {
      if (!runner_.state_.replicas.TryHedge(AddressOf(part, replica))) {
        return false;
      }
      slow_.insert(AddressOf(part, replica - 1));
      return true;
    };
    return setup;
  }

  absl::StatusOr<std::unique_ptr<AgentLink>> Begin(std::size_t part, std::size_t replica,
                                                   AgentListener* listener) {
    internal::BeginFrame of_part = begin_;
    of_part.set_agent_index(static_cast<std::int32_t>(part));
    SetCounted(part, &of_part);
    const AgentAssignment agent = parts_[part].On(replica);
    AgentTraceTarget trace_target;
    if (identity_.trace != nullptr) {
      trace_target = {.zero = identity_.trace_zero,
                      .trace = &traces_.emplace_back(),
                      .max_spans = runner_.state_.memory.max_trace_spans() / 4 * 3 / parts_.size() /
                                   static_cast<std::size_t>(context_.drawing_count)};
    }
    leases_.push_back(runner_.state_.replicas.Take(agent.address));
    begins_.emplace(agent.address, base::MonotonicNow());
    if (context_.following != nullptr) {
      context_.following->Note(agent, context_.others_follow);
    }
    return BeginFrameOnAgent(agent, std::move(of_part), target_.layout.block_count(),
                             identity_.cancellation->deadline(), runner_.state_.mailboxes.get(),
                             *identity_.request, trace_target, listener);
  }

  // A field that is not needed is not set: agents of older versions refuse it.
  void SetCounted(std::size_t part, internal::BeginFrame* begin) const {
    if (context_.drawn == nullptr) {
      return;
    }
    if (const auto blocks = context_.drawn->OpaqueOf(part); !blocks.empty()) {
      *begin->mutable_counted_blocks() = wire::ToProto(blocks);
    }
    if (!frame::HasLayers(spec_)) {
      return;
    }
    if (const auto blocks = context_.drawn->TranslucentOf(part); !blocks.empty()) {
      *begin->mutable_counted_layer_blocks() = wire::ToProto(blocks);
    }
  }

  // Records which agents succeeded, so that the next frames prefer those.
  void Learn(const FrameOutcome& outcome) {
    using PartOutcome = AgentMetrics::PartOutcome;
    AgentMetrics& metrics = runner_.state_.agent_metrics;
    runner_.state_.ReportFailures(*identity_.request, identity_.number, outcome.failures);
    metrics.hedged.Add(outcome.hedge_count);
    metrics.lost_hedges.Add(static_cast<std::int64_t>(outcome.lost_hedges.size()));
    if (outcome.status.ok()) {
      metrics.repeated.Add(static_cast<std::int64_t>(outcome.failures.size()));
      for (const frame::AgentStatistics& agent : outcome.result.agents) {
        runner_.state_.replicas.NoteSuccess(agent.agent_address);
        metrics.CountPart(agent.agent_address, PartOutcome::kDone);
      }
    }
    for (const AgentFailure& failure : outcome.failures) {
      if (!MayWorkSmaller(failure.status)) {
        NoteTrouble(failure.agent.address, absl::IsDeadlineExceeded(failure.status));
      }
      metrics.CountPart(failure.agent.address, PartOutcome::kFailed);
    }
    for (const AgentIdentity& agent : outcome.lost_hedges) {
      NoteTrouble(agent.address, /*is_only_late=*/true);
      metrics.CountPart(agent.address, PartOutcome::kLostHedge);
      LogLostHedge(*identity_.request, identity_.number, agent);
    }
  }

  // An agent that is only late is in no trouble, unless others were faster or it is lost.
  void NoteTrouble(const std::string& address, bool is_only_late) {
    const base::MonotonicTime now = base::MonotonicNow();
    const auto begin = begins_.find(address);
    if (!is_only_late || slow_.contains(address) ||
        !runner_.state_.registry->IsReachable(address)) {
      runner_.state_.replicas.NoteTrouble(address, now);
    } else if (begin != begins_.end()) {
      runner_.state_.replicas.NoteUnanswered(address, now - begin->second, now);
    }
  }

  FrameRunner& runner_;
  const FrameIdentity& identity_;
  const frame::FrameSpec& spec_;
  const FrameTarget& target_;
  const std::vector<FramePart>& parts_;
  const DrawingContext& context_;
  const std::string active_key_;
  const std::shared_ptr<const ActiveBlocks> active_;
  internal::BeginFrame begin_;                     // without the fields of a part
  std::deque<isoscope::v1::ProcessTrace> traces_;  // each keeps its address
  std::vector<ReplicaBoard::Lease> leases_;
  std::map<std::string, base::MonotonicTime> begins_;  // of the first try on each agent, by address
  std::set<std::string> slow_;                         // addresses of agents that a replica outran
};

absl::StatusOr<FrameResult> FrameRunner::Run(const FrameIdentity& identity, const AskedFrame& asked,
                                             const FrameTarget& target,
                                             std::vector<FramePart>* parts,
                                             const DrawingContext& context) {
  while (true) {
    std::vector<std::size_t> lost_parts;
    absl::StatusOr<FrameResult> result =
        Attempt(this, identity, asked, target, *parts, context).Run(&lost_parts);
    const bool goes_on =
        asked.allow_partial && !lost_parts.empty() && lost_parts.size() < parts->size();
    if (!goes_on) {
      return result;
    }
    // Starts again with an empty image: a lost part has left some of its pixels in the picture.
    std::reverse(lost_parts.begin(), lost_parts.end());  // keeps the other indices valid
    for (const std::size_t lost : lost_parts) {
      parts->erase(parts->begin() + static_cast<std::ptrdiff_t>(lost));
    }
  }
}

void FrameRunner::EndCalls(const FrameIdentity& identity, FollowingCalls* following) {
  frame_ends_.Tell(following, *identity.request, identity.number);
}

absl::Status FrameRunner::AddMissingShards(const FrameIdentity& identity, const AskedFrame& asked,
                                           const FrameTarget& target,
                                           const std::vector<FramePart>& parts, FrameCost* cost) {
  const isoscope::v1::Dataset& dataset = target.dataset->dataset;
  const std::vector<int> missing = MissingShards(dataset.shard_count(), parts);
  if (missing.empty()) {
    return absl::OkStatus();
  }
  const QueryOutcome<ActiveExtent> outcome = AskActiveBox(
      {dataset.dataset_id(), parts, state_.NextTurn(), target.level}, target.layout,
      frame::RulesOf(asked.spec), asked.spec.clip, *identity.request, *identity.cancellation);
  state_.ReportQuery(*identity.request, outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  const auto all = static_cast<double>(outcome.result->active_block_count);
  cost->missing_shards = missing;
  cost->active_block_coverage =
      all == 0 ? 1.0 : static_cast<double>(cost->total.active_block_count) / all;
  state_.frame_metrics.partial.Add();
  return absl::OkStatus();
}

}  // namespace isoscope::server
