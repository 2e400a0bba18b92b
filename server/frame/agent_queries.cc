#include "server/frame/agent_queries.h"

#include <algorithm>
#include <cstddef>
#include <deque>
#include <memory>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <grpcpp/client_context.h>

#include "core/base/mutex.h"
#include "core/rpc/grpc_status.h"
#include "core/rpc/pick_convert.h"
#include "core/rpc/proto_convert.h"
#include "core/rpc/request_context.h"
#include "core/rpc/unary_checksum.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "server/frame/agent_client.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

// A question that has no answer after this time, or after this share of the time to its deadline,
// is also put to another agent. Not earlier than after kMinHedgeDelay: a second try costs as much.
constexpr absl::Duration kHedgeDelay = absl::Milliseconds(500);
constexpr absl::Duration kMinHedgeDelay = absl::Milliseconds(50);
constexpr int kHedgeDeadlineShare = 4;

// Agents that one question about the whole volume may be put to.
constexpr std::size_t kMaxBoxAgents = 4;

// One try of a question on one agent.
template <typename Response>
struct Attempt {
  std::unique_ptr<internal::PartitionAgentService::Stub> stub;
  grpc::ClientContext context;
  Response response;
  absl::Status status;  // once it has ended
  absl::Time begin = absl::Now();
  bool is_live = true;
};

// A question, and all that was tried to get its answer.
template <typename Request, typename Response>
struct Question {
  Request request;
  std::vector<AgentAssignment> agents;     // each of them can answer it; best first
  std::deque<Attempt<Response>> attempts;  // on the first of these agents, in their order
  std::optional<std::size_t> winner;       // the attempt that has the answer

  [[nodiscard]] const Response& answer() const { return attempts[*winner].response; }
};

template <typename Request, typename Response>
using Questions = std::vector<Question<Request, Response>>;

// Puts questions to agents, all at the same time. An agent that fails is replaced by the next one.
// One that is late gets company; the first answer counts, and the other attempt is cancelled.
//
// One thread runs it. Calls end on gRPC's threads, which only push their end into a queue.
template <typename Request, typename Response, typename StartFn>
class Inquiry {
 public:
  // `start(request, attempt, on_done)` starts the call of an attempt. All outlive the inquiry.
  Inquiry(const base::TraceContext& identity, const base::Cancellation& cancellation,
          const StartFn& start, Questions<Request, Response>* questions)
      : identity_(identity),
        cancellation_(cancellation),
        start_(start),
        questions_(*questions),
        hedge_delay_(std::clamp((cancellation.deadline() - absl::Now()) / kHedgeDeadlineShare,
                                kMinHedgeDelay, kHedgeDelay)) {}

  // Runs until all questions are answered, one can't be, or the cancellation fires. No call lives
  // on. An error says why not all are answered.
  absl::Status Run(QueryReport* report) {
    report_ = report;
    const base::Cancellation::Callback wake(cancellation_, [this] {
      const base::MutexLock lock(&mutex_);
      is_cancelled_ = true;
      changed_.SignalAll();
    });
    for (std::size_t i = 0; i < questions_.size(); ++i) {
      Begin(i);
    }
    while (live_count_ > 0) {
      const std::vector<End> ends = AwaitEnds();
      if (error_.ok() && cancellation_.is_cancelled()) {
        Stop(absl::CancelledError("cancelled by the caller"));
      }
      for (const End& end : ends) {
        Handle(end);
      }
      for (std::size_t i = 0; error_.ok() && i < questions_.size(); ++i) {
        if (HedgeTimeOf(questions_[i]) <= absl::Now()) {
          Begin(i);
        }
      }
    }
    return error_;
  }

 private:
  struct End {
    std::size_t question = 0;
    std::size_t attempt = 0;
  };

  // Tries a question on its next agent. REQUIRES: there is one.
  void Begin(std::size_t index) {
    Question<Request, Response>& question = questions_[index];
    const std::size_t number = question.attempts.size();
    Attempt<Response>& attempt = question.attempts.emplace_back();
    attempt.stub = internal::PartitionAgentService::NewStub(question.agents[number].channel);
    if (cancellation_.deadline() != absl::InfiniteFuture()) {
      attempt.context.set_deadline(absl::ToChronoTime(cancellation_.deadline()));
    }
    rpc::SetTraceparent(identity_, &attempt.context);
    ++live_count_;
    start_(question.request, &attempt,
           [this, &question, &attempt, end = End{index, number}](const grpc::Status& status) {
             attempt.status = rpc::CheckAnswer(question.request, rpc::ToAbslStatus(status),
                                               attempt.response, attempt.context);
             const base::MutexLock lock(&mutex_);
             ends_.push_back(end);
             changed_.SignalAll();  // with the lock: the inquiry lives no longer than its last call
           });
  }

  // Waits until calls have ended, a question is late, or the cancellation fires.
  std::vector<End> AwaitEnds() {
    absl::Time wake = absl::InfiniteFuture();
    for (const Question<Request, Response>& question : questions_) {
      wake = std::min(wake, HedgeTimeOf(question));
    }
    const bool knows_of_end = !error_.ok();
    const base::MutexLock lock(&mutex_);
    changed_.AwaitUntil(&mutex_, wake, [this, knows_of_end]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
      return !ends_.empty() || (is_cancelled_ && !knows_of_end);
    });
    return std::exchange(ends_, {});
  }

  [[nodiscard]] static bool HasSpare(const Question<Request, Response>& question) {
    return question.attempts.size() < question.agents.size();
  }
  [[nodiscard]] static int LiveCount(const Question<Request, Response>& question) {
    return static_cast<int>(std::count_if(question.attempts.begin(), question.attempts.end(),
                                          [](const auto& attempt) { return attempt.is_live; }));
  }

  // When another agent is asked beside the one that is late; never if there is none.
  [[nodiscard]] absl::Time HedgeTimeOf(const Question<Request, Response>& question) const {
    const bool may = error_.ok() && !question.winner.has_value() && HasSpare(question) &&
                     LiveCount(question) == 1;
    return may ? question.attempts.back().begin + hedge_delay_ : absl::InfiniteFuture();
  }

  // Ends all calls.
  void Stop(absl::Status error) {
    error_ = std::move(error);
    for (Question<Request, Response>& question : questions_) {
      CancelLive(&question);
    }
  }

  void CancelLive(Question<Request, Response>* question) {
    for (Attempt<Response>& attempt : question->attempts) {
      if (attempt.is_live) {
        attempt.context.TryCancel();
      }
    }
  }

  void Handle(const End& end) {
    Question<Request, Response>& question = questions_[end.question];
    Attempt<Response>& attempt = question.attempts[end.attempt];
    attempt.is_live = false;
    --live_count_;
    if (!error_.ok() || question.winner.has_value()) {
      return;  // nobody waits for it any more
    }
    if (attempt.status.ok()) {
      question.winner = end.attempt;
      for (std::size_t i = 0; i < question.attempts.size(); ++i) {
        if (question.attempts[i].is_live && i < end.attempt) {
          report_->outrun.push_back({.agent = question.agents[i].identity(),
                                     .waited = absl::Now() - question.attempts[i].begin});
        }
      }
      CancelLive(&question);
      return;
    }
    const absl::Status& status = attempt.status;
    report_->failures.push_back(
        {.part_index = end.question,
         .agent = question.agents[end.attempt].identity(),
         .stage = FrameStage::kSelectingOccluders,
         // INVALID_ARGUMENT, which the client's request caused, stays what it is.
         .status = absl::IsInvalidArgument(status) ? status : CallStatus(status, false)});
    const bool is_final =
        absl::IsInvalidArgument(status) || absl::Now() >= cancellation_.deadline();
    if (is_final || (LiveCount(question) == 0 && !HasSpare(question))) {
      Stop(absl::IsInvalidArgument(status) ? status : report_->failures.back().ToStatus());
    } else if (LiveCount(question) == 0) {
      Begin(end.question);
    }
  }

  const base::TraceContext& identity_;
  const base::Cancellation& cancellation_;
  const StartFn& start_;
  Questions<Request, Response>& questions_;
  const absl::Duration hedge_delay_;
  QueryReport* report_ = nullptr;
  absl::Status error_;
  int live_count_ = 0;
  base::Mutex mutex_;
  base::CondVar changed_;
  std::vector<End> ends_ ABSL_GUARDED_BY(mutex_);
  bool is_cancelled_ ABSL_GUARDED_BY(mutex_) = false;
};

// Puts the questions. An error says why not all are answered.
template <typename Request, typename Response, typename StartFn>
absl::Status Ask(const base::TraceContext& identity, const base::Cancellation& cancellation,
                 const StartFn& start, Questions<Request, Response>* questions,
                 QueryReport* report) {
  return Inquiry<Request, Response, StartFn>(identity, cancellation, start, questions).Run(report);
}

std::vector<AgentAssignment> AgentsOf(const FramePart& part) {
  std::vector<AgentAssignment> agents;
  for (std::size_t i = 0; i < part.replicas.size(); ++i) {
    agents.push_back(part.On(i));
  }
  return agents;
}

// Returns some agents, each of another address: first ones of their parts before second ones. The
// turn decides with which part they begin.
std::vector<AgentAssignment> AnyAgents(const QueryTarget& target) {
  const std::vector<FramePart>& parts = target.parts;
  std::vector<AgentAssignment> agents;
  bool has_more = true;
  for (std::size_t replica = 0; has_more; ++replica) {
    has_more = false;
    for (std::size_t i = 0; i < parts.size() && agents.size() < kMaxBoxAgents; ++i) {
      const FramePart& part = parts[(target.turn + i) % parts.size()];
      if (replica >= part.replicas.size()) {
        continue;
      }
      has_more = true;
      const std::string& address = part.replicas[replica].address;
      if (std::none_of(agents.begin(), agents.end(),
                       [&](const AgentAssignment& agent) { return agent.address == address; })) {
        agents.push_back(part.On(replica));
      }
    }
  }
  return agents;
}

// The outcome of an answer that makes no sense.
template <typename T, typename Request, typename Response>
QueryOutcome<T> Malformed(const Question<Request, Response>& question, std::size_t index,
                          const absl::Status& status) {
  AgentFailure failure{
      .part_index = index,
      .agent = question.agents[*question.winner].identity(),
      .stage = FrameStage::kSelectingOccluders,
      .status = absl::InternalError(absl::StrCat("sent a malformed answer: ", status.message()))};
  absl::Status error = failure.ToStatus();
  return {std::move(error), {.failures = {std::move(failure)}}};
}

}  // namespace

QueryOutcome<volume::HistogramPart> AskHistogram(const QueryTarget& target,
                                                 const rpc::HistogramQuery& query,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation) {
  Questions<internal::GetShardHistogramRequest, internal::GetShardHistogramResponse> questions(
      target.parts.size());
  for (std::size_t i = 0; i < questions.size(); ++i) {
    questions[i].agents = AgentsOf(target.parts[i]);
    internal::GetShardHistogramRequest& request = questions[i].request;
    request.set_dataset_id(target.dataset_id);
    for (const int shard : target.parts[i].shard_indices) {
      request.add_shard_indices(shard);
    }
    request.set_max_bin_count(static_cast<std::int32_t>(query.max_bin_count));
    if (query.value_range.has_value()) {
      request.mutable_value_range()->set_min(query.value_range->min);
      request.mutable_value_range()->set_max(query.value_range->max);
    }
  }
  QueryReport report;
  absl::Status error = Ask(
      identity, cancellation,
      [](const auto& request, auto* attempt, auto on_done) {
        attempt->stub->async()->GetShardHistogram(&attempt->context, &request, &attempt->response,
                                                  std::move(on_done));
      },
      &questions, &report);
  if (!error.ok()) {
    return {std::move(error), std::move(report)};
  }
  std::optional<volume::HistogramPart> whole;
  for (std::size_t i = 0; i < questions.size(); ++i) {
    absl::StatusOr<volume::HistogramPart> part = rpc::HistogramPartFromProto(questions[i].answer());
    absl::Status status = part.status();
    if (status.ok() && whole.has_value()) {
      status = volume::AddPart(*part, &*whole);
    }
    if (!status.ok()) {
      return Malformed<volume::HistogramPart>(questions[i], i, status);
    }
    if (!whole.has_value()) {
      whole = *std::move(part);
    }
  }
  return {*std::move(whole), std::move(report)};
}

QueryOutcome<ActiveExtent> AskActiveBox(const QueryTarget& target,
                                        const volume::BlockLayout& layout,
                                        const std::vector<double>& isovalues,
                                        const isoscope::v1::ClipRegion& clip,
                                        const base::TraceContext& identity,
                                        const base::Cancellation& cancellation) {
  Questions<internal::GetActiveBoxRequest, internal::GetActiveBoxResponse> questions(1);
  questions[0].agents = AnyAgents(target);
  internal::GetActiveBoxRequest& request = questions[0].request;
  request.set_dataset_id(target.dataset_id);
  for (const double isovalue : isovalues) {
    request.add_isovalues(isovalue);
  }
  *request.mutable_clip() = clip;
  QueryReport report;
  absl::Status error = Ask(
      identity, cancellation,
      [](const auto& asked, auto* attempt, auto on_done) {
        attempt->stub->async()->GetActiveBox(&attempt->context, &asked, &attempt->response,
                                             std::move(on_done));
      },
      &questions, &report);
  if (!error.ok()) {
    return {std::move(error), std::move(report)};
  }
  const internal::GetActiveBoxResponse& answer = questions[0].answer();
  absl::StatusOr<std::optional<math::IndexBox>> box = rpc::ActiveBoxFromProto(answer, layout);
  if (!box.ok()) {
    return Malformed<ActiveExtent>(questions[0], 0, box.status());
  }
  return {ActiveExtent{.active_block_count = answer.active_block_count(), .cells = *std::move(box)},
          std::move(report)};
}

QueryOutcome<std::vector<PointAnswer>> AskPoints(const QueryTarget& target,
                                                 const std::vector<ShownPoint>& points,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation) {
  Questions<internal::GetGradientsRequest, internal::GetGradientsResponse> questions(
      target.parts.size());
  for (std::size_t i = 0; i < questions.size(); ++i) {
    questions[i].agents = AgentsOf(target.parts[i]);
    internal::GetGradientsRequest& request = questions[i].request;
    request.set_dataset_id(target.dataset_id);
    for (const int shard : target.parts[i].shard_indices) {
      request.add_shard_indices(shard);
    }
    for (const ShownPoint& point : points) {
      *request.add_points() = rpc::ToProto(point.position);
      request.add_block_ids(point.block_id);
    }
  }
  QueryReport report;
  absl::Status error = Ask(
      identity, cancellation,
      [](const auto& request, auto* attempt, auto on_done) {
        attempt->stub->async()->GetGradients(&attempt->context, &request, &attempt->response,
                                             std::move(on_done));
      },
      &questions, &report);
  if (!error.ok()) {
    return {std::move(error), std::move(report)};
  }
  std::vector<std::optional<math::Vec3d>> gradients(points.size());
  std::vector<std::optional<int>> shards(points.size());
  for (std::size_t i = 0; i < questions.size(); ++i) {
    absl::Status status = rpc::AddGradients(questions[i].answer(), &gradients);
    status.Update(
        rpc::AddPointShards(questions[i].answer(), target.parts[i].shard_indices, &shards));
    if (!status.ok()) {
      return Malformed<std::vector<PointAnswer>>(questions[i], i, status);
    }
  }
  std::vector<PointAnswer> answers(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    answers[i] = {.gradient = gradients[i], .shard_index = shards[i]};
  }
  return {std::move(answers), std::move(report)};
}

}  // namespace isoscope::server
