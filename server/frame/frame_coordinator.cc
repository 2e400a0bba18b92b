// One thread runs a frame. It waits for the events of the agents, gives each to the protocol, and
// executes the commands of the protocol:
//
//   1. Begin the links of all parts; prepare the known active blocks meanwhile.
//   2. Composite the waiting pixels until the frame can go on. Then wait for events.
//   3. Handle each event. Its content goes to the reduction, or to the queue of pixels.
//   4. At the end of a step: wait for its pixels, compute the next blocks, tell each part its
//      blocks.
//   5. From 2, until all parts have ended and all pixels are composited.
//
// The threads of a frame. [X] is the lock that an arrow takes:
//
//   threads of gRPC,                    the frame's thread,               threads of the arena,
//   one at a time for a stream          of Admission                      for all frames
//   ---------------------------------   -------------------------------   -------------------------
//   FrameStream::OnReadDone
//     ReadGate::Add [G]
//     EventQueue::Push ------ [E] ----> PopAll sleeps until ready
//       ^                               FrameProtocol::Handle
//       |                               PixelQueue::Push ------ [P] ----> Help takes an arrival and
//       |                               CompositeOne does as Help         composites it [R]
//       +-- damaged pixels -- [E] ----- of either ----------------------- thread
//     StartRead <- a Hold ends - [G] -- on either ----------------------- thread
//   StartWrite <- blocks to draw [S] -- Begin, Do(kSend); or ------------ SelectOccluders or
//                                                                         SelectVisible
//   OnDone calls OnEnd, ends -- [S] --> ~AgentLink waits for the end
//
//   [E] EventQueue::mutex_    events, and how many of them end the step
//   [P] PixelQueue::mutex_    arrivals, helpers, damages
//   [R] RowLocks              one row of tiles of the image
//   [G] ReadGate::mutex_      bytes that wait, streams that wait to read
//   [S] FrameStream::mutex_   messages to write, the ends of reads and of the stream
//
// No thread holds two of these locks. Threads of gRPC wait for nothing else. A stream that the gate
// stops has no read in flight, so gRPC's flow control stops its agent. The frame's thread waits in
// PopAll (events, deadline, cancellation, and every 10 ms if there are spare replicas), in Finish
// and Abandon (helpers), and in ~AgentLink. FrameTicket::TakeMemory has waited for memory before.
// FrameTicket::Cancel, on a thread of gRPC, wakes PopAll by a callback [E].
//
// Agents of this process hand images over by a mailbox (OnDrawnPixels), past the gate.
//
// A frame that fails cancels all agents and waits until their streams have ended, so that no agent
// works for it when RunFrame returns.

#include "server/frame/frame_coordinator.h"

#include <algorithm>
#include <deque>
#include <iterator>
#include <new>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/monotonic_time.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/base/trace_recorder.h"
#include "server/frame/event_queue.h"
#include "server/frame/frame_protocol.h"
#include "server/frame/pixel_queue.h"
#include "server/frame/read_gate.h"

namespace isoscope::server {
namespace {

// The interval of checks for late parts, in a frame that has spare replicas.
constexpr absl::Duration kWatchInterval = absl::Milliseconds(10);

PartStage FirstStage(const FrameSetup& setup) {
  return setup.spec->culling == frame::Culling::kNone ? PartStage::kRenderingVisible
                                                      : PartStage::kSelectingOccluders;
}

class Frame {
 public:
  Frame(const FrameSetup& setup, const BeginAgentFrame& begin,
        const base::Cancellation& cancellation, image::FrameImage image)
      : setup_(setup),
        begin_(begin),
        cancellation_(cancellation),
        start_(base::MonotonicNow()),
        phase_start_(start_),
        gate_(setup.max_waiting_bytes),
        protocol_(setup, FirstStage(setup), start_, cancellation.deadline()),
        links_(setup.replica_counts.size()),
        reduction_(setup, links_.size(), std::move(image)),
        pixels_(&reduction_, setup.arena, [this] {
          queue_.Push(
              {.said = {.from = {}, .word = AgentWord::kDamaged, .arrival = base::MonotonicNow()}});
        }) {
    result_.agents.resize(links_.size());
  }
  // A stream ends only after its last read.
  ~Frame() { gate_.Open(); }
  Frame(const Frame&) = delete;
  Frame& operator=(const Frame&) = delete;

  FrameOutcome Run() {
    FrameOutcome outcome;
    outcome.status = base::OrNoMemory("the frame", [this] { return BeginAndDrive(); });
    if (outcome.status.ok()) {
      for (std::size_t i = 0; i < links_.size(); ++i) {
        result_.network_bytes += LinkOf(protocol_.WinnerOf(i)).network_bytes();
      }
    } else {
      if (protocol_.has_lost_part()) {
        outcome.lost_parts = protocol_.LostParts(TakeLate());
      }
      for (std::vector<Link>& of_part : links_) {
        for (Link& link : of_part) {
          link.link->Cancel();
        }
      }
      pixels_.Abandon();
    }
    {
      const base::TraceScope trace(setup_.trace, "end streams");
      gate_.Open();
      links_.clear();
    }
    static_cast<AgentReport&>(outcome) = protocol_.TakeReport();
    if (outcome.status.ok()) {
      outcome.result = TakeResult();
    }
    return outcome;
  }

 private:
  struct Link {
    std::unique_ptr<QueueingListener> listener;  // outlives the link
    std::unique_ptr<AgentLink> link;
  };

  absl::Status BeginAndDrive() {
    BeginPhase(FirstStage(setup_) == PartStage::kSelectingOccluders
                   ? FramePhase::kOccluderSelection
                   : FramePhase::kVisibilityCulling);
    ISOSCOPE_RETURN_IF_ERROR(Do(protocol_.Begin(), nullptr));
    if (FirstStage(setup_) == PartStage::kSelectingOccluders) {
      reduction_.Prepare();  // while the agents cast rays
    }
    while (protocol_.awaited().stage != PartStage::kEnded) {
      ISOSCOPE_RETURN_IF_ERROR(HandleNextEvents());
      if (protocol_.awaited().stage == PartStage::kEnded) {
        // The frame continues if the last pixels of a part were damaged: the part is repeated.
        ISOSCOPE_RETURN_IF_ERROR(FinishCompositing());
      }
    }
    return absl::OkStatus();
  }

  absl::Status HandleNextEvents() {
    const bool watches = protocol_.has_replicas();
    const base::MonotonicTime wake =
        watches ? base::MonotonicNow() + kWatchInterval : base::MonotonicTime::InfiniteFuture();
    queue_.SetNeeded(protocol_.awaited());
    CompositeUntilEvent(wake);
    base::TraceScope wait(setup_.trace, "wait for agents");
    absl::StatusOr<std::deque<FrameEvent>> events = queue_.PopAll(wake, cancellation_);
    wait.End();
    if (!events.ok()) {
      return absl::IsDeadlineExceeded(events.status()) ? DeadlineError() : events.status();
    }
    arrived_ = *std::move(events);
    while (!arrived_.empty()) {
      FrameEvent event = std::move(arrived_.front());
      arrived_.pop_front();
      ISOSCOPE_RETURN_IF_ERROR(Handle(std::move(event)));
    }
    return watches ? Do(protocol_.Watch(base::MonotonicNow(), phase_start_), nullptr)
                   : absl::OkStatus();
  }

  // Composites pixels until an event lets the frame go on, until `wake`, or until none are left.
  void CompositeUntilEvent(base::MonotonicTime wake) {
    const base::MonotonicTime end = std::min(wake, cancellation_.deadline());
    while (!queue_.is_ready() && !pixels_.empty() && !cancellation_.is_cancelled() &&
           base::MonotonicNow() < end) {
      pixels_.CompositeOne();
    }
  }

  absl::Status Handle(FrameEvent event) {
    if (event.said.word == AgentWord::kDamaged) {
      return FinishCompositing();
    }
    last_arrival_ = event.said.arrival;
    absl::StatusOr<Commands> commands = protocol_.Handle(event.said);
    if (!commands.ok()) {
      return absl::IsDeadlineExceeded(commands.status()) ? DeadlineError() : commands.status();
    }
    return Do(*commands, &event);
  }

  // event: the event that the commands answer
  absl::Status Do(const Commands& commands, FrameEvent* event) {
    for (const Command& command : commands) {
      switch (command.kind) {
        case Command::Kind::kBegin:
          ISOSCOPE_RETURN_IF_ERROR(Begin(command.attempt));
          break;
        case Command::Kind::kCancel:
          LinkOf(command.attempt).Cancel();
          break;
        case Command::Kind::kReduce:
          ISOSCOPE_RETURN_IF_ERROR(Reduce(command.attempt, std::move(event->content)));
          break;
        case Command::Kind::kSend:
          Send(command, reduction_.BlocksOf(command.attempt.part));
          break;
        case Command::Kind::kStep:
          ISOSCOPE_RETURN_IF_ERROR(BeginStep(command.stage));
          break;
      }
    }
    return absl::OkStatus();
  }

  absl::Status Begin(AttemptId id) {
    auto listener = std::make_unique<QueueingListener>(id, FirstStage(setup_), &queue_, &gate_);
    const base::MonotonicTime begin = base::MonotonicNow();
    ISOSCOPE_ASSIGN_OR_RETURN(
        std::unique_ptr<AgentLink> link,
        begin_(static_cast<int>(id.part), static_cast<int>(id.replica), listener.get()));
    protocol_.NoteBegun(id, link->agent(), begin);
    links_[id.part].push_back({std::move(listener), std::move(link)});
    return absl::OkStatus();
  }

  absl::Status Reduce(AttemptId id, FrameEvent::Content content) {
    if (auto* hits = std::get_if<RayHits>(&content)) {
      reduction_.AddRayHits(id.part, hits->hits, std::move(hits->active));
    } else if (auto* bands = std::get_if<Bands>(&content)) {
      pixels_.Push(id, std::move(*bands));
    } else if (auto* statistics = std::get_if<frame::AgentStatistics>(&content)) {
      result_.agents[id.part] = std::move(*statistics);
    } else if (auto* drawn = std::get_if<image::DrawnPixels>(&content)) {
      absl::Status fits = reduction_.CheckSize(*drawn);
      if (!fits.ok()) {
        return HandleDamage({id, AgentWord::kDamaged, last_arrival_, std::move(fits)});
      }
      pixels_.Push(id, std::move(*drawn));
    }
    return absl::OkStatus();
  }

  absl::Status HandleDamage(const AgentEvent& damage) {
    ISOSCOPE_ASSIGN_OR_RETURN(const Commands commands, protocol_.Handle(damage));
    return Do(commands, nullptr);
  }

  // Returns once all valid pixels that have arrived are in the image. Damaged pixels are left out,
  // and their part is repeated.
  absl::Status FinishCompositing() {
    base::TraceScope trace(setup_.trace, "finish compositing");
    const std::vector<AgentEvent> damages = pixels_.Finish();
    trace.End();
    for (const AgentEvent& damage : damages) {
      ISOSCOPE_RETURN_IF_ERROR(HandleDamage(damage));
    }
    return absl::OkStatus();
  }

  // All parts have reached `stage`: computes what they need, and sends it.
  absl::Status BeginStep(PartStage stage) {
    if (stage == PartStage::kRenderingVisible) {
      ISOSCOPE_RETURN_IF_ERROR(FinishCompositing());
    }
    const Commands sends = protocol_.BeginStep(stage);
    const auto send = [&](std::size_t part_index, Reduction::PartBlocks* blocks) {
      const auto first = std::partition_point(
          sends.begin(), sends.end(),
          [&](const Command& command) { return command.attempt.part < part_index; });
      for (auto it = first; it != sends.end() && it->attempt.part == part_index; ++it) {
        Send(*it, blocks);
      }
    };
    if (stage == PartStage::kRenderingOccluders) {
      reduction_.SelectOccluders(send);
      EndPhase(&result_.occluder_selection_duration, base::MonotonicNow(), "occluder selection",
               FramePhase::kOccluderRendering);
    } else if (stage == PartStage::kRenderingVisible) {
      reduction_.SelectVisible(send);
      EndPhase(&result_.occluder_rendering_duration, base::MonotonicNow(), "occluder rendering",
               FramePhase::kVisibilityCulling);
    } else {  // compositing follows; this phase ends again if its last pixels are damaged
      EndPhase(&result_.visibility_culling_duration, last_arrival_, "visibility culling",
               FramePhase::kFinishing);
    }
    return absl::OkStatus();
  }

  // Several threads may call it, for different parts.
  void Send(const Command& command, Reduction::PartBlocks* blocks) {
    AgentLink& link = LinkOf(command.attempt);
    if (command.stage == PartStage::kRenderingOccluders) {
      link.SendOccluders(blocks->occluders);
    } else {
      link.SendVisibleBlocks(blocks->visible, command.is_only_attempt
                                                  ? std::exchange(blocks->open_pixels, {})
                                                  : blocks->open_pixels);
    }
  }

  [[nodiscard]] AgentLink& LinkOf(AttemptId id) const { return *links_[id.part][id.replica].link; }

  void BeginPhase(FramePhase phase) {
    if (setup_.phase != nullptr) {
      setup_.phase->store(phase, std::memory_order_relaxed);
    }
    if (setup_.trace != nullptr) {
      phase_trace_start_ = base::TraceClock::now();
    }
  }

  // Notes the time since the last phase ended, and what comes next.
  void EndPhase(absl::Duration* duration, base::MonotonicTime end, const char* name,
                FramePhase next) {
    if (setup_.trace != nullptr) {
      setup_.trace->Add(name, phase_trace_start_, base::TraceClock::now());
    }
    BeginPhase(next);
    *duration += std::max(end - phase_start_, absl::ZeroDuration());
    phase_start_ = std::max(end, phase_start_);
  }

  absl::Status DeadlineError() { return protocol_.DeadlineError(TakeLate(), base::MonotonicNow()); }

  // Returns the events that have come and are not handled yet.
  std::vector<AgentEvent> TakeLate() {
    std::deque<FrameEvent> waiting = queue_.TakeAll();
    std::move(waiting.begin(), waiting.end(), std::back_inserter(arrived_));
    std::vector<AgentEvent> late;
    for (FrameEvent& event : arrived_) {
      late.push_back(std::move(event.said));
    }
    arrived_.clear();
    return late;
  }

  FrameResult TakeResult() {
    static_cast<ReducedFrame&>(result_) = reduction_.Take();
    result_.composite_duration = base::MonotonicNow() - phase_start_;
    std::sort(result_.agents.begin(), result_.agents.end(),
              [](const frame::AgentStatistics& a, const frame::AgentStatistics& b) {
                return a.shard_indices < b.shard_indices;
              });
    return std::move(result_);
  }

  const FrameSetup& setup_;
  const BeginAgentFrame& begin_;
  const base::Cancellation& cancellation_;
  const base::MonotonicTime start_;
  base::MonotonicTime phase_start_;
  base::TraceTime phase_trace_start_;  // if there is a trace
  base::MonotonicTime last_arrival_;
  ReadGate gate_;                   // outlives the links, and the messages that they deliver
  EventQueue queue_;                // outlives the links
  std::deque<FrameEvent> arrived_;  // taken out of the queue, and not handled yet
  FrameProtocol protocol_;
  std::vector<std::vector<Link>> links_;  // of the attempts
  Reduction reduction_;
  PixelQueue pixels_;
  FrameResult result_;
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
    FrameOutcome outcome;
    outcome.status = base::OrNoMemory("a picture", [&] {
      // Not StrFormat, which ends the process if memory runs out.
      return absl::ResourceExhaustedError(
          absl::StrCat("the coordinator has no memory for a picture of ", size.width_px, " x ",
                       size.height_px, " pixels"));
    });
    return outcome;
  }
}

}  // namespace isoscope::server
