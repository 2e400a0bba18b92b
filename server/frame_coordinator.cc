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
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"
#include "absl/types/span.h"
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_group.h>

#include "core/base/first_error.h"
#include "core/base/status_macros.h"
#include "core/composite/pixel_codec.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_pixels.h"

namespace isoscope::server {
namespace {

// How late a cancellation may be noticed while no agent says anything.
constexpr absl::Duration kCancellationPoll = absl::Milliseconds(10);
// Blocks that one task tests: some hundred microseconds.
constexpr std::size_t kBlocksPerTask = 512;

struct RayHits {
  std::vector<volume::BlockId> hits;
  std::vector<volume::BlockId> active;
};
struct Pixels {
  std::vector<std::string> bands;
};
struct OccludersDone {};
struct FrameDone {
  frame::AgentStatistics statistics;
};
struct End {
  absl::Status status;
};

struct Event {
  std::size_t agent_index = 0;
  absl::Time arrival;
  std::variant<RayHits, Pixels, OccludersDone, FrameDone, End> what;
};

// What the agents say, in order of arrival. Thread-safe.
class EventQueue {
 public:
  void Push(Event event) {
    absl::MutexLock lock(&mutex_);
    events_.push_back(std::move(event));
  }

  // All events that have come, at least one unless `timeout` has passed.
  std::deque<Event> PopAllWithTimeout(absl::Duration timeout) {
    absl::MutexLock lock(&mutex_);
    const auto has_event = [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return !events_.empty(); };
    mutex_.AwaitWithTimeout(absl::Condition(&has_event), timeout);
    return std::exchange(events_, {});
  }

 private:
  absl::Mutex mutex_;
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

// How far an agent is.
enum class Stage { kSelecting, kRenderingOccluders, kRenderingVisible, kDone, kEnded };

class Frame {
 public:
  Frame(const FrameSetup& setup, const base::Cancellation& cancellation, image::FrameImage image)
      : setup_(setup),
        cancellation_(cancellation),
        start_(absl::Now()),
        row_locks_(setup.view->viewport().height_px) {
    result_.image = std::move(image);
  }

  absl::StatusOr<FrameResult> Run(const BeginAgentFrame& begin) {
    const absl::Status status = BeginAndDrive(begin);
    if (!status.ok()) {
      for (Agent& agent : agents_) {
        agent.link->Cancel();
      }
      FinishCompositing().IgnoreError();
    }
    for (const Agent& agent : agents_) {
      result_.network_bytes += agent.link->network_bytes();
    }
    agents_.clear();
    ISOSCOPE_RETURN_IF_ERROR(status);
    result_.composite_duration = absl::Now() - phase_start_;
    std::sort(result_.agents.begin(), result_.agents.end(),
              [](const frame::AgentStatistics& a, const frame::AgentStatistics& b) {
                return a.shard_indices < b.shard_indices;
              });
    return std::move(result_);
  }

 private:
  struct Agent {
    std::unique_ptr<QueueingListener> listener;  // outlives the link
    std::unique_ptr<AgentLink> link;
    Stage stage = Stage::kSelecting;
  };

  absl::Status BeginAndDrive(const BeginAgentFrame& begin) {
    phase_start_ = start_;
    reported_.resize(static_cast<std::size_t>(setup_.agent_count));
    for (int i = 0; i < setup_.agent_count; ++i) {
      Agent agent;
      agent.listener = std::make_unique<QueueingListener>(static_cast<std::size_t>(i), &queue_);
      agent.stage =
          setup_.culling == frame::Culling::kNone ? Stage::kRenderingVisible : Stage::kSelecting;
      ISOSCOPE_ASSIGN_OR_RETURN(agent.link, begin(i, agent.listener.get()));
      agents_.push_back(std::move(agent));
    }
    if (setup_.active != nullptr && setup_.culling != frame::Culling::kNone) {
      FindFootprints(*setup_.active);  // while the agents cast rays
    }
    while (!AllAt(Stage::kEnded)) {
      const absl::Duration left = cancellation_.deadline() - absl::Now();
      std::deque<Event> events =
          queue_.PopAllWithTimeout(std::clamp(left, absl::ZeroDuration(), kCancellationPoll));
      if (const absl::Status status = cancellation_.Check(); !status.ok()) {
        return absl::IsDeadlineExceeded(status) ? DeadlineError() : status;
      }
      for (Event& event : events) {
        ISOSCOPE_RETURN_IF_ERROR(Handle(std::move(event)));
      }
      if (pixels_error_.has_error()) {
        break;
      }
    }
    return FinishCompositing();
  }

  absl::Status Handle(Event event) {
    Agent& agent = agents_[event.agent_index];
    last_arrival_ = event.arrival;
    if (auto* hits = std::get_if<RayHits>(&event.what)) {
      return HandleRayHits(event.agent_index, std::move(*hits));
    }
    if (auto* pixels = std::get_if<Pixels>(&event.what)) {
      return HandlePixels(event.agent_index, std::move(pixels->bands));
    }
    if (std::holds_alternative<OccludersDone>(event.what)) {
      return HandleOccludersDone(&agent);
    }
    if (auto* done = std::get_if<FrameDone>(&event.what)) {
      if (!IsAt(agent, Stage::kRenderingVisible)) {
        return OutOfOrder(agent, "the end of the frame");
      }
      agent.stage = Stage::kDone;
      result_.agents.push_back(std::move(done->statistics));
      if (AllAt(Stage::kDone)) {
        EndPhase(&result_.visibility_culling_duration);
      }
      return absl::OkStatus();
    }
    const absl::Status& status = std::get<End>(event.what).status;
    if (absl::IsDeadlineExceeded(status)) {
      return DeadlineError();
    }
    ISOSCOPE_RETURN_IF_ERROR(status);
    if (agent.stage != Stage::kDone) {
      return OutOfOrder(agent, "the end of the stream");
    }
    agent.stage = Stage::kEnded;
    return absl::OkStatus();
  }

  // Lets the arena composite the bands, while others come.
  absl::Status HandlePixels(std::size_t agent_index, std::vector<std::string> bands) {
    const Agent& agent = agents_[agent_index];
    if (!IsAt(agent, Stage::kRenderingOccluders) && !IsAt(agent, Stage::kRenderingVisible)) {
      return OutOfOrder(agent, "pixels");
    }
    setup_.arena->execute([&] {
      for (std::string& band : bands) {
        compositing_.run(
            [this, agent_index, owned = std::move(band)] { CompositeBand(agent_index, owned); });
      }
    });
    return absl::OkStatus();
  }

  void CompositeBand(std::size_t agent_index, absl::string_view band) {
    const absl::Status status = composite::DecodePixelsInto(band, &result_.image, &row_locks_);
    if (!status.ok()) {
      pixels_error_.Set(
          {status.code(),
           absl::StrCat("pixels of ", agents_[agent_index].link->name(), ": ", status.message())});
    }
  }

  // Returns once all bands that came are in the image.
  absl::Status FinishCompositing() {
    setup_.arena->execute([&] { compositing_.wait(); });
    return pixels_error_.status();
  }

  absl::Status HandleRayHits(std::size_t agent_index, RayHits hits) {
    Agent& agent = agents_[agent_index];
    if (agent.stage != Stage::kSelecting) {
      return OutOfOrder(agent, "ray hits");
    }
    agent.stage = Stage::kRenderingOccluders;
    hits_ = visibility::UnionOfHits(hits_, hits.hits);
    if (setup_.active == nullptr) {
      reported_[agent_index] = std::move(hits.active);
    }
    if (AllAt(Stage::kRenderingOccluders)) {
      result_.active = setup_.active != nullptr ? setup_.active
                                                : std::make_shared<const ActiveBlocks>(
                                                      reported_, setup_.layout->block_count());
      SendOccluders();
      EndPhase(&result_.occluder_selection_duration);
    }
    return absl::OkStatus();
  }

  void SendOccluders() {
    result_.ray_hit_block_count = static_cast<std::int64_t>(hits_.size());
    const ActiveBlocks& active = *result_.active;
    occluding_ = visibility::OccludingBlocks(hits_, *setup_.layout, active.set);
    if (footprints_.empty()) {
      FindFootprints(active);
    }
    const std::vector<AgentPart> parts = SelectBlocks([&](std::size_t place, AgentPart* part) {
      if (occluding_.Contains(active.ids[place]) && !footprints_[place].rect.empty()) {
        part->blocks.push_back(active.ids[place]);
      }
    });
    for (std::size_t i = 0; i < agents_.size(); ++i) {
      agents_[i].link->SendOccluders(parts[i].blocks);
    }
  }

  void FindFootprints(const ActiveBlocks& active) {
    footprints_.resize(active.ids.size());
    setup_.arena->execute([&] {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, active.ids.size(), kBlocksPerTask),
                        [&](const tbb::blocked_range<std::size_t>& range) {
                          setup_.view->FootprintsOf(
                              *setup_.layout,
                              absl::MakeSpan(active.ids).subspan(range.begin(), range.size()),
                              absl::MakeSpan(footprints_).subspan(range.begin(), range.size()));
                        });
    });
  }

  // What each agent draws in one step.
  struct AgentPart {
    std::vector<volume::BlockId> blocks;
    std::vector<image::PixelMask> open;  // the pixels that each could win; or none
  };

  // Calls select(place in the active blocks, part to add it to) for every active block, in
  // parallel, and joins the parts of each agent in order.
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
        for (std::size_t place = task.begin; place < task.end; ++place) {
          select(place, &task.part);
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

  absl::Status HandleOccludersDone(Agent* agent) {
    if (!IsAt(*agent, Stage::kRenderingOccluders)) {
      return OutOfOrder(*agent, "the end of the occluders");
    }
    agent->stage = Stage::kRenderingVisible;
    if (AllAt(Stage::kRenderingVisible)) {
      ISOSCOPE_RETURN_IF_ERROR(FinishCompositing());
      SendVisibleBlocks();
      EndPhase(&result_.occluder_rendering_duration);
    }
    return absl::OkStatus();
  }

  void SendVisibleBlocks() {
    const bool has_depth = setup_.culling == frame::Culling::kDepth;
    const visibility::OcclusionMap map = setup_.arena->execute([&] {
      return visibility::OcclusionMap::FromImage(
          result_.image, has_depth ? visibility::MapKind::kDepth : visibility::MapKind::kMask);
    });
    const ActiveBlocks& active = *result_.active;
    const std::vector<AgentPart> parts = SelectBlocks([&](std::size_t place, AgentPart* part) {
      const view::Footprint& footprint = footprints_[place];
      if (occluding_.Contains(active.ids[place]) || footprint.rect.empty() ||
          map.Hides(footprint)) {
        return;
      }
      part->blocks.push_back(active.ids[place]);
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

  // True if every agent is at `stage` or further.
  [[nodiscard]] bool AllAt(Stage stage) const {
    return std::all_of(agents_.begin(), agents_.end(),
                       [stage](const Agent& agent) { return agent.stage >= stage; });
  }

  // True if `agent` is at `stage` and was asked for it: the step begins once all agents are there.
  [[nodiscard]] bool IsAt(const Agent& agent, Stage stage) const {
    return agent.stage == stage && AllAt(stage);
  }

  // The last phase ends when the last agent's last word came; what follows is compositing.
  void EndPhase(absl::Duration* duration) {
    const absl::Time now =
        duration == &result_.visibility_culling_duration ? last_arrival_ : absl::Now();
    *duration = std::max(now - phase_start_, absl::ZeroDuration());
    phase_start_ = std::max(now, phase_start_);
  }

  static absl::Status OutOfOrder(const Agent& agent, const char* what) {
    return absl::InternalError(absl::StrFormat("%s sent %s out of order; its version may differ",
                                               agent.link->name(), what));
  }

  absl::Status DeadlineError() const {
    Stage slowest = Stage::kEnded;
    for (const Agent& agent : agents_) {
      slowest = std::min(slowest, agent.stage);
    }
    std::vector<std::string> waiting;
    for (const Agent& agent : agents_) {
      if (agent.stage == slowest) {
        waiting.push_back(agent.link->name());
      }
    }
    return absl::DeadlineExceededError(absl::StrFormat(
        "the frame's deadline passed after %s; not answered: %s",
        absl::FormatDuration(absl::Trunc(absl::Now() - start_, absl::Milliseconds(1))),
        absl::StrJoin(waiting, ", ")));
  }

  const FrameSetup& setup_;
  const base::Cancellation& cancellation_;
  const absl::Time start_;
  absl::Time phase_start_;
  absl::Time last_arrival_;
  EventQueue queue_;  // outlives the links
  std::vector<Agent> agents_;
  std::vector<volume::BlockId> hits_;
  std::vector<std::vector<volume::BlockId>> reported_;  // active blocks, by agent
  volume::BlockSet occluding_;
  std::vector<view::Footprint> footprints_;  // of the active blocks
  FrameResult result_;
  composite::RowLocks row_locks_;  // of its image
  // Decodes bands into the image while others come.
  tbb::task_group compositing_;
  base::FirstError pixels_error_;
};

}  // namespace

absl::StatusOr<FrameResult> RunFrame(const FrameSetup& setup, const BeginAgentFrame& begin,
                                     const base::Cancellation& cancellation) {
  const view::Viewport& viewport = setup.view->viewport();
  image::FrameImage image;
  try {
    image = setup.images->Take(viewport.width_px, viewport.height_px);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("the coordinator has no memory for a picture of %d x %d pixels",
                        viewport.width_px, viewport.height_px));
  }
  return Frame(setup, cancellation, std::move(image)).Run(begin);
}

}  // namespace isoscope::server
