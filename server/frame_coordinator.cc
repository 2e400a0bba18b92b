#include "server/frame_coordinator.h"

#include <algorithm>
#include <deque>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/synchronization/mutex.h"
#include "absl/time/clock.h"

#include "core/base/status_macros.h"
#include "core/composite/depth_composite.h"
#include "core/composite/pixel_codec.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/occlusion_map.h"

namespace isoscope::server {
namespace {

// How late a cancellation may be noticed while no agent says anything.
constexpr absl::Duration kCancellationPoll = absl::Milliseconds(10);
// The map has one texel for each pixel: coarser ones cull less.
constexpr int kOcclusionMapLevel = 0;

struct RayHits {
  std::vector<volume::BlockId> hits;
};
struct Pixels {
  std::string band;
};
struct OccludersDone {};
struct FrameDone {
  AgentStatistics statistics;
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

  // The next event, or none when `timeout` has passed.
  std::optional<Event> PopWithTimeout(absl::Duration timeout) {
    absl::MutexLock lock(&mutex_);
    const auto has_event = [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return !events_.empty(); };
    if (!mutex_.AwaitWithTimeout(absl::Condition(&has_event), timeout)) {
      return std::nullopt;
    }
    Event event = std::move(events_.front());
    events_.pop_front();
    return event;
  }

 private:
  absl::Mutex mutex_;
  std::deque<Event> events_ ABSL_GUARDED_BY(mutex_);
};

class QueueingListener final : public AgentListener {
 public:
  QueueingListener(std::size_t agent_index, EventQueue* queue)
      : agent_index_(agent_index), queue_(queue) {}

  void OnRayHits(std::vector<volume::BlockId> hits) override { Push(RayHits{std::move(hits)}); }
  void OnPixels(std::string band) override { Push(Pixels{std::move(band)}); }
  void OnOccludersDone() override { Push(OccludersDone{}); }
  void OnFrameDone(AgentStatistics statistics) override { Push(FrameDone{std::move(statistics)}); }
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
  Frame(const view::View& view, visibility::Culling culling, const base::Cancellation& cancellation)
      : view_(view), culling_(culling), cancellation_(cancellation), start_(absl::Now()) {
    result_.image = image::FrameImage(view.viewport().width_px, view.viewport().height_px);
  }

  absl::StatusOr<FrameResult> Run(int agent_count, const BeginAgentFrame& begin) {
    const absl::Status status = BeginAndDrive(agent_count, begin);
    if (!status.ok()) {
      for (Agent& agent : agents_) {
        agent.link->Cancel();
      }
    }
    for (const Agent& agent : agents_) {
      result_.network_bytes += agent.link->network_bytes();
    }
    agents_.clear();
    ISOSCOPE_RETURN_IF_ERROR(status);
    result_.composite_duration = absl::Now() - phase_start_;
    std::sort(result_.agents.begin(), result_.agents.end(),
              [](const AgentStatistics& a, const AgentStatistics& b) {
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

  absl::Status BeginAndDrive(int agent_count, const BeginAgentFrame& begin) {
    phase_start_ = start_;
    for (int i = 0; i < agent_count; ++i) {
      Agent agent;
      agent.listener = std::make_unique<QueueingListener>(static_cast<std::size_t>(i), &queue_);
      agent.stage =
          culling_ == visibility::Culling::kNone ? Stage::kRenderingVisible : Stage::kSelecting;
      ISOSCOPE_ASSIGN_OR_RETURN(agent.link, begin(i, agent.listener.get()));
      agents_.push_back(std::move(agent));
    }
    while (!AllAt(Stage::kEnded)) {
      const absl::Duration left = cancellation_.deadline() - absl::Now();
      std::optional<Event> event =
          queue_.PopWithTimeout(std::clamp(left, absl::ZeroDuration(), kCancellationPoll));
      if (const absl::Status status = cancellation_.Check(); !status.ok()) {
        return absl::IsDeadlineExceeded(status) ? DeadlineError() : status;
      }
      if (event.has_value()) {
        ISOSCOPE_RETURN_IF_ERROR(Handle(std::move(*event)));
      }
    }
    return absl::OkStatus();
  }

  absl::Status Handle(Event event) {
    Agent& agent = agents_[event.agent_index];
    last_arrival_ = event.arrival;
    if (auto* hits = std::get_if<RayHits>(&event.what)) {
      return HandleRayHits(&agent, hits->hits);
    }
    if (auto* pixels = std::get_if<Pixels>(&event.what)) {
      if (!IsAt(agent, Stage::kRenderingOccluders) && !IsAt(agent, Stage::kRenderingVisible)) {
        return OutOfOrder(agent, "pixels");
      }
      const absl::Status status = composite::DecodePixelsInto(pixels->band, &result_.image);
      return status.ok()
                 ? status
                 : absl::Status(status.code(), absl::StrCat("pixels of ", agent.link->name(), ": ",
                                                            status.message()));
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

  absl::Status HandleRayHits(Agent* agent, const std::vector<volume::BlockId>& hits) {
    if (agent->stage != Stage::kSelecting) {
      return OutOfOrder(*agent, "ray hits");
    }
    agent->stage = Stage::kRenderingOccluders;
    hits_ = visibility::UnionOfHits(hits_, hits);
    if (AllAt(Stage::kRenderingOccluders)) {
      result_.ray_hit_block_count = static_cast<std::int64_t>(hits_.size());
      for (const Agent& each : agents_) {
        each.link->SendOccluders(hits_);
      }
      EndPhase(&result_.occluder_selection_duration);
    }
    return absl::OkStatus();
  }

  absl::Status HandleOccludersDone(Agent* agent) {
    if (!IsAt(*agent, Stage::kRenderingOccluders)) {
      return OutOfOrder(*agent, "the end of the occluders");
    }
    agent->stage = Stage::kRenderingVisible;
    if (AllAt(Stage::kRenderingVisible)) {
      const auto kind = culling_ == visibility::Culling::kMask ? visibility::MapKind::kMask
                                                               : visibility::MapKind::kDepth;
      const std::string encoded =
          visibility::OcclusionMap::FromImage(result_.image, visibility::DepthQuantizer(view_),
                                              kind, kOcclusionMapLevel)
              .Encode();
      for (const Agent& each : agents_) {
        each.link->SendOcclusionMap(encoded);
      }
      EndPhase(&result_.occluder_rendering_duration);
    }
    return absl::OkStatus();
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

  const view::View& view_;
  const visibility::Culling culling_;
  const base::Cancellation& cancellation_;
  const absl::Time start_;
  absl::Time phase_start_;
  absl::Time last_arrival_;
  EventQueue queue_;  // outlives the links
  std::vector<Agent> agents_;
  std::vector<volume::BlockId> hits_;
  FrameResult result_;
};

}  // namespace

absl::StatusOr<FrameResult> RunFrame(const view::View& view, visibility::Culling culling,
                                     int agent_count, const BeginAgentFrame& begin,
                                     const base::Cancellation& cancellation) {
  return Frame(view, culling, cancellation).Run(agent_count, begin);
}

}  // namespace isoscope::server
