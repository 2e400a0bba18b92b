// A frame runs on one thread, which waits for the events of the agents. Each agent is at a stage. A
// step of the frame begins when the last agent has reached its stage.
//
//   event           allowed at           then                 when all agents are there
//   ray hits        kSelectingOccluders  kRenderingOccluders  union of the hits; each agent gets
//                                                             its occluding blocks
//   pixels          kRenderingOccluders  the arena            -
//                   kRenderingVisible    composites them
//   occluders done  kRenderingOccluders  kRenderingVisible    occlusion map; each agent gets its
//                                                             blocks that are not hidden
//   frame done      kRenderingVisible    kDone                -
//   end, OK         kDone                kEnded               the frame is complete
//   end, error      any                  the frame fails
//
// Any other event breaks the protocol: INTERNAL. With Culling::kNone agents begin at
// kRenderingVisible. A frame that fails cancels all agents and waits until their streams have
// ended, so that nobody works for it when RunFrame returns.

#include "server/frame_coordinator.h"

#include <algorithm>
#include <deque>
#include <iterator>
#include <new>
#include <string>
#include <utility>
#include <variant>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "absl/types/span.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_group.h>

#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/trace_recorder.h"
#include "core/composite/depth_composite.h"
#include "core/composite/pixel_codec.h"
#include "core/view/clip_region.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_pixels.h"

namespace isoscope::server {
namespace {

// One task tests this many blocks, in some hundred microseconds.
constexpr std::size_t kBlocksPerTask = 512;

struct RayHits {
  std::vector<volume::BlockId> hits;
  std::vector<volume::BlockId> active;
};
struct Pixels {
  std::vector<std::string> bands;
};
struct DrawnPixels {
  image::DrawnPixels pixels;
};
struct OccludersDone {};
struct PixelsDamaged {};  // from the thread that decoded them
struct FrameDone {
  frame::AgentStatistics statistics;
};
struct End {
  absl::Status status;
};

struct Event {
  std::size_t agent_index = 0;
  absl::Time arrival;
  std::variant<RayHits, Pixels, DrawnPixels, OccludersDone, PixelsDamaged, FrameDone, End> what;
};

// The events of the agents, in order of arrival. Thread-safe.
class EventQueue {
 public:
  void Push(Event event) ABSL_LOCKS_EXCLUDED(mutex_) {
    {
      const base::MutexLock lock(&mutex_);
      events_.push_back(std::move(event));
    }
    // Without the mutex, which the woken thread needs at once. The queue outlives all pushes.
    arrived_.Signal();
  }

  // Waits for an event and returns all that have come. Returns the cancellation's error if it fires
  // first.
  absl::StatusOr<std::deque<Event>> PopAll(const base::Cancellation& cancellation)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    std::deque<Event> events;
    ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(cancellation, &mutex_, &arrived_,
                                                    [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
                                                      events.swap(events_);
                                                      return !events.empty();
                                                    }));
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    return events;
  }

 private:
  base::Mutex mutex_;
  base::CondVar arrived_;
  std::deque<Event> events_ ABSL_GUARDED_BY(mutex_);
};

class QueueingListener final : public AgentListener {
 public:
  QueueingListener(std::size_t agent_index, EventQueue* queue)
      : agent_index_(agent_index), queue_(queue) {}

  void OnRayHits(std::vector<volume::BlockId> hits, std::vector<volume::BlockId> active) override {
    Push(RayHits{std::move(hits), std::move(active)});
  }
  void OnPixels(std::vector<std::string> bands) override { Push(Pixels{std::move(bands)}); }
  void OnDrawnPixels(image::DrawnPixels pixels) override { Push(DrawnPixels{std::move(pixels)}); }
  void OnOccludersDone() override { Push(OccludersDone{}); }
  void OnFrameDone(frame::AgentStatistics statistics) override {
    Push(FrameDone{std::move(statistics)});
  }
  void OnEnd(absl::Status status) override { Push(End{std::move(status)}); }

 private:
  template <typename T>
  void Push(T what) {
    queue_->Push({agent_index_, absl::Now(), std::move(what)});
  }

  const std::size_t agent_index_;
  EventQueue* const queue_;
};

class Frame {
 public:
  Frame(const FrameSetup& setup, const base::Cancellation& cancellation, image::FrameImage image)
      : setup_(setup),
        cancellation_(cancellation),
        order_{.block_count = static_cast<std::uint32_t>(setup.layout->block_count()),
               .ties = setup.ties},
        clipper_(setup.spec->clip, setup.view->geometry()),
        has_layers_(frame::HasLayers(*setup.spec)),
        start_(absl::Now()),
        row_locks_(setup.view->image_size().height_px) {
    result_.image = std::move(image);
    if (has_layers_) {
      result_.layers =
          image::LayerStack(result_.image.width, result_.image.height, setup.spec->max_layers + 1,
                            {.block_count = order_.block_count}, setup.images);
    }
  }

  FrameOutcome Run(const BeginAgentFrame& begin) {
    absl::Status status = BeginAndDrive(begin);
    if (!status.ok()) {
      for (Agent& agent : agents_) {
        agent.link->Cancel();
      }
      FinishCompositing().IgnoreError();
    }
    for (const Agent& agent : agents_) {
      result_.network_bytes += agent.link->network_bytes();
    }
    {
      const base::TraceScope trace(setup_.trace, "end streams");
      agents_.clear();
    }
    if (!status.ok()) {
      return {.status = std::move(status), .result = {}, .failures = std::move(failures_)};
    }
    result_.composite_duration = absl::Now() - phase_start_;
    std::sort(result_.agents.begin(), result_.agents.end(),
              [](const frame::AgentStatistics& a, const frame::AgentStatistics& b) {
                return a.shard_indices < b.shard_indices;
              });
    return {.status = absl::OkStatus(), .result = std::move(result_), .failures = {}};
  }

 private:
  struct Agent {
    std::unique_ptr<QueueingListener> listener;  // outlives the link
    std::unique_ptr<AgentLink> link;
    FrameStage stage = FrameStage::kSelectingOccluders;
  };

  absl::Status BeginAndDrive(const BeginAgentFrame& begin) {
    phase_start_ = start_;
    BeginPhase(setup_.spec->culling == frame::Culling::kNone ? FrameStep::kVisibilityCulling
                                                             : FrameStep::kOccluderSelection);
    reported_.resize(static_cast<std::size_t>(setup_.agent_count));
    for (int i = 0; i < setup_.agent_count; ++i) {
      Agent agent;
      agent.listener = std::make_unique<QueueingListener>(static_cast<std::size_t>(i), &queue_);
      agent.stage = setup_.spec->culling == frame::Culling::kNone ? FrameStage::kRenderingVisible
                                                                  : FrameStage::kSelectingOccluders;
      ISOSCOPE_ASSIGN_OR_RETURN(agent.link, begin(i, agent.listener.get()));
      agents_.push_back(std::move(agent));
    }
    if (setup_.active != nullptr && setup_.spec->culling != frame::Culling::kNone) {
      FindFootprints(*setup_.active);  // while the agents cast rays
    }
    while (!AllAt(FrameStage::kEnded)) {
      base::TraceScope wait(setup_.trace, "wait for agents");
      absl::StatusOr<std::deque<Event>> events = queue_.PopAll(cancellation_);
      wait.End();
      if (!events.ok()) {
        return absl::IsDeadlineExceeded(events.status()) ? DeadlineError() : events.status();
      }
      for (Event& event : *events) {
        ISOSCOPE_RETURN_IF_ERROR(Handle(std::move(event)));
      }
    }
    return FinishCompositing();
  }

  absl::Status Handle(Event event) {
    const std::size_t agent_index = event.agent_index;
    Agent& agent = agents_[agent_index];
    last_arrival_ = event.arrival;
    if (auto* hits = std::get_if<RayHits>(&event.what)) {
      return HandleRayHits(agent_index, std::move(*hits));
    }
    if (auto* pixels = std::get_if<Pixels>(&event.what)) {
      return HandlePixels(agent_index, std::move(pixels->bands));
    }
    if (auto* drawn = std::get_if<DrawnPixels>(&event.what)) {
      return HandleDrawnPixels(agent_index, std::move(drawn->pixels));
    }
    if (std::holds_alternative<OccludersDone>(event.what)) {
      return HandleOccludersDone(agent_index);
    }
    if (std::holds_alternative<PixelsDamaged>(event.what)) {
      return FinishCompositing();
    }
    if (auto* done = std::get_if<FrameDone>(&event.what)) {
      if (!IsAt(agent, FrameStage::kRenderingVisible)) {
        return OutOfOrder(agent_index, "the end of the frame");
      }
      agent.stage = FrameStage::kDone;
      result_.agents.push_back(std::move(done->statistics));
      if (AllAt(FrameStage::kDone)) {
        EndPhase(&result_.visibility_culling_duration, "visibility culling", FrameStep::kFinishing);
      }
      return absl::OkStatus();
    }
    const absl::Status& status = std::get<End>(event.what).status;
    if (absl::IsDeadlineExceeded(status)) {
      return DeadlineError();
    }
    if (!status.ok()) {
      return Fail(agent_index, status);
    }
    if (agent.stage != FrameStage::kDone) {
      return OutOfOrder(agent_index, "the end of the stream");
    }
    agent.stage = FrameStage::kEnded;
    return absl::OkStatus();
  }

  // Lets the arena composite the bands while others arrive.
  absl::Status HandlePixels(std::size_t agent_index, std::vector<std::string> bands) {
    const Agent& agent = agents_[agent_index];
    if (!IsAt(agent, FrameStage::kRenderingOccluders) &&
        !IsAt(agent, FrameStage::kRenderingVisible)) {
      return OutOfOrder(agent_index, "pixels");
    }
    is_composited_into_ = true;
    setup_.arena->execute([&] {
      for (std::string& band : bands) {
        compositing_.run(
            [this, agent_index, owned = std::move(band)] { CompositeBand(agent_index, owned); });
      }
    });
    return absl::OkStatus();
  }

  // The first image becomes the result; the arena composites others into it.
  absl::Status HandleDrawnPixels(std::size_t agent_index, image::DrawnPixels pixels) {
    const Agent& agent = agents_[agent_index];
    if (!IsAt(agent, FrameStage::kRenderingOccluders) &&
        !IsAt(agent, FrameStage::kRenderingVisible)) {
      return OutOfOrder(agent_index, "pixels");
    }
    if (pixels.image.width != result_.image.width || pixels.image.height != result_.image.height) {
      return Fail(agent_index,
                  absl::InternalError(absl::StrFormat("drew %d x %d pixels of %d x %d",
                                                      pixels.image.width, pixels.image.height,
                                                      result_.image.width, result_.image.height)));
    }
    if (!std::exchange(is_composited_into_, true)) {
      std::swap(result_.image, pixels.image);
      if (!has_layers_) {
        return absl::OkStatus();
      }
    }
    setup_.arena->execute([&] {
      compositing_.run(
          [this, agent_index, owned = std::make_shared<image::DrawnPixels>(std::move(pixels))] {
            CompositeDrawn(agent_index, *owned);
          });
    });
    return absl::OkStatus();
  }

  void CompositeDrawn(std::size_t agent_index, const image::DrawnPixels& pixels) {
    try {
      tbb::parallel_for(0, pixels.image.touched.rows(), [&](int row) {
        const base::MutexLock lock(&row_locks_.OfTileRow(row));
        composite::CompositeTileRowInto(pixels.image, row, order_, &result_.image);
        if (has_layers_) {
          composite::CompositeTileRowInto(pixels.layers, row, &result_.layers);
        }
      });
    } catch (const std::bad_alloc&) {
      ReportDamage(agent_index, NoMemoryForLayers());
    }
  }

  static absl::Status NoMemoryForLayers() {
    return absl::ResourceExhaustedError("the coordinator has no memory for more layers");
  }

  void CompositeBand(std::size_t agent_index, absl::string_view band) {
    const base::TraceScope trace(setup_.trace, "composite");
    absl::Status status;
    try {
      status = composite::DecodePixelsInto(band, order_, &result_.image, &row_locks_,
                                           has_layers_ ? &result_.layers : nullptr);
    } catch (const std::bad_alloc&) {
      status = NoMemoryForLayers();
    }
    if (!status.ok()) {
      ReportDamage(agent_index, status);
    }
  }

  void ReportDamage(std::size_t agent_index, const absl::Status& status)
      ABSL_LOCKS_EXCLUDED(damage_mutex_) {
    const base::MutexLock lock(&damage_mutex_);
    if (damage_.ok()) {
      damage_ = {status.code(), absl::StrCat("pixels: ", status.message())};
      damaging_agent_ = agent_index;
      queue_.Push({agent_index, absl::Now(), PixelsDamaged{}});
    }
  }

  // Returns once all bands that have arrived are in the image.
  absl::Status FinishCompositing() ABSL_LOCKS_EXCLUDED(damage_mutex_) {
    {
      const base::TraceScope trace(setup_.trace, "finish compositing");
      setup_.arena->execute([&] { compositing_.wait(); });
    }
    absl::Status damage;
    std::size_t agent_index = 0;
    {
      const base::MutexLock lock(&damage_mutex_);
      damage = std::exchange(damage_, absl::OkStatus());
      agent_index = damaging_agent_;
    }
    return damage.ok() ? damage : Fail(agent_index, damage);
  }

  absl::Status HandleRayHits(std::size_t agent_index, RayHits hits) {
    Agent& agent = agents_[agent_index];
    if (agent.stage != FrameStage::kSelectingOccluders) {
      return OutOfOrder(agent_index, "ray hits");
    }
    agent.stage = FrameStage::kRenderingOccluders;
    hits_ = visibility::UnionOfHits(hits_, hits.hits);
    if (setup_.active == nullptr) {
      reported_[agent_index] = std::move(hits.active);
    }
    if (AllAt(FrameStage::kRenderingOccluders)) {
      result_.active = setup_.active != nullptr ? setup_.active
                                                : std::make_shared<const ActiveBlocks>(
                                                      reported_, setup_.layout->block_count());
      SendOccluders();
      EndPhase(&result_.occluder_selection_duration, "occluder selection",
               FrameStep::kOccluderRendering);
    }
    return absl::OkStatus();
  }

  void SendOccluders() {
    const base::TraceScope trace(setup_.trace, "find occluders");
    result_.ray_hit_block_count = static_cast<std::int64_t>(hits_.size());
    const ActiveBlocks& active = *result_.active;
    occluding_ = visibility::OccludingBlocks(hits_, *setup_.layout, active.set);
    if (footprints_.empty()) {
      FindFootprints(active);
    }
    const std::vector<AgentPart> parts =
        SelectBlocks([&](std::size_t active_index, AgentPart* part) {
          if (occluding_.Contains(active.ids[active_index]) &&
              !footprints_[active_index].rect.empty()) {
            part->blocks.push_back(active.ids[active_index]);
          }
        });
    for (std::size_t i = 0; i < agents_.size(); ++i) {
      agents_[i].link->SendOccluders(parts[i].blocks);
    }
  }

  [[nodiscard]] bool IsClipped(volume::BlockId id) const {
    return !clipper_.empty() &&
           clipper_.SideOf(*setup_.layout, id) == view::Clipper::Side::kOutside;
  }

  // Blocks that are wholly clipped have an empty footprint, and so are never drawn.
  void FindFootprints(const ActiveBlocks& active) {
    const base::TraceScope trace(setup_.trace, "footprints");
    footprints_.resize(active.ids.size());
    setup_.arena->execute([&] {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, active.ids.size(), kBlocksPerTask),
                        [&](const tbb::blocked_range<std::size_t>& range) {
                          setup_.view->FootprintsOf(
                              *setup_.layout,
                              absl::MakeSpan(active.ids).subspan(range.begin(), range.size()),
                              absl::MakeSpan(footprints_).subspan(range.begin(), range.size()));
                          for (std::size_t i = range.begin(); i < range.end(); ++i) {
                            if (IsClipped(active.ids[i])) {
                              footprints_[i].rect = {};
                            }
                          }
                        });
    });
  }

  // The part of one agent in a step: the blocks that it draws.
  struct AgentPart {
    std::vector<volume::BlockId> blocks;
    std::vector<image::PixelMask> open;  // the pixels that each could win; or none
  };

  // Calls select(active index, part to add it to) for every active block, in parallel, and joins
  // the parts of each agent in order.
  template <typename Fn>
  [[nodiscard]] std::vector<AgentPart> SelectBlocks(const Fn& select) const {
    const ActiveBlocks& active = *result_.active;
    struct Task {
      std::size_t agent_index = 0;
      std::size_t begin = 0;
      std::size_t end = 0;
      AgentPart part;
    };
    std::vector<Task> tasks;
    for (std::size_t i = 0; i < agents_.size(); ++i) {
      for (std::size_t begin = active.begin_by_agent[i]; begin < active.begin_by_agent[i + 1];
           begin += kBlocksPerTask) {
        tasks.push_back(
            {i, begin, std::min(begin + kBlocksPerTask, active.begin_by_agent[i + 1]), {}});
      }
    }
    setup_.arena->execute([&] {
      tbb::parallel_for(std::size_t{0}, tasks.size(), [&](std::size_t index) {
        Task& task = tasks[index];
        for (std::size_t active_index = task.begin; active_index < task.end; ++active_index) {
          select(active_index, &task.part);
        }
      });
    });
    std::vector<AgentPart> parts(agents_.size());
    for (Task& task : tasks) {
      AgentPart& part = parts[task.agent_index];
      part.blocks.insert(part.blocks.end(), task.part.blocks.begin(), task.part.blocks.end());
      std::move(task.part.open.begin(), task.part.open.end(), std::back_inserter(part.open));
    }
    return parts;
  }

  absl::Status HandleOccludersDone(std::size_t agent_index) {
    Agent& agent = agents_[agent_index];
    if (!IsAt(agent, FrameStage::kRenderingOccluders)) {
      return OutOfOrder(agent_index, "the end of the occluders");
    }
    agent.stage = FrameStage::kRenderingVisible;
    if (AllAt(FrameStage::kRenderingVisible)) {
      ISOSCOPE_RETURN_IF_ERROR(FinishCompositing());
      SendVisibleBlocks();
      EndPhase(&result_.occluder_rendering_duration, "occluder rendering",
               FrameStep::kVisibilityCulling);
    }
    return absl::OkStatus();
  }

  void SendVisibleBlocks() {
    const bool has_depth = setup_.spec->culling == frame::Culling::kDepth;
    const base::TraceScope trace(setup_.trace, "cull");
    const visibility::OcclusionMap map = setup_.arena->execute([&] {
      return visibility::OcclusionMap::FromImage(
          result_.image, has_depth ? visibility::MapKind::kDepth : visibility::MapKind::kMask);
    });
    const ActiveBlocks& active = *result_.active;
    const std::vector<AgentPart> parts =
        SelectBlocks([&](std::size_t active_index, AgentPart* part) {
          const view::Footprint& footprint = footprints_[active_index];
          const bool is_drawn = !has_layers_ && occluding_.Contains(active.ids[active_index]);
          if (is_drawn || footprint.rect.empty() || map.Hides(footprint)) {
            return;
          }
          part->blocks.push_back(active.ids[active_index]);
          // The 1-bit mask is the paper's: it culls blocks, not fragments.
          if (has_depth) {
            part->open.push_back(map.OpenPixels(footprint));
          }
        });
    for (std::size_t i = 0; i < agents_.size(); ++i) {
      agents_[i].link->SendVisibleBlocks(
          parts[i].blocks, has_depth ? visibility::EncodeOpenPixels(parts[i].open) : std::string());
    }
  }

  // Returns true if every agent is at `stage` or farther.
  [[nodiscard]] bool AllAt(FrameStage stage) const {
    return std::all_of(agents_.begin(), agents_.end(),
                       [stage](const Agent& agent) { return agent.stage >= stage; });
  }

  // Returns true if `agent` is at `stage` and was asked for it. A step begins once all agents are
  // there.
  [[nodiscard]] bool IsAt(const Agent& agent, FrameStage stage) const {
    return agent.stage == stage && AllAt(stage);
  }

  void BeginPhase(FrameStep step) {
    if (setup_.step != nullptr) {
      setup_.step->store(step, std::memory_order_relaxed);
    }
    if (setup_.trace != nullptr) {
      phase_trace_start_ = base::TraceClock::now();
    }
  }

  // Notes the time since the last phase ended, and what comes next. The last phase ends with the
  // last agent's last event; compositing follows.
  void EndPhase(absl::Duration* duration, const char* name, FrameStep next) {
    if (setup_.trace != nullptr) {
      setup_.trace->Add(name, phase_trace_start_, base::TraceClock::now());
    }
    BeginPhase(next);
    const absl::Time now =
        duration == &result_.visibility_culling_duration ? last_arrival_ : absl::Now();
    *duration = std::max(now - phase_start_, absl::ZeroDuration());
    phase_start_ = std::max(now, phase_start_);
  }

  // Notes the agent that failed, and ends the frame.
  absl::Status Fail(std::size_t agent_index, absl::Status status) {
    const Agent& agent = agents_[agent_index];
    failures_.push_back({.agent_index = agent_index,
                         .agent = agent.link->agent(),
                         .stage = agent.stage,
                         .status = std::move(status)});
    return failures_.back().ToStatus();
  }

  absl::Status OutOfOrder(std::size_t agent_index, const char* what) {
    return Fail(agent_index, absl::InternalError(absl::StrFormat(
                                 "sent %s out of order; its version may differ", what)));
  }

  // Returns the error of a passed deadline. The frame waits for the agents at the earliest stage.
  absl::Status DeadlineError() {
    FrameStage slowest = FrameStage::kEnded;
    for (const Agent& agent : agents_) {
      slowest = std::min(slowest, agent.stage);
    }
    std::vector<std::string> waiting;
    for (std::size_t i = 0; i < agents_.size(); ++i) {
      if (agents_[i].stage == slowest) {
        waiting.push_back(NameOf(agents_[i].link->agent()));
        Fail(i, absl::DeadlineExceededError("had not answered")).IgnoreError();
      }
    }
    return absl::DeadlineExceededError(absl::StrFormat(
        "the frame's deadline passed after %s; not answered: %s",
        absl::FormatDuration(absl::Trunc(absl::Now() - start_, absl::Milliseconds(1))),
        absl::StrJoin(waiting, ", ")));
  }

  const FrameSetup& setup_;
  const base::Cancellation& cancellation_;
  const image::FragmentOrder order_;
  const view::Clipper clipper_;
  const bool has_layers_;  // step 2 then draws only the opaque surfaces of a block
  const absl::Time start_;
  absl::Time phase_start_;
  base::TraceTime phase_trace_start_;  // if there is a trace
  absl::Time last_arrival_;
  EventQueue queue_;  // outlives the links
  std::vector<Agent> agents_;
  std::vector<volume::BlockId> hits_;
  std::vector<std::vector<volume::BlockId>> reported_;  // active blocks, by agent
  volume::BlockSet occluding_;
  std::vector<view::Footprint> footprints_;  // of the active blocks
  FrameResult result_;
  composite::RowLocks row_locks_;    // of its image
  bool is_composited_into_ = false;  // result_.image
  // Decodes bands into the image while others arrive.
  tbb::task_group compositing_;
  base::Mutex damage_mutex_;
  absl::Status damage_ ABSL_GUARDED_BY(damage_mutex_);  // the first one
  std::size_t damaging_agent_ ABSL_GUARDED_BY(damage_mutex_) = 0;
  std::vector<AgentFailure> failures_;
};

}  // namespace

FrameOutcome RunFrame(const FrameSetup& setup, const BeginAgentFrame& begin,
                      const base::Cancellation& cancellation) {
  const view::Viewport size = setup.view->image_size();
  image::FrameImage image;
  try {
    const base::TraceScope trace(setup.trace, "take image");
    image = setup.images->Take(size.width_px, size.height_px);
  } catch (const std::bad_alloc&) {
    return {.status = absl::ResourceExhaustedError(
                absl::StrFormat("the coordinator has no memory for a picture of %d x %d pixels",
                                size.width_px, size.height_px)),
            .result = {},
            .failures = {}};
  }
  return Frame(setup, cancellation, std::move(image)).Run(begin);
}

}  // namespace isoscope::server
