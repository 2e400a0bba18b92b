#include "server/frame/frame_protocol.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/monotonic_time.h"
#include "server/frame/agent_call.h"

namespace isoscope::server {
namespace {

using Kind = Command::Kind;

// A part that takes less is never too slow: a second attempt costs about as much.
constexpr absl::Duration kMinSlowDuration = absl::Milliseconds(40);
// An attempt that takes longer than this share of its time to the deadline is hedged.
constexpr int kDeadlineShare = 4;

// Returns true if another agent might succeed. The frame's own end is no failure of an agent.
bool IsRepeatable(const absl::Status& status) {
  return !absl::IsCancelled(status) && !absl::IsDeadlineExceeded(status);
}

struct WordRule {
  const char* name;
  std::optional<PartStage> ends;
};
constexpr std::array<WordRule, 6> kWords = {{
    // indexed by AgentWord
    {"ray hits", PartStage::kSelectingOccluders},
    {"pixels", std::nullopt},
    {"the end of the occluders", PartStage::kRenderingOccluders},
    {"the end of the frame", PartStage::kRenderingVisible},
    {"the end of the stream", PartStage::kDone},
    {"damaged pixels", std::nullopt},
}};
constexpr const WordRule& RuleOf(AgentWord word) { return kWords[static_cast<std::size_t>(word)]; }

// Returns the error of the last of `attempt_count` agents.
absl::Status OfLastAgent(const absl::Status& error, std::size_t attempt_count) {
  if (attempt_count == 1) {
    return error;
  }
  absl::Status of_last(error.code(), absl::StrCat(error.message(), " (the last of ", attempt_count,
                                                  " agents that serve it)"));
  error.ForEachPayload([&](absl::string_view url, const absl::Cord& payload) {
    of_last.SetPayload(url, payload);  // the retry delay
  });
  return of_last;
}

}  // namespace

std::optional<PartStage> EndedStage(AgentWord word, const absl::Status& status) {
  return status.ok() ? RuleOf(word).ends : std::nullopt;
}

FrameProtocol::FrameProtocol(const ReplicaSetup& setup, PartStage first_stage,
                             base::MonotonicTime begin, base::MonotonicTime deadline)
    : setup_(setup),
      first_stage_(first_stage),
      begin_(begin),
      deadline_(deadline),
      parts_(setup.replica_counts.size(), {.stage = first_stage}),
      step_(first_stage) {}

Commands FrameProtocol::Begin() {
  Commands commands;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    commands.push_back(TryNextReplica(i));
  }
  return commands;
}

// REQUIRES: the part has a next replica.
Command FrameProtocol::TryNextReplica(std::size_t part_index) {
  std::vector<Attempt>& attempts = parts_[part_index].attempts;
  attempts.push_back({.stage = first_stage_});
  return {.kind = Kind::kBegin, .attempt = {part_index, attempts.size() - 1}};
}

void FrameProtocol::NoteBegun(AttemptId id, AgentIdentity agent, base::MonotonicTime now) {
  AttemptOf(id).agent = std::move(agent);
  AttemptOf(id).begin = now;
}

absl::StatusOr<Commands> FrameProtocol::Handle(const AgentEvent& event) {
  Attempt& attempt = AttemptOf(event.from);
  if (event.word == AgentWord::kDamaged) {
    // Otherwise another attempt has sent all pixels, or will.
    const bool counts = attempt.is_live || parts_[event.from.part].winner == event.from.replica;
    return counts ? Fail(event.from, event.status) : Commands{};
  }
  if (!attempt.is_live) {
    return Commands{};
  }
  last_arrival_ = event.arrival;
  // An agent that is lost after its last word has done its part.
  const bool is_done = attempt.stage == PartStage::kDone && absl::IsUnavailable(event.status);
  if (!event.status.ok() && !is_done) {
    return absl::IsDeadlineExceeded(event.status) ? absl::StatusOr<Commands>(event.status)
                                                  : Fail(event.from, event.status);
  }
  // A step begins once all parts have reached its stage.
  const bool is_asked = step_ >= std::min(attempt.stage, PartStage::kRenderingVisible);
  if (event.word == AgentWord::kPixels) {
    const bool draws = attempt.stage == PartStage::kRenderingOccluders ||
                       attempt.stage == PartStage::kRenderingVisible;
    return draws && is_asked ? Commands{{.attempt = event.from}} : OutOfOrder(event);
  }
  if (RuleOf(event.word).ends != attempt.stage || !is_asked) {
    return OutOfOrder(event);
  }
  attempt.stage = NextStage(attempt.stage);
  switch (attempt.stage) {
    case PartStage::kEnded:
      attempt.is_live = false;
      parts_[event.from.part].stage_begin = last_arrival_;
      return Commands{};
    case PartStage::kDone:
      return Win(event.from);
    default:
      return ReachStage(event.from);
  }
}

// REQUIRES: the attempt is at step 2 or 3.
Commands FrameProtocol::ReachStage(AttemptId id) {
  Part& part = parts_[id.part];
  const PartStage stage = AttemptOf(id).stage;
  if (part.stage >= stage) {  // an earlier attempt has reached the stage already
    return step_ >= stage ? Commands{Send(id)} : Commands{};
  }
  part.stage = stage;
  part.stage_begin = last_arrival_;
  Commands commands{{.attempt = id}};
  if (awaited().stage >= stage) {
    commands.push_back({.kind = Kind::kStep, .stage = stage});
  }
  return commands;
}

Commands FrameProtocol::Win(AttemptId id) {
  Part& part = parts_[id.part];
  part.winner = id.replica;
  part.stage_begin = last_arrival_;
  Commands commands{{.attempt = id}};
  for (std::size_t i = 0; i < part.attempts.size(); ++i) {
    Attempt& other = part.attempts[i];
    if (i != id.replica && other.is_live) {
      other.is_live = false;
      commands.push_back({.kind = Kind::kCancel, .attempt = {id.part, i}});
      if (i < id.replica) {
        report_.lost_hedges.push_back(other.agent);
      }
    }
  }
  if (awaited().stage >= PartStage::kDone) {
    commands.push_back({.kind = Kind::kStep, .stage = PartStage::kDone});
  }
  return commands;
}

// Tries the part on another agent if no other attempt is under way. If there is no other agent, the
// frame ends with the error.
absl::StatusOr<Commands> FrameProtocol::Fail(AttemptId id, const absl::Status& status) {
  Part& part = parts_[id.part];
  NoteFailure(id, std::min(AttemptOf(id).stage, PartStage::kDone), status);
  AttemptOf(id).is_live = false;
  if (part.winner == id.replica) {  // it had said that it was done
    part.winner.reset();
  }
  Commands commands{{.kind = Kind::kCancel, .attempt = id}};
  if (part.live_count() > 0) {
    return commands;
  }
  if (HasSpare(id.part) && IsRepeatable(status)) {
    commands.push_back(TryNextReplica(id.part));
    return commands;
  }
  if (LacksParts(status)) {
    lost_part_ = id.part;
  }
  return OfLastAgent(report_.failures.back().ToStatus(), part.attempts.size());
}

absl::StatusOr<Commands> FrameProtocol::OutOfOrder(const AgentEvent& event) {
  return Fail(event.from,
              absl::InternalError(absl::StrFormat("sent %s out of order; its version may differ",
                                                  RuleOf(event.word).name)));
}

void FrameProtocol::NoteFailure(AttemptId id, PartStage stage, absl::Status status) {
  AttemptOf(id).has_failed = true;
  report_.failures.push_back({.part_index = id.part,
                              .agent = AttemptOf(id).agent,
                              .stage = stage,
                              .status = std::move(status)});
}

Commands FrameProtocol::BeginStep(PartStage stage) {
  step_ = stage;
  Commands commands;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    for (std::size_t replica = 0; replica < parts_[i].attempts.size(); ++replica) {
      const Attempt& attempt = parts_[i].attempts[replica];
      if (attempt.is_live && attempt.stage == stage && stage < PartStage::kDone) {
        commands.push_back(Send({i, replica}));
      }
    }
  }
  return commands;
}

Command FrameProtocol::Send(AttemptId id) const {
  const std::vector<Attempt>& attempts = parts_[id.part].attempts;
  return {.kind = Kind::kSend,
          .attempt = id,
          .stage = attempts[id.replica].stage,
          .is_only_attempt = attempts.size() == 1 && !HasSpare(id.part)};
}

Commands FrameProtocol::Watch(base::MonotonicTime now, base::MonotonicTime step_begin) {
  Commands commands;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    const Part& part = parts_[i];
    if (part.winner.has_value() || !HasSpare(i) || part.live_count() != 1) {
      continue;
    }
    const auto live = std::find_if(part.attempts.begin(), part.attempts.end(),
                                   [](const Attempt& attempt) { return attempt.is_live; });
    if (IsGone(i, static_cast<std::size_t>(live - part.attempts.begin())) ||
        now - live->begin > (deadline_ - live->begin) / kDeadlineShare) {
      commands.push_back(TryNextReplica(i));
    } else if (IsSlow(part, now, step_begin) && setup_.may_hedge != nullptr &&
               setup_.may_hedge(static_cast<int>(i), static_cast<int>(part.attempts.size()))) {
      ++report_.hedge_count;
      commands.push_back(TryNextReplica(i));
    }
  }
  return commands;
}

// Returns true if a part takes twice as long as the slowest of the parts that have arrived, and
// those are at least half of all.
bool FrameProtocol::IsSlow(const Part& part, base::MonotonicTime now,
                           base::MonotonicTime step_begin) const {
  std::size_t behind = 0;
  absl::Duration slowest = kMinSlowDuration / 2;
  for (const Part& other : parts_) {
    if (other.progress() <= part.stage) {
      ++behind;
    } else {
      slowest = std::max(slowest, other.stage_begin - step_begin);
    }
  }
  return 2 * behind <= parts_.size() && now - step_begin > 2 * slowest;
}

bool FrameProtocol::IsGone(std::size_t part_index, std::size_t replica) const {
  return setup_.is_lost != nullptr &&
         setup_.is_lost(static_cast<int>(part_index), static_cast<int>(replica));
}

bool FrameProtocol::IsLost(std::size_t part_index) const {
  const std::vector<Attempt>& attempts = parts_[part_index].attempts;
  for (std::size_t i = 0; i < static_cast<std::size_t>(setup_.replica_counts[part_index]); ++i) {
    const bool has_failed = i < attempts.size() && attempts[i].has_failed;
    if (!has_failed && !IsGone(part_index, i)) {
      return false;
    }
  }
  return true;
}

absl::Status FrameProtocol::DeadlineError(absl::Span<const AgentEvent> late,
                                          base::MonotonicTime now) {
  for (const AgentEvent& event : late) {  // the events that have come count as answers
    Attempt& attempt = AttemptOf(event.from);
    Part& part = parts_[event.from.part];
    if (attempt.is_live && EndedStage(event.word, event.status) == attempt.stage) {
      attempt.stage = NextStage(attempt.stage);
      part.stage = std::max(part.stage, std::min(attempt.stage, PartStage::kRenderingVisible));
      if (attempt.stage == PartStage::kDone) {
        part.winner = event.from.replica;
      }
    }
  }
  const PartStage slowest = awaited().stage;
  std::vector<std::string> waiting;
  for (std::size_t i = 0; i < parts_.size(); ++i) {
    if (parts_[i].progress() != slowest) {
      continue;
    }
    for (std::size_t replica = 0; replica < parts_[i].attempts.size(); ++replica) {
      const Attempt& attempt = parts_[i].attempts[replica];
      const bool is_last = replica + 1 == parts_[i].attempts.size();
      if (attempt.is_live || (is_last && parts_[i].live_count() == 0)) {
        waiting.push_back(NameOf(attempt.agent));
        NoteFailure({i, replica}, slowest, absl::DeadlineExceededError("had not answered"));
      }
    }
  }
  return absl::DeadlineExceededError(
      absl::StrFormat("the frame's deadline passed after %s; not answered: %s",
                      absl::FormatDuration(absl::Trunc(now - begin_, absl::Milliseconds(1))),
                      absl::StrJoin(waiting, ", ")));
}

std::vector<std::size_t> FrameProtocol::LostParts(absl::Span<const AgentEvent> late) {
  for (const AgentEvent& event : late) {
    Attempt& attempt = AttemptOf(event.from);
    if (event.word == AgentWord::kEnd && attempt.is_live && attempt.stage != PartStage::kDone &&
        LacksParts(event.status)) {
      attempt.is_live = false;
      NoteFailure(event.from, attempt.stage, event.status);
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

FrameProtocol::Awaited FrameProtocol::awaited() const {
  Awaited awaited;
  for (const Part& part : parts_) {
    const PartStage progress = part.progress();
    if (progress < awaited.stage) {
      awaited = {.count = 0, .stage = progress};
    }
    awaited.count += progress == awaited.stage ? 1 : 0;
  }
  return awaited;
}

}  // namespace isoscope::server
