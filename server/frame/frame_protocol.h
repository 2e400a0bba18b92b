// The protocol of one frame with its agents, as a state machine: events in, commands out. It has no
// threads, locks or clock. Time comes in with the events, and the driver does what the commands
// say.
//
// A part is some shards. Agents that serve all of them are its replicas. An attempt is one try of a
// part on one replica. Each attempt has a stage; a word of its agent ends the stage:
//
//   word            allowed at           then
//   ray hits        kSelectingOccluders  kRenderingOccluders
//   pixels          kRenderingOccluders  -
//                   kRenderingVisible
//   occluders done  kRenderingOccluders  kRenderingVisible
//   frame done      kRenderingVisible    kDone: the attempt wins its part
//   end, OK         kDone                kEnded
//   end, error      any                  the attempt has failed
//
// Any other word breaks the protocol: INTERNAL. So does a word at a step of the frame that has not
// begun. Without culling an attempt begins at kRenderingVisible.
//
// A step of the frame begins when every part has reached its stage. A part never goes back: its
// stage is the farthest that an attempt has reached, at most kRenderingVisible. kDone and kEnded
// are stages of attempts alone. If the pixels of a winner turn out to be damaged, that attempt has
// failed. A new attempt begins at the first stage, and the frame stays at its step.
//
// A part is tried on one replica at first. It is tried on the next one
//   * when an attempt fails, and no other one is under way;
//   * beside the first attempt, when that is late: its agent no longer answers, or it has used up
//     its share of the deadline, or it takes twice as long as the other parts at this step.
// All replicas have the frame's picture revision, and a later attempt is told what the frame knows
// already. So it sends the same as the one before. The first attempt that is done wins, and the
// others are cancelled.

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_PROTOCOL_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_PROTOCOL_H_

#include <algorithm>
#include <cstddef>
#include <functional>
#include <iterator>
#include <optional>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/types/span.h"

#include "core/base/monotonic_time.h"
#include "server/cluster/agent_failure.h"

namespace isoscope::server {

struct AttemptId {
  std::size_t part = 0;
  std::size_t replica = 0;  // in the order in which the part tries them

  friend bool operator==(const AttemptId&, const AttemptId&) = default;
};

// kDamaged comes from the driver, whose decoder found it. It may come after the attempt is done.
enum class AgentWord { kRayHits, kPixels, kOccludersDone, kFrameDone, kEnd, kDamaged };

struct AgentEvent {
  AttemptId from;
  AgentWord word = AgentWord::kEnd;
  base::MonotonicTime arrival;
  absl::Status status = absl::OkStatus();  // with kEnd and kDamaged
};

// Returns the stage that the word ends, if its agent is at that stage. An end in error ends none.
std::optional<PartStage> EndedStage(AgentWord word, const absl::Status& status);
// REQUIRES: not kEnded.
constexpr PartStage NextStage(PartStage stage) {
  return static_cast<PartStage>(static_cast<int>(stage) + 1);
}

struct Command {
  enum class Kind {
    kBegin,   // begin the attempt, then call NoteBegun
    kCancel,  // cancel the attempt
    kReduce,  // the content of this event counts
    kSend,    // send the attempt its blocks of `stage`
    kStep,    // the last part has reached `stage`: call BeginStep when it can begin
  };
  Kind kind = Kind::kReduce;
  AttemptId attempt = {};
  PartStage stage = PartStage::kSelectingOccluders;
  bool is_only_attempt = false;  // kSend: no other attempt of the part can want the blocks
};
using Commands = std::vector<Command>;

// The replicas that can work on the parts.
struct ReplicaSetup {
  // Number of replicas that can work on each part; at least 1.
  std::vector<int> replica_counts;
  // Returns true if a replica with an attempt of the part no longer answers. Null: this is unknown.
  std::function<bool(int part_index, int replica_index)> is_lost;
  // Called before a part that is only slow is also tried on a replica. Null: never hedge.
  std::function<bool(int part_index, int replica_index)> may_hedge;
};

// A frame's report on its agents.
struct AgentReport {
  // The agents that failed, including those that a replica replaced.
  std::vector<AgentFailure> failures = {};
  // The agents whose part a replica finished first.
  std::vector<AgentIdentity> lost_hedges = {};
  // Number of second attempts that may_hedge allowed.
  int hedge_count = 0;
};

// A relay may wait between kStep and BeginStep, and handle other events meanwhile.
// Thread-compatible. A call takes O(attempts) at most.
class FrameProtocol {
 public:
  // first_stage: kRenderingVisible without culling. `setup` outlives the protocol.
  FrameProtocol(const ReplicaSetup& setup, PartStage first_stage, base::MonotonicTime begin,
                base::MonotonicTime deadline);

  // The frame begins: one attempt of each part.
  Commands Begin();
  void NoteBegun(AttemptId id, AgentIdentity agent, base::MonotonicTime now);
  // An agent has spoken. An error ends the frame. DEADLINE_EXCEEDED: an agent's own deadline has
  // passed; DeadlineError returns the frame's error.
  absl::StatusOr<Commands> Handle(const AgentEvent& event);
  // Begins the step once its messages to agents are known. Returns a kSend for each attempt that
  // has reached it, in the order of the parts.
  Commands BeginStep(PartStage stage);
  // Checks the clock: begins a second attempt of each part whose first one is late. step_begin:
  // start of the last step.
  Commands Watch(base::MonotonicTime now, base::MonotonicTime step_begin);

  // Call after the frame has failed. `late`: the events that had come, and were not handled.
  //
  // Returns the error of a passed deadline, which names the agents that have not answered.
  absl::Status DeadlineError(absl::Span<const AgentEvent> late, base::MonotonicTime now);
  // Returns the parts that no agent can do, ascending: the one that ended the frame, and those that
  // were lost with it. A whole rack may be lost: some of its agents have reported errors, and
  // others no longer answer. REQUIRES: has_lost_part().
  std::vector<std::size_t> LostParts(absl::Span<const AgentEvent> late);
  // False if the same error would have occurred in other parts.
  [[nodiscard]] bool has_lost_part() const { return lost_part_.has_value(); }

  // The frame goes on when `count` parts, at least 1, have ended `stage`. kEnded: it is over.
  struct Awaited {
    std::size_t count = 0;
    PartStage stage = PartStage::kEnded;
  };
  [[nodiscard]] Awaited awaited() const;
  [[nodiscard]] bool has_replicas() const {  // any part has more than one
    return std::any_of(setup_.replica_counts.begin(), setup_.replica_counts.end(),
                       [](int count) { return count > 1; });
  }
  // REQUIRES: the frame is over.
  [[nodiscard]] AttemptId WinnerOf(std::size_t part) const { return {part, *parts_[part].winner}; }

  AgentReport TakeReport() { return std::exchange(report_, {}); }

 private:
  struct Attempt {
    AgentIdentity agent = {};
    PartStage stage = PartStage::kSelectingOccluders;
    base::MonotonicTime begin = {};
    bool is_live = true;  // else its words no longer count
    bool has_failed = false;
  };
  struct Part {
    std::vector<Attempt> attempts = {};  // in the order of their replicas
    PartStage stage = PartStage::kSelectingOccluders;
    base::MonotonicTime stage_begin = {};
    std::optional<std::size_t> winner = std::nullopt;  // among attempts

    // The stage that the frame can count on: the stage of the part, or that of its winner.
    [[nodiscard]] PartStage progress() const {
      return winner.has_value() ? attempts[*winner].stage : stage;
    }
    [[nodiscard]] auto live_count() const {
      return std::count_if(attempts.begin(), attempts.end(),
                           [](const Attempt& attempt) { return attempt.is_live; });
    }
  };

  Command TryNextReplica(std::size_t part_index);
  Commands ReachStage(AttemptId id);
  Commands Win(AttemptId id);
  absl::StatusOr<Commands> Fail(AttemptId id, const absl::Status& status);
  absl::StatusOr<Commands> OutOfOrder(const AgentEvent& event);
  void NoteFailure(AttemptId id, PartStage stage, absl::Status status);

  [[nodiscard]] Attempt& AttemptOf(AttemptId id) { return parts_[id.part].attempts[id.replica]; }
  [[nodiscard]] Command Send(AttemptId id) const;
  [[nodiscard]] bool HasSpare(std::size_t part_index) const {
    return std::ssize(parts_[part_index].attempts) < setup_.replica_counts[part_index];
  }
  [[nodiscard]] bool IsSlow(const Part& part, base::MonotonicTime now,
                            base::MonotonicTime step_begin) const;
  [[nodiscard]] bool IsGone(std::size_t part_index, std::size_t replica) const;
  [[nodiscard]] bool IsLost(std::size_t part_index) const;

  const ReplicaSetup& setup_;
  const PartStage first_stage_;
  const base::MonotonicTime begin_;
  const base::MonotonicTime deadline_;
  std::vector<Part> parts_;
  PartStage step_;  // the last one that has begun
  base::MonotonicTime last_arrival_;
  std::optional<std::size_t> lost_part_;  // it ended the frame
  AgentReport report_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_PROTOCOL_H_
