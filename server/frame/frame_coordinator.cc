// A frame runs on one thread, which waits for the events of the agents. Each part of the frame is
// at a stage. A step of the frame begins when the last part has reached its stage.
//
//   event           allowed at           then                 when all parts are there
//   ray hits        kSelectingOccluders  kRenderingOccluders  union of the hits; each part gets
//                                                             its occluding blocks
//   pixels          kRenderingOccluders  the arena            -
//                   kRenderingVisible    composites them
//   occluders done  kRenderingOccluders  kRenderingVisible    occlusion map; each part gets its
//                                                             blocks that are not hidden
//   frame done      kRenderingVisible    kDone                -
//   end, OK         kDone                kEnded               the frame is complete
//   end, error      any                  the part is repeated, or the frame fails
//
// Any other event breaks the protocol: INTERNAL. With Culling::kNone parts begin at
// kRenderingVisible. A frame that fails cancels all agents and waits until their streams have
// ended, so that nobody works for it when RunFrame returns.
//
// Attempts. A part is tried on one replica at first. It is tried on the next one
//   * when an attempt fails, and no other one is under way;
//   * beside the first attempt, when that is late: its agent no longer answers, or it has used up
//     its share of the deadline, or it takes twice as long as the other parts at this step.
// An attempt begins at the first step and is told what the frame knows already, so it makes the
// same messages as the one before. Its hits and pixels are reduced once more, which changes
// nothing. The first attempt that is done wins: its statistics count, and the others are cancelled.
// A part never goes back: while an attempt repeats what an earlier one did, the frame goes on.
//
// Wakes. The frame's thread sleeps until every part at the earliest stage can have said that it is
// done, or pixels or an error have come: with hundreds of agents it is not woken for each.
//
// Pixels. Those that have arrived lie in a queue. The frame's own thread takes them from it before
// it waits for events, and threads of the arena help when much lies there. Agents of this process
// wait for memory that the queued pixels hold, and an arena may have no thread to spare: one of one
// thread never has. So without the frame's thread nobody would go on. Each arrival wakes it, though
// that costs: with more images under way they leave the processor's caches, which costs more.

#include "server/frame/frame_coordinator.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <deque>
#include <functional>
#include <iterator>
#include <memory>
#include <new>
#include <optional>
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
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/base/trace_recorder.h"
#include "core/composite/depth_composite.h"
#include "core/composite/pixel_codec.h"
#include "core/view/clip_region.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_pixels.h"
#include "server/frame/read_gate.h"

namespace isoscope::server {
namespace {

// One task tests this many blocks, in some hundred microseconds.
constexpr std::size_t kBlocksPerTask = 512;

// A full tile of a band has about as many bytes.
constexpr std::size_t kFullTileBytes = 1024;
// Tiles that one thread composites in some hundred microseconds. To wake another one takes as long.
constexpr std::size_t kTilesPerHelper = 512;

// Between two looks for parts that are late, of a frame that has spare replicas.
constexpr absl::Duration kWatchInterval = absl::Milliseconds(10);
// A part that takes less is never too slow: a second attempt costs about as much.
constexpr absl::Duration kMinSlowDuration = absl::Milliseconds(40);
// An attempt that takes longer than this share of its time to the deadline gets company.
constexpr int kDeadlineShare = 4;

// Returns true if another agent might do better. The frame's own end is none of these.
bool IsRepeatable(const absl::Status& status) {
  return !absl::IsCancelled(status) && !absl::IsDeadlineExceeded(status);
}

// Returns true if a picture without the part may be wanted: its agents are gone, or its shards are
// damaged. Else the same would happen to the others.
bool IsLoss(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsFailedPrecondition(status) ||
         absl::IsDataLoss(status);
}

struct RayHits {
  std::vector<volume::BlockId> hits;
  std::vector<volume::BlockId> active;
};
struct Pixels {
  std::vector<std::string> bands;
  std::shared_ptr<const ReadGate::Hold> hold;  // of all bands
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

// One try of a part on one agent.
struct AttemptId {
  std::size_t part = 0;
  std::size_t replica = 0;  // in the order in which the part tries them
};

struct Event {
  AttemptId from;
  absl::Time arrival;
  std::variant<RayHits, Pixels, DrawnPixels, OccludersDone, PixelsDamaged, FrameDone, End> what;
  // The stage that it ends, if it is the agent's next word; not set: the frame must look at once.
  std::optional<FrameStage> ended_stage = std::nullopt;
};

// The events of the agents, in order of arrival. Thread-safe.
class EventQueue {
 public:
  // Agents' threads call it, which nobody could tell of an exception.
  void Push(Event event) noexcept ABSL_LOCKS_EXCLUDED(mutex_) {
    bool wakes = false;
    {
      const base::MutexLock lock(&mutex_);
      const bool was_ready = IsReady();
      has_urgent_one_ = has_urgent_one_ || IsUrgent(event.ended_stage);
      try {
        events_.push_back(std::move(event));
      } catch (const std::bad_alloc&) {
        has_lost_one_ = true;
      }
      wakes = !was_ready && IsReady();
    }
    // Without the mutex, which the woken thread needs at once. The queue outlives all pushes.
    if (wakes) {
      arrived_.Signal();
    }
  }

  // Says how many events that end `stage` the frame needs to go on, at least 1. Whatever else comes
  // makes the queue ready. A thread that is woken for nothing costs as much as an event.
  void SetNeeded(std::size_t count, FrameStage stage) ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    needed_count_ = count;
    needed_stage_ = stage;
    for (const Event& event : events_) {
      has_urgent_one_ = has_urgent_one_ || IsUrgent(event.ended_stage);
    }
  }

  [[nodiscard]] bool is_ready() const ABSL_LOCKS_EXCLUDED(mutex_) {
    const base::MutexLock lock(&mutex_);
    return IsReady();
  }

  // Waits until the queue is ready, or until `wake`, and returns all events that have come; none
  // may have. Returns the cancellation's error if it fires first. RESOURCE_EXHAUSTED if there was
  // no memory for an event.
  absl::StatusOr<std::deque<Event>> PopAll(absl::Time wake, const base::Cancellation& cancellation)
      ABSL_LOCKS_EXCLUDED(mutex_) {
    std::deque<Event> events;
    {
      const base::Cancellation::Callback stop(cancellation, [this] {
        const base::MutexLock lock(&mutex_);
        arrived_.SignalAll();
      });
      const base::MutexLock lock(&mutex_);
      arrived_.AwaitUntil(&mutex_, std::min(wake, cancellation.deadline()),
                          [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
                            return IsReady() || cancellation.is_cancelled();
                          });
      if (has_lost_one_) {
        return base::NoMemory("an agent's message");
      }
      ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());  // what has come stays, for TakeAll
      events.swap(events_);
      has_urgent_one_ = false;
    }
    return events;
  }

  // Returns the events that have come and nobody has waited for.
  std::deque<Event> TakeAll() ABSL_LOCKS_EXCLUDED(mutex_) {
    std::deque<Event> events;
    const base::MutexLock lock(&mutex_);
    events.swap(events_);
    return events;
  }

 private:
  // A stream ends right after its frame is done.
  [[nodiscard]] bool IsUrgent(std::optional<FrameStage> ended_stage) const
      ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
    return ended_stage != needed_stage_ && ended_stage != FrameStage::kDone;
  }
  [[nodiscard]] bool IsReady() const ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
    return has_urgent_one_ || has_lost_one_ || events_.size() >= needed_count_;
  }

  mutable base::Mutex mutex_;
  base::CondVar arrived_;
  std::deque<Event> events_ ABSL_GUARDED_BY(mutex_);
  std::size_t needed_count_ ABSL_GUARDED_BY(mutex_) = 1;
  FrameStage needed_stage_ ABSL_GUARDED_BY(mutex_) = FrameStage::kSelectingOccluders;
  bool has_urgent_one_ ABSL_GUARDED_BY(mutex_) = false;
  bool has_lost_one_ ABSL_GUARDED_BY(mutex_) = false;
};

class QueueingListener final : public AgentListener {
 public:
  // stage: that the agent begins with
  QueueingListener(AttemptId id, FrameStage stage, EventQueue* queue, ReadGate* gate)
      : id_(id), queue_(queue), gate_(*gate), stage_(stage) {}

  void OnRayHits(std::vector<volume::BlockId> hits, std::vector<volume::BlockId> active) override {
    Push(RayHits{std::move(hits), std::move(active)}, EndStage(FrameStage::kSelectingOccluders));
  }
  void OnPixels(std::vector<std::string> bands) override {
    std::size_t bytes = 0;
    for (const std::string& band : bands) {
      bytes += band.size();
    }
    auto hold = std::make_shared<const ReadGate::Hold>(gate_.Add(bytes));
    Push(Pixels{std::move(bands), std::move(hold)});
  }
  void OnDrawnPixels(image::DrawnPixels pixels) override { Push(DrawnPixels{std::move(pixels)}); }
  void OnOccludersDone() override {
    Push(OccludersDone{}, EndStage(FrameStage::kRenderingOccluders));
  }
  void OnFrameDone(frame::AgentStatistics statistics) override {
    Push(FrameDone{std::move(statistics)}, EndStage(FrameStage::kRenderingVisible));
  }
  void OnEnd(absl::Status status) override {
    const std::optional<FrameStage> ended =
        status.ok() ? EndStage(FrameStage::kDone) : std::nullopt;
    Push(End{std::move(status)}, ended);
  }
  void WhenRoom(std::function<void()> read) override { gate_.WhenRoom(std::move(read)); }

 private:
  // Returns `stage` if the agent is at it, and goes on to the next one.
  std::optional<FrameStage> EndStage(FrameStage stage) {
    if (stage_ != stage) {
      return std::nullopt;
    }
    stage_ = static_cast<FrameStage>(static_cast<int>(stage) + 1);
    return stage;
  }

  template <typename T>
  void Push(T what, std::optional<FrameStage> ended_stage = std::nullopt) {
    queue_->Push({id_, absl::Now(), std::move(what), ended_stage});
  }

  const AttemptId id_;
  EventQueue* const queue_;
  ReadGate& gate_;
  FrameStage stage_;
};

class Frame {
 public:
  Frame(const FrameSetup& setup, const BeginAgentFrame& begin,
        const base::Cancellation& cancellation, image::FrameImage image)
      : setup_(setup),
        cancellation_(cancellation),
        order_{.block_count = static_cast<std::uint32_t>(setup.layout->block_count()),
               .ties = setup.ties},
        clipper_(setup.spec->clip, setup.view->geometry()),
        has_layers_(frame::HasLayers(*setup.spec)),
        start_(absl::Now()),
        gate_(setup.max_waiting_bytes),
        begin_(begin),
        hits_(setup.layout->block_count()),
        row_locks_(setup.view->image_size().height_px) {
    result_.image = std::move(image);
    if (has_layers_) {
      result_.layers =
          image::LayerStack(result_.image.width, result_.image.height, setup.spec->max_layers + 1,
                            {.block_count = order_.block_count}, setup.images);
    }
  }

  // An exception may have left tasks.
  ~Frame() { AbandonCompositing(); }
  Frame(const Frame&) = delete;
  Frame& operator=(const Frame&) = delete;

  FrameOutcome Run() {
    absl::Status status = base::OrNoMemory("the frame", [this] { return BeginAndDrive(); });
    std::vector<std::size_t> lost_parts;
    if (!status.ok()) {
      if (lost_part_.has_value() && IsLoss(status)) {
        lost_parts = LostParts();
      }
      for (Part& part : parts_) {
        for (Attempt& attempt : part.attempts) {
          attempt.link->Cancel();
        }
      }
      AbandonCompositing();
    }
    for (Part& part : parts_) {
      if (status.ok()) {
        result_.network_bytes += part.attempts[*part.winner].link->network_bytes();
        result_.agents.push_back(std::move(part.statistics));
      }
    }
    {
      const base::TraceScope trace(setup_.trace, "end streams");
      gate_.Open();  // a stream ends only after its last read
      parts_.clear();
    }
    FrameOutcome outcome{.status = std::move(status),
                         .result = {},
                         .failures = std::move(failures_),
                         .outrun = std::move(outrun_),
                         .lost_parts = std::move(lost_parts),
                         .hedge_count = hedge_count_};
    if (outcome.status.ok()) {
      result_.composite_duration = absl::Now() - phase_start_;
      std::sort(result_.agents.begin(), result_.agents.end(),
                [](const frame::AgentStatistics& a, const frame::AgentStatistics& b) {
                  return a.shard_indices < b.shard_indices;
                });
      outcome.result = std::move(result_);
    }
    return outcome;
  }

 private:
  struct Attempt {
    std::unique_ptr<QueueingListener> listener;  // outlives the link
    std::unique_ptr<AgentLink> link;
    FrameStage stage = FrameStage::kSelectingOccluders;
    absl::Time begin;
    bool is_live = true;  // else its events no longer count
    bool has_failed = false;
  };

  struct Part {
    std::vector<Attempt> attempts;  // one for each replica that was tried, in their order
    FrameStage stage = FrameStage::kSelectingOccluders;  // the farthest of any attempt
    absl::Time stage_begin;
    std::optional<std::size_t> winner;  // among attempts
    frame::AgentStatistics statistics;  // of the winner
    // What every attempt is told at the begin of steps 2 and 3.
    std::vector<volume::BlockId> occluders;
    std::vector<volume::BlockId> visible;
    std::string open_pixels;
  };

  [[nodiscard]] FrameStage FirstStage() const {
    return setup_.spec->culling == frame::Culling::kNone ? FrameStage::kRenderingVisible
                                                         : FrameStage::kSelectingOccluders;
  }

  absl::Status BeginAndDrive() {
    phase_start_ = start_;
    BeginPhase(setup_.spec->culling == frame::Culling::kNone ? FrameStep::kVisibilityCulling
                                                             : FrameStep::kOccluderSelection);
    reported_.resize(setup_.replica_counts.size());
    parts_.resize(setup_.replica_counts.size());
    bool has_replicas = false;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      parts_[i].stage = FirstStage();
      ++CountAt(FirstStage());
      ISOSCOPE_RETURN_IF_ERROR(BeginAttempt(i));
      has_replicas = has_replicas || HasSpare(i);
    }
    if (setup_.active != nullptr && setup_.spec->culling != frame::Culling::kNone) {
      FindFootprints(*setup_.active);  // while the agents cast rays
    }
    while (true) {
      while (!AllAt(FrameStage::kEnded)) {
        const absl::Time wake =
            has_replicas ? absl::Now() + kWatchInterval : absl::InfiniteFuture();
        SetNeededEvents();
        CompositeUntilEvent(wake);
        base::TraceScope wait(setup_.trace, "wait for agents");
        absl::StatusOr<std::deque<Event>> events = queue_.PopAll(wake, cancellation_);
        wait.End();
        if (!events.ok()) {
          return absl::IsDeadlineExceeded(events.status()) ? DeadlineError() : events.status();
        }
        arrived_ = *std::move(events);
        while (!arrived_.empty()) {
          Event event = std::move(arrived_.front());
          arrived_.pop_front();
          ISOSCOPE_RETURN_IF_ERROR(Handle(std::move(event)));
        }
        if (has_replicas) {
          ISOSCOPE_RETURN_IF_ERROR(RepeatLateParts());
        }
      }
      ISOSCOPE_RETURN_IF_ERROR(FinishCompositing());
      if (AllAt(FrameStage::kEnded)) {  // else a part had sent damaged pixels last
        return absl::OkStatus();
      }
    }
  }

  [[nodiscard]] bool HasSpare(std::size_t part_index) const {
    return parts_[part_index].attempts.size() <
           static_cast<std::size_t>(setup_.replica_counts[part_index]);
  }

  [[nodiscard]] static std::size_t LiveCount(const Part& part) {
    return static_cast<std::size_t>(
        std::count_if(part.attempts.begin(), part.attempts.end(),
                      [](const Attempt& attempt) { return attempt.is_live; }));
  }

  // Tries a part on its next replica. REQUIRES: there is one.
  absl::Status BeginAttempt(std::size_t part_index) {
    Part& part = parts_[part_index];
    const std::size_t replica = part.attempts.size();
    Attempt attempt;
    attempt.listener = std::make_unique<QueueingListener>(AttemptId{part_index, replica},
                                                          FirstStage(), &queue_, &gate_);
    attempt.stage = FirstStage();
    attempt.begin = absl::Now();
    ISOSCOPE_ASSIGN_OR_RETURN(
        attempt.link,
        begin_(static_cast<int>(part_index), static_cast<int>(replica), attempt.listener.get()));
    part.attempts.push_back(std::move(attempt));
    return absl::OkStatus();
  }

  // Begins a second attempt of each part whose first one is late.
  absl::Status RepeatLateParts() {
    const absl::Time now = absl::Now();
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      const Part& part = parts_[i];
      if (part.stage >= FrameStage::kDone || !HasSpare(i) || LiveCount(part) != 1) {
        continue;
      }
      const auto live = std::find_if(part.attempts.begin(), part.attempts.end(),
                                     [](const Attempt& attempt) { return attempt.is_live; });
      const auto replica = static_cast<int>(live - part.attempts.begin());
      const auto spare = static_cast<int>(part.attempts.size());
      const bool is_lost =
          setup_.is_lost != nullptr && setup_.is_lost(static_cast<int>(i), replica);
      const bool has_used_its_time =
          now - live->begin > (cancellation_.deadline() - live->begin) / kDeadlineShare;
      if (is_lost || has_used_its_time) {
        ISOSCOPE_RETURN_IF_ERROR(BeginAttempt(i));
      } else if (IsSlow(part, now) && setup_.may_hedge != nullptr &&
                 setup_.may_hedge(static_cast<int>(i), spare)) {
        ++hedge_count_;
        ISOSCOPE_RETURN_IF_ERROR(BeginAttempt(i));
      }
    }
    return absl::OkStatus();
  }

  // Returns true if a part takes twice as long as the slowest of the others, which are at least as
  // many as those that are not there yet.
  [[nodiscard]] bool IsSlow(const Part& part, absl::Time now) const {
    std::size_t behind = 0;
    absl::Duration slowest = kMinSlowDuration / 2;
    for (const Part& other : parts_) {
      if (other.stage <= part.stage) {
        ++behind;
      } else {
        slowest = std::max(slowest, other.stage_begin - phase_start_);
      }
    }
    return 2 * behind <= parts_.size() && now - phase_start_ > 2 * slowest;
  }

  void SetStage(FrameStage stage, Part* part) {
    --CountAt(part->stage);
    ++CountAt(stage);
    part->stage = stage;
    part->stage_begin = last_arrival_;
  }

  // Each part at the earliest stage must still say that it is done with it.
  void SetNeededEvents() {
    const auto earliest = std::find_if(parts_at_.begin(), parts_at_.end() - 1,
                                       [](std::size_t count) { return count > 0; });
    queue_.SetNeeded(std::max<std::size_t>(*earliest, 1),
                     static_cast<FrameStage>(earliest - parts_at_.begin()));
  }

  [[nodiscard]] std::size_t& CountAt(FrameStage stage) {
    return parts_at_[static_cast<std::size_t>(stage)];
  }

  absl::Status Handle(Event event) {
    const AttemptId id = event.from;
    Attempt& attempt = AttemptOf(id);
    if (std::holds_alternative<PixelsDamaged>(event.what)) {
      return FinishCompositing();
    }
    if (!attempt.is_live) {
      return absl::OkStatus();
    }
    last_arrival_ = event.arrival;
    if (auto* hits = std::get_if<RayHits>(&event.what)) {
      return HandleRayHits(id, std::move(*hits));
    }
    if (auto* pixels = std::get_if<Pixels>(&event.what)) {
      return HandlePixels(id, std::move(*pixels));
    }
    if (auto* drawn = std::get_if<DrawnPixels>(&event.what)) {
      return HandleDrawnPixels(id, std::move(drawn->pixels));
    }
    if (std::holds_alternative<OccludersDone>(event.what)) {
      return HandleOccludersDone(id);
    }
    if (auto* done = std::get_if<FrameDone>(&event.what)) {
      return HandleFrameDone(id, std::move(done->statistics));
    }
    return HandleEnd(id, std::get<End>(event.what).status);
  }

  [[nodiscard]] Attempt& AttemptOf(AttemptId id) { return parts_[id.part].attempts[id.replica]; }

  absl::Status HandleFrameDone(AttemptId id, frame::AgentStatistics statistics) {
    Part& part = parts_[id.part];
    if (!IsAt(AttemptOf(id), FrameStage::kRenderingVisible)) {
      return OutOfOrder(id, "the end of the frame");
    }
    AttemptOf(id).stage = FrameStage::kDone;
    SetStage(FrameStage::kDone, &part);
    part.winner = id.replica;
    part.statistics = std::move(statistics);
    for (std::size_t i = 0; i < part.attempts.size(); ++i) {
      Attempt& other = part.attempts[i];
      if (i != id.replica && other.is_live) {
        other.is_live = false;
        other.link->Cancel();
        if (i < id.replica) {
          outrun_.push_back(other.link->agent());
        }
      }
    }
    if (AllAt(FrameStage::kDone)) {
      EndPhase(&result_.visibility_culling_duration, "visibility culling", FrameStep::kFinishing);
    }
    return absl::OkStatus();
  }

  absl::Status HandleEnd(AttemptId id, const absl::Status& status) {
    Attempt& attempt = AttemptOf(id);
    // An agent that is lost after its last message has done its part.
    if (status.ok() || absl::IsUnavailable(status)) {
      if (attempt.stage == FrameStage::kDone) {
        attempt.is_live = false;
        SetStage(FrameStage::kEnded, &parts_[id.part]);
        return absl::OkStatus();
      }
      return status.ok() ? OutOfOrder(id, "the end of the stream") : Fail(id, status);
    }
    return absl::IsDeadlineExceeded(status) ? DeadlineError() : Fail(id, status);
  }

  // Pixels that wait to be composited: a band, or all of an agent's step.
  struct Arrival {
    AttemptId from;
    std::variant<std::string, image::DrawnPixels> pixels;
    std::shared_ptr<const ReadGate::Hold> hold;  // of bands
    std::size_t tile_count = 0;                  // about
  };

  absl::Status HandlePixels(AttemptId id, Pixels pixels) {
    if (!IsRendering(AttemptOf(id))) {
      return OutOfOrder(id, "pixels");
    }
    is_composited_into_ = true;
    std::vector<Arrival> arrivals;
    arrivals.reserve(pixels.bands.size());
    for (std::string& band : pixels.bands) {
      const std::size_t tile_count = band.size() / kFullTileBytes + 1;
      arrivals.push_back({id, std::move(band), pixels.hold, tile_count});
    }
    Composite(std::move(arrivals));
    return absl::OkStatus();
  }

  // The first image becomes the result; others are composited into it.
  absl::Status HandleDrawnPixels(AttemptId id, image::DrawnPixels pixels) {
    if (!IsRendering(AttemptOf(id))) {
      return OutOfOrder(id, "pixels");
    }
    if (pixels.image.width != result_.image.width || pixels.image.height != result_.image.height) {
      return Fail(id, absl::InternalError(absl::StrFormat(
                          "drew %d x %d pixels of %d x %d", pixels.image.width, pixels.image.height,
                          result_.image.width, result_.image.height)));
    }
    if (!std::exchange(is_composited_into_, true)) {
      std::swap(result_.image, pixels.image);
      if (!has_layers_) {
        return absl::OkStatus();
      }
    }
    std::vector<Arrival> arrivals;
    const std::size_t tile_count = TileCountOf(pixels);
    arrivals.push_back({id, std::move(pixels), nullptr, tile_count});
    Composite(std::move(arrivals));
    return absl::OkStatus();
  }

  static std::size_t TileCountOf(const image::DrawnPixels& pixels) {
    std::size_t count = pixels.image.touched.Count();
    for (const image::FrameImage* level : pixels.layers.Levels()) {
      count += level->touched.Count();
    }
    return count;
  }

  // Queues the pixels. Calls threads of the arena to help if they are more than the frame's own
  // thread composites in the time that it takes to wake another one.
  void Composite(std::vector<Arrival> arrivals) ABSL_LOCKS_EXCLUDED(arrivals_mutex_) {
    has_tasks_ = true;
    std::size_t more_helpers = 0;
    {
      const base::MutexLock lock(&arrivals_mutex_);
      for (Arrival& arrival : arrivals) {
        waiting_tiles_ += arrival.tile_count;
        arrivals_.push_back(std::move(arrival));
      }
      const std::size_t wanted =
          std::min({waiting_tiles_ / kTilesPerHelper, arrivals_.size(),
                    static_cast<std::size_t>(setup_.arena->max_concurrency())});
      more_helpers = wanted - std::min(wanted, helper_count_);
      helper_count_ += more_helpers;
    }
    if (more_helpers > 0) {
      setup_.arena->execute([&] {
        for (std::size_t i = 0; i < more_helpers; ++i) {
          compositing_.run([this] { Help(); });
        }
      });
    }
  }

  // Composites until nothing waits.
  void Help() ABSL_LOCKS_EXCLUDED(arrivals_mutex_) {
    while (CompositeNext()) {
    }
    const base::MutexLock lock(&arrivals_mutex_);
    --helper_count_;
  }

  // Works on what has arrived until the frame can go on, until `wake`, or until nothing is left.
  void CompositeUntilEvent(absl::Time wake) {
    const absl::Time end = std::min(wake, cancellation_.deadline());
    while (!queue_.is_ready() && HasArrivals() && !cancellation_.is_cancelled() &&
           absl::Now() < end) {
      setup_.arena->execute([&] { CompositeNext(); });
    }
  }

  [[nodiscard]] bool HasArrivals() const ABSL_LOCKS_EXCLUDED(arrivals_mutex_) {
    const base::MutexLock lock(&arrivals_mutex_);
    return !arrivals_.empty();
  }

  // Takes what arrived first, unless another thread has.
  std::optional<Arrival> TakeArrival() ABSL_LOCKS_EXCLUDED(arrivals_mutex_) {
    const base::MutexLock lock(&arrivals_mutex_);
    if (arrivals_.empty()) {
      return std::nullopt;
    }
    std::optional<Arrival> arrival(std::move(arrivals_.front()));
    arrivals_.pop_front();
    waiting_tiles_ -= arrival->tile_count;
    return arrival;
  }

  // Composites what arrived first; false if nothing waits. The pixels and their memory are free
  // when it returns.
  bool CompositeNext() ABSL_LOCKS_EXCLUDED(arrivals_mutex_) {
    const std::optional<Arrival> arrival = TakeArrival();
    if (!arrival.has_value()) {
      return false;
    }
    if (const auto* band = std::get_if<std::string>(&arrival->pixels)) {
      CompositeBand(arrival->from, *band);
    } else {
      CompositeDrawn(arrival->from, std::get<image::DrawnPixels>(arrival->pixels),
                     arrival->tile_count);
    }
    return true;
  }

  // Drops the pixels that nobody has begun to composite, and waits for the rest. In the arena: one
  // of one thread has nobody else to run the tasks. Allocates nothing.
  void AbandonCompositing() noexcept ABSL_LOCKS_EXCLUDED(arrivals_mutex_) {
    if (!std::exchange(has_tasks_, false)) {
      return;
    }
    while (TakeArrival().has_value()) {
    }
    try {
      setup_.arena->execute([&] { compositing_.wait(); });
    } catch (const std::bad_alloc&) {
      // A task has thrown it. All are done, and the frame has failed anyhow.
    }
  }

  void CompositeDrawn(AttemptId id, const image::DrawnPixels& pixels, std::size_t tile_count) {
    const auto composite_row = [&](int row) {
      const base::MutexLock lock(&row_locks_.OfTileRow(row));
      composite::CompositeTileRowInto(pixels.image, row, order_, &result_.image);
      if (has_layers_) {
        composite::CompositeTileRowInto(pixels.layers, row, &result_.layers);
      }
    };
    try {
      const int rows = pixels.image.touched.rows();
      if (tile_count < kTilesPerHelper) {
        for (int row = 0; row < rows; ++row) {
          composite_row(row);
        }
      } else {
        tbb::parallel_for(0, rows, composite_row);
      }
    } catch (const std::bad_alloc&) {
      ReportDamage(id, NoMemoryForLayers());
    }
  }

  static absl::Status NoMemoryForLayers() {
    return absl::ResourceExhaustedError("the coordinator has no memory for more layers");
  }

  void CompositeBand(AttemptId id, absl::string_view band) {
    const base::TraceScope trace(setup_.trace, "composite");
    const frame::FrameSpec& spec = *setup_.spec;
    const composite::SurfaceCounts surfaces{
        .opaque = spec.sends_normals ? frame::OwnerSurfaceCount(spec) : spec.surfaces.size(),
        .layers = spec.surfaces.size()};
    absl::Status status;
    try {
      status = composite::DecodePixelsInto(band, order_, surfaces, &result_.image, &row_locks_,
                                           has_layers_ ? &result_.layers : nullptr);
    } catch (const std::bad_alloc&) {
      status = NoMemoryForLayers();
    }
    if (!status.ok()) {
      ReportDamage(id, status);
    }
  }

  void ReportDamage(AttemptId id, const absl::Status& status) ABSL_LOCKS_EXCLUDED(damage_mutex_) {
    const base::MutexLock lock(&damage_mutex_);
    damages_.emplace_back(id,
                          absl::Status(status.code(), absl::StrCat("pixels: ", status.message())));
    queue_.Push({id, absl::Now(), PixelsDamaged{}, std::nullopt});
  }

  // Returns once all bands that have arrived are in the image. What was damaged is not, and its
  // part is repeated.
  absl::Status FinishCompositing() ABSL_LOCKS_EXCLUDED(damage_mutex_) {
    {
      const base::TraceScope trace(setup_.trace, "finish compositing");
      setup_.arena->execute([&] {
        while (CompositeNext()) {
        }
        compositing_.wait();
      });
      has_tasks_ = false;
    }
    std::vector<std::pair<AttemptId, absl::Status>> damages;
    {
      const base::MutexLock lock(&damage_mutex_);
      damages.swap(damages_);
    }
    for (const auto& [id, status] : damages) {
      const Part& part = parts_[id.part];
      if (part.winner != id.replica && (part.winner.has_value() || !AttemptOf(id).is_live)) {
        continue;  // another attempt has sent all pixels, or will
      }
      ISOSCOPE_RETURN_IF_ERROR(Fail(id, status));
    }
    return absl::OkStatus();
  }

  absl::Status HandleRayHits(AttemptId id, RayHits hits) {
    Attempt& attempt = AttemptOf(id);
    Part& part = parts_[id.part];
    if (attempt.stage != FrameStage::kSelectingOccluders) {
      return OutOfOrder(id, "ray hits");
    }
    attempt.stage = FrameStage::kRenderingOccluders;
    if (part.stage != FrameStage::kSelectingOccluders) {  // an earlier attempt had told the same
      if (AllAt(FrameStage::kRenderingOccluders)) {
        attempt.link->SendOccluders(part.occluders);
      }
      return absl::OkStatus();
    }
    SetStage(FrameStage::kRenderingOccluders, &part);
    hits_.InsertAll(hits.hits);
    if (setup_.active == nullptr) {
      reported_[id.part] = std::move(hits.active);
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
    result_.ray_hit_block_count = hits_.Count();
    const ActiveBlocks& active = *result_.active;
    occluding_ = visibility::OccludingBlocks(hits_, *setup_.layout, active.set);
    if (footprints_.empty()) {
      FindFootprints(active);
    }
    std::vector<Selection> selections =
        SelectBlocks([&](std::size_t active_index, Selection* part) {
          if (occluding_.Contains(active.ids[active_index]) &&
              !footprints_[active_index].rect.empty()) {
            part->blocks.push_back(active.ids[active_index]);
          }
        });
    ForEachPart([&](std::size_t i) {
      parts_[i].occluders = std::move(selections[i].blocks);
      for (Attempt& attempt : parts_[i].attempts) {
        if (attempt.is_live && attempt.stage == FrameStage::kRenderingOccluders) {
          attempt.link->SendOccluders(parts_[i].occluders);
        }
      }
    });
  }

  // Calls fn(part index) for every part, in parallel: a message is encoded while others are sent.
  // Isolated: this thread must not draw for an agent of this process that has its message already.
  template <typename Fn>
  void ForEachPart(const Fn& fn) {
    setup_.arena->execute([&] {
      tbb::this_task_arena::isolate([&] { tbb::parallel_for(std::size_t{0}, parts_.size(), fn); });
    });
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

  // The blocks that one part draws in a step.
  struct Selection {
    std::vector<volume::BlockId> blocks;
    std::vector<image::PixelMask> open;  // the pixels that each could win; or none
  };

  // Calls select(active index, selection to add it to) for every active block, in parallel, and
  // joins the selections of each part in order.
  template <typename Fn>
  [[nodiscard]] std::vector<Selection> SelectBlocks(const Fn& select) const {
    const ActiveBlocks& active = *result_.active;
    struct Task {
      std::size_t part_index = 0;
      std::size_t begin = 0;
      std::size_t end = 0;
      Selection selection;
    };
    std::vector<Task> tasks;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
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
          select(active_index, &task.selection);
        }
      });
    });
    std::vector<Selection> selections(parts_.size());
    for (Task& task : tasks) {
      Selection& of_part = selections[task.part_index];
      Selection& of_task = task.selection;
      of_part.blocks.insert(of_part.blocks.end(), of_task.blocks.begin(), of_task.blocks.end());
      std::move(of_task.open.begin(), of_task.open.end(), std::back_inserter(of_part.open));
    }
    return selections;
  }

  absl::Status HandleOccludersDone(AttemptId id) {
    Attempt& attempt = AttemptOf(id);
    Part& part = parts_[id.part];
    if (!IsAt(attempt, FrameStage::kRenderingOccluders)) {
      return OutOfOrder(id, "the end of the occluders");
    }
    attempt.stage = FrameStage::kRenderingVisible;
    if (part.stage != FrameStage::kRenderingOccluders) {
      if (AllAt(FrameStage::kRenderingVisible)) {
        attempt.link->SendVisibleBlocks(part.visible, part.open_pixels);
      }
      return absl::OkStatus();
    }
    SetStage(FrameStage::kRenderingVisible, &part);
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
    std::vector<Selection> selections =
        SelectBlocks([&](std::size_t active_index, Selection* part) {
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
    ForEachPart([&](std::size_t i) {
      Part& part = parts_[i];
      part.visible = std::move(selections[i].blocks);
      if (has_depth) {
        part.open_pixels = visibility::EncodeOpenPixels(selections[i].open);
      }
      const bool is_only_attempt = part.attempts.size() == 1 && !HasSpare(i);
      for (Attempt& attempt : part.attempts) {
        if (attempt.is_live && attempt.stage == FrameStage::kRenderingVisible) {
          attempt.link->SendVisibleBlocks(part.visible, is_only_attempt
                                                            ? std::exchange(part.open_pixels, {})
                                                            : part.open_pixels);
        }
      }
    });
  }

  // Returns true if every part is at `stage` or farther.
  [[nodiscard]] bool AllAt(FrameStage stage) const {
    return std::all_of(parts_at_.begin(), parts_at_.begin() + static_cast<std::ptrdiff_t>(stage),
                       [](std::size_t count) { return count == 0; });
  }

  // Returns true if the attempt is at `stage` and was asked for it. A step begins once all parts
  // are there.
  [[nodiscard]] bool IsAt(const Attempt& attempt, FrameStage stage) const {
    return attempt.stage == stage && AllAt(stage);
  }
  [[nodiscard]] bool IsRendering(const Attempt& attempt) const {
    return IsAt(attempt, FrameStage::kRenderingOccluders) ||
           IsAt(attempt, FrameStage::kRenderingVisible);
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
    // The last step ends a second time if its last pixels were damaged.
    *duration += std::max(now - phase_start_, absl::ZeroDuration());
    phase_start_ = std::max(now, phase_start_);
  }

  // Notes the agent that failed. Tries its part elsewhere if nobody else works on it; if there is
  // no other agent, the frame ends with the error.
  absl::Status Fail(AttemptId id, const absl::Status& status) {
    Part& part = parts_[id.part];
    Attempt& attempt = AttemptOf(id);
    NoteFailure(id, attempt.stage, status);
    attempt.is_live = false;
    attempt.link->Cancel();
    if (part.winner == id.replica) {  // it had said that it was done
      part.winner.reset();
      SetStage(FrameStage::kRenderingVisible, &part);
    }
    if (LiveCount(part) > 0) {
      return absl::OkStatus();
    }
    if (HasSpare(id.part) && IsRepeatable(status)) {
      return BeginAttempt(id.part);
    }
    lost_part_ = id.part;
    absl::Status error = failures_.back().ToStatus();
    if (part.attempts.size() == 1) {
      return error;
    }
    absl::Status of_last(error.code(),
                         absl::StrCat(error.message(), " (the last of ", part.attempts.size(),
                                      " agents that serve it)"));
    error.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) {
      of_last.SetPayload(url, payload);  // when to retry
    });
    return of_last;
  }

  // Returns the parts without an agent that could do them, ascending. A rack is lost as a whole: of
  // its agents, some have said so, and others no longer answer. REQUIRES: `lost_part_`.
  std::vector<std::size_t> LostParts() {
    std::deque<Event> late = queue_.TakeAll();
    std::move(late.begin(), late.end(), std::back_inserter(arrived_));
    for (const Event& event : arrived_) {
      const End* const end = std::get_if<End>(&event.what);
      Attempt& attempt = AttemptOf(event.from);
      if (end != nullptr && attempt.is_live && attempt.stage != FrameStage::kDone &&
          IsLoss(end->status)) {
        attempt.is_live = false;
        NoteFailure(event.from, attempt.stage, end->status);
      }
    }
    std::vector<std::size_t> lost;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      if (i == *lost_part_ || IsLost(i)) {
        lost.push_back(i);
      }
    }
    return lost;
  }

  // Returns true if no replica of the part can do it.
  [[nodiscard]] bool IsLost(std::size_t part_index) const {
    const std::vector<Attempt>& attempts = parts_[part_index].attempts;
    for (std::size_t i = 0; i < static_cast<std::size_t>(setup_.replica_counts[part_index]); ++i) {
      const bool has_failed = i < attempts.size() && attempts[i].has_failed;
      const bool is_gone = setup_.is_lost != nullptr &&
                           setup_.is_lost(static_cast<int>(part_index), static_cast<int>(i));
      if (!has_failed && !is_gone) {
        return false;
      }
    }
    return true;
  }

  void NoteFailure(AttemptId id, FrameStage stage, absl::Status status) {
    AttemptOf(id).has_failed = true;
    failures_.push_back({.part_index = id.part,
                         .agent = AttemptOf(id).link->agent(),
                         .stage = stage,
                         .status = std::move(status)});
  }

  absl::Status OutOfOrder(AttemptId id, const char* what) {
    return Fail(id, absl::InternalError(
                        absl::StrFormat("sent %s out of order; its version may differ", what)));
  }

  // Returns the error of a passed deadline. The frame waits for the parts at the earliest stage.
  absl::Status DeadlineError() {
    // What had come before the frame could go on has been answered.
    for (const Event& event : queue_.TakeAll()) {
      Attempt& attempt = AttemptOf(event.from);
      if (attempt.is_live && event.ended_stage == attempt.stage) {
        attempt.stage = static_cast<FrameStage>(static_cast<int>(attempt.stage) + 1);
        SetStage(std::max(parts_[event.from.part].stage, attempt.stage), &parts_[event.from.part]);
      }
    }
    FrameStage slowest = FrameStage::kEnded;
    for (const Part& part : parts_) {
      slowest = std::min(slowest, part.stage);
    }
    std::vector<std::string> waiting;
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      if (parts_[i].stage != slowest) {
        continue;
      }
      for (std::size_t replica = 0; replica < parts_[i].attempts.size(); ++replica) {
        const Attempt& attempt = parts_[i].attempts[replica];
        const bool is_last = replica + 1 == parts_[i].attempts.size();
        if (attempt.is_live || (is_last && LiveCount(parts_[i]) == 0)) {
          waiting.push_back(NameOf(attempt.link->agent()));
          NoteFailure({i, replica}, slowest, absl::DeadlineExceededError("had not answered"));
        }
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
  ReadGate gate_;              // outlives the links, and what they send
  EventQueue queue_;           // outlives the links
  std::deque<Event> arrived_;  // taken out of it, and not handled yet
  const BeginAgentFrame& begin_;
  std::vector<Part> parts_;
  std::array<std::size_t, kFrameStageCount> parts_at_{};  // the number of parts, by stage
  volume::BlockSet hits_;                                 // of all parts so far
  std::vector<std::vector<volume::BlockId>> reported_;    // active blocks, by part
  volume::BlockSet occluding_;
  std::vector<view::Footprint> footprints_;  // of the active blocks
  FrameResult result_;
  composite::RowLocks row_locks_;    // of its image
  bool is_composited_into_ = false;  // result_.image
  mutable base::Mutex arrivals_mutex_;
  std::deque<Arrival> arrivals_ ABSL_GUARDED_BY(arrivals_mutex_);
  std::size_t waiting_tiles_ ABSL_GUARDED_BY(arrivals_mutex_) = 0;  // of arrivals_
  std::size_t helper_count_ ABSL_GUARDED_BY(arrivals_mutex_) = 0;   // tasks of compositing_
  tbb::task_group compositing_;
  bool has_tasks_ = false;  // since compositing_ was waited for; the frame's thread
  base::Mutex damage_mutex_;
  std::vector<std::pair<AttemptId, absl::Status>> damages_ ABSL_GUARDED_BY(damage_mutex_);
  std::vector<AgentFailure> failures_;
  std::vector<AgentIdentity> outrun_;
  std::optional<std::size_t> lost_part_;
  int hedge_count_ = 0;
};

}  // namespace

FrameOutcome RunFrame(const FrameSetup& setup, const BeginAgentFrame& begin,
                      const base::Cancellation& cancellation) {
  const view::Viewport size = setup.view->image_size();
  try {
    base::TraceScope trace(setup.trace, "take image");
    image::FrameImage image = setup.images->Take(size.width_px, size.height_px);
    trace.End();
    return Frame(setup, begin, cancellation, std::move(image)).Run();
  } catch (const std::bad_alloc&) {
    return {.status = base::OrNoMemory("a picture", [&] {
              // Not StrFormat, which ends the process if memory runs out.
              return absl::ResourceExhaustedError(
                  absl::StrCat("the coordinator has no memory for a picture of ", size.width_px,
                               " x ", size.height_px, " pixels"));
            })};
  }
}

}  // namespace isoscope::server
