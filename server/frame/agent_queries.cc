// Inquiry puts questions to agents, all at the same time, and runs until all are answered:
//
// 1. Begin starts the call of a question on its best agent.
// 2. AwaitEnds sleeps until a call ends, a question is late, or the request is cancelled.
// 3. Handle takes the first good answer, cancels the question's other call, or tries the next
//    agent.
// 4. A question that is late gets a second call on the next agent.
//
// Calls end on gRPC's threads, which only push their end into a queue. The callers at the end of
// this source make the questions and add their answers: histogram, active box, cell box, bounds of
// depth, points.

#include "server/frame/agent_queries.h"

#include <algorithm>
#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include <grpcpp/channel.h>
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/volume/block_set.h"
#include "isoscope/internal/v1/partition_agent_service.grpc.pb.h"
#include "rpc/grpc_status.h"
#include "rpc/request_context.h"
#include "rpc/unary_checksum.h"
#include "server/frame/agent_call.h"
#include "wire/depth_bounds_convert.h"
#include "wire/frame_convert.h"
#include "wire/pick_convert.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

namespace internal = isoscope::internal::v1;

// A question without an answer after this time, or after this share of the time to its deadline, is
// also put to another agent. This happens after kMinHedgeDelay at the earliest: a second try costs
// as much.
constexpr absl::Duration kHedgeDelay = absl::Milliseconds(500);
constexpr absl::Duration kMinHedgeDelay = absl::Milliseconds(50);
constexpr int kHedgeDeadlineShare = 4;

// One question about the whole volume is put to at most this many agents.
constexpr std::size_t kMaxBoxAgents = 4;

// One try of a question on one agent.
template <typename Response>
struct Attempt {
  std::unique_ptr<internal::PartitionAgentService::Stub> stub;
  grpc::ClientContext context;
  Response response;
  absl::Status status;  // once it has ended
  base::MonotonicTime begin = base::MonotonicNow();
  bool is_live = true;
};

// A question, with all attempts to get its answer.
template <typename Request, typename Response>
struct Question {
  Request request;
  std::vector<AgentAssignment> agents;     // each of them can answer it; best first
  std::deque<Attempt<Response>> attempts;  // on the first of these agents, in their order
  std::optional<std::size_t> winner;       // the attempt that has the answer
  bool may_hedge = true;                   // false: the answer takes long on every agent

  [[nodiscard]] const Response& answer() const { return attempts[*winner].response; }
};

template <typename Request, typename Response>
using Questions = std::vector<Question<Request, Response>>;

using Async = internal::PartitionAgentService::StubInterface::async_interface;
// Starts the call of an attempt.
template <typename Request, typename Response>
using Method = void (Async::*)(grpc::ClientContext* context, const Request* request,
                               Response* response, std::function<void(grpc::Status)> on_done);

// Puts questions to agents, all at the same time. An agent that fails is replaced by the next one.
// A late agent is hedged: the next one is asked as well, the first answer counts, and the other
// attempt is cancelled.
//
// One thread runs it. Calls end on gRPC's threads, which only push their end into a queue.
template <typename Request, typename Response>
class Inquiry {
 public:
  // All of them outlive the inquiry.
  Inquiry(const base::TraceContext& identity, const base::Cancellation& cancellation,
          Method<Request, Response> method, Questions<Request, Response>* questions)
      : identity_(identity),
        cancellation_(cancellation),
        method_(method),
        questions_(*questions),
        hedge_delay_(
            std::clamp((cancellation.deadline() - base::MonotonicNow()) / kHedgeDeadlineShare,
                       kMinHedgeDelay, kHedgeDelay)) {}

  // Runs until all questions are answered, one can't be, or the cancellation fires. All calls have
  // ended then. An error gives the reason for missing answers.
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
        if (HedgeTimeOf(questions_[i]) <= base::MonotonicNow()) {
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
    SetDeadline(cancellation_.deadline(), &attempt.context);
    rpc::SetTraceparent(identity_, &attempt.context);
    ++live_count_;
    (attempt.stub->async()->*method_)(
        &attempt.context, &question.request, &attempt.response,
        [this, &question, &attempt, end = End{index, number}](const grpc::Status& status) {
          attempt.status = rpc::CheckAnswer(question.request, rpc::ToAbslStatus(status),
                                            attempt.response, attempt.context);
          const base::MutexLock lock(&mutex_);
          ends_.push_back(end);
          changed_.SignalAll();  // with the lock: the inquiry may be destroyed after its last call
        });
  }

  // Waits until calls have ended, a question is late, or the cancellation fires.
  std::vector<End> AwaitEnds() {
    base::MonotonicTime wake = base::MonotonicTime::InfiniteFuture();
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

  // The time to hedge: to ask another agent besides the late one; never if there is none.
  [[nodiscard]] base::MonotonicTime HedgeTimeOf(const Question<Request, Response>& question) const {
    const bool may = error_.ok() && question.may_hedge && !question.winner.has_value() &&
                     HasSpare(question) && LiveCount(question) == 1;
    return may ? question.attempts.back().begin + hedge_delay_
               : base::MonotonicTime::InfiniteFuture();
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
      return;  // the question has its answer already
    }
    if (attempt.status.ok()) {
      question.winner = end.attempt;
      for (std::size_t i = 0; i < question.attempts.size(); ++i) {
        if (question.attempts[i].is_live && i < end.attempt) {
          report_->lost_hedges.push_back(
              {.agent = question.agents[i].identity(),
               .waited = base::MonotonicNow() - question.attempts[i].begin});
        }
      }
      CancelLive(&question);
      return;
    }
    const absl::Status& status = attempt.status;
    report_->failures.push_back(
        {.part_index = end.question,
         .agent = question.agents[end.attempt].identity(),
         .stage = PartStage::kAnswering,
         // INVALID_ARGUMENT, which the client's request caused, stays what it is.
         .status = absl::IsInvalidArgument(status) ? status : CallStatus(status, false)});
    const bool is_final =
        absl::IsInvalidArgument(status) || base::MonotonicNow() >= cancellation_.deadline();
    if (is_final || (LiveCount(question) == 0 && !HasSpare(question))) {
      Stop(absl::IsInvalidArgument(status) ? status : report_->failures.back().ToStatus());
    } else if (LiveCount(question) == 0) {
      Begin(end.question);
    }
  }

  const base::TraceContext& identity_;
  const base::Cancellation& cancellation_;
  const Method<Request, Response> method_;
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

// Makes one question for each part about its shards, for the part's replicas.
template <typename Request, typename Response>
Questions<Request, Response> QuestionsToParts(const QueryTarget& target) {
  Questions<Request, Response> questions(target.parts.size());
  for (std::size_t i = 0; i < questions.size(); ++i) {
    const FramePart& part = target.parts[i];
    for (std::size_t replica = 0; replica < part.replicas.size(); ++replica) {
      questions[i].agents.push_back(part.On(replica));
    }
    questions[i].request.set_dataset_id(target.dataset_id);
    questions[i].request.mutable_shard_indices()->Assign(part.shard_indices.begin(),
                                                         part.shard_indices.end());
  }
  return questions;
}

// Returns some agents with distinct addresses: the first replica of each part before the second
// ones. The turn selects the part to begin with.
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

// Asks the questions, and adds their answers to `result`, in order, by add(index, answer, result).
// An error of `add` means that the answer is invalid.
template <typename T, typename Request, typename Response, typename AddFn>
QueryOutcome<T> Ask(const base::TraceContext& identity, const base::Cancellation& cancellation,
                    Method<Request, Response> method, Questions<Request, Response> questions,
                    T result, const AddFn& add) {
  QueryReport report;
  absl::Status error =
      Inquiry<Request, Response>(identity, cancellation, method, &questions).Run(&report);
  if (!error.ok()) {
    return {std::move(error), std::move(report)};
  }
  for (std::size_t i = 0; i < questions.size(); ++i) {
    const Question<Request, Response>& question = questions[i];
    const absl::Status added = add(i, question.answer(), &result);
    if (!added.ok()) {
      AgentFailure failure{.part_index = i,
                           .agent = question.agents[*question.winner].identity(),
                           .stage = PartStage::kAnswering,
                           .status = absl::InternalError(
                               absl::StrCat("sent a malformed answer: ", added.message()))};
      error = failure.ToStatus();
      return {std::move(error), {.failures = {std::move(failure)}}};
    }
  }
  return {std::move(result), std::move(report)};
}

// Fills in the surfaces of a question.
template <typename Request>
void AddRules(const std::vector<volume::InsideRule>& rules, Request* request) {
  for (const volume::InsideRule& rule : rules) {
    if (rule.has_labels()) {
      request->add_label_sets()->mutable_labels()->Assign(rule.labels.begin(), rule.labels.end());
    } else {
      request->add_isovalues(rule.isovalue);
    }
  }
}

// Fills in a question about points. Each set of labels travels once.
void AddPoints(const std::vector<ShownPoint>& points, const std::vector<std::string>& volume_ids,
               internal::GetGradientsRequest* request) {
  const bool has_labels = std::any_of(points.begin(), points.end(), [](const ShownPoint& point) {
    return point.rule.has_labels();
  });
  std::vector<const volume::InsideRule*> sets;
  for (const ShownPoint& point : points) {
    *request->add_points() = wire::ToProto(point.position);
    request->add_block_ids(point.block_id);
    if (!volume_ids.empty()) {
      request->mutable_values()->add_isovalues(point.rule.isovalue);
    }
    if (!volume_ids.empty() || has_labels) {
      request->add_on_caps(point.is_on_cap);
    }
    if (!has_labels) {
      continue;
    }
    if (!point.rule.has_labels()) {
      request->add_label_set_indices(-1);
      continue;
    }
    const volume::InsideRule& rule = point.rule;
    auto set = std::find_if(sets.begin(), sets.end(),
                            [&](const volume::InsideRule* known) { return *known == rule; });
    if (set == sets.end()) {
      internal::LabelSet& proto = *request->add_label_sets();
      proto.mutable_labels()->Assign(rule.labels.begin(), rule.labels.end());
      proto.set_smooth_labels(rule.smooths);
      set = sets.insert(sets.end(), &rule);
    }
    request->add_label_set_indices(static_cast<std::int32_t>(set - sets.begin()));
  }
  for (const std::string& id : volume_ids) {
    request->mutable_values()->add_dataset_ids(id);
  }
}

}  // namespace

QueryOutcome<volume::HistogramPart> AskHistogram(const QueryTarget& target,
                                                 const wire::HistogramQuery& query,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation) {
  using Response = internal::GetShardHistogramResponse;
  auto questions = QuestionsToParts<internal::GetShardHistogramRequest, Response>(target);
  for (auto& question : questions) {
    question.request.set_max_bin_count(static_cast<std::int32_t>(query.max_bin_count));
    question.request.set_max_label_value_count(
        static_cast<std::int32_t>(query.max_label_value_count));
    question.may_hedge = query.max_label_value_count == 0;
    if (query.value_range.has_value()) {
      question.request.mutable_value_range()->set_min(query.value_range->min);
      question.request.mutable_value_range()->set_max(query.value_range->max);
    }
  }
  QueryOutcome<volume::HistogramPart> outcome =
      Ask(identity, cancellation, &Async::GetShardHistogram, std::move(questions),
          volume::HistogramPart(),
          [](std::size_t i, const Response& answer, volume::HistogramPart* whole) {
            absl::StatusOr<volume::HistogramPart> part = wire::HistogramPartFromProto(answer);
            if (!part.ok() || i > 0) {
              return part.ok() ? volume::AddPart(*part, whole) : part.status();
            }
            *whole = *std::move(part);
            return absl::OkStatus();
          });
  if (outcome.result.ok() && outcome.result->label_values.has_value()) {
    // Each shard has no more than this; together they may have.
    volume::LabelValues bounded(static_cast<std::size_t>(query.max_label_value_count));
    bounded.Add(*outcome.result->label_values);
    outcome.result->label_values = std::move(bounded);
  }
  return outcome;
}

QueryOutcome<ActiveExtent> AskActiveBox(const QueryTarget& target,
                                        const volume::BlockLayout& layout,
                                        const std::vector<volume::InsideRule>& rules,
                                        const view::ClipRegion& clip,
                                        const base::TraceContext& identity,
                                        const base::Cancellation& cancellation) {
  using Response = internal::GetActiveBoxResponse;
  Questions<internal::GetActiveBoxRequest, Response> questions(1);
  questions[0].agents = AnyAgents(target);
  questions[0].request.set_dataset_id(target.dataset_id);
  AddRules(rules, &questions[0].request);
  *questions[0].request.mutable_clip() = wire::ToProto(clip);
  questions[0].request.set_level(target.level);
  return Ask(identity, cancellation, &Async::GetActiveBox, std::move(questions), ActiveExtent(),
             [&](std::size_t, const Response& answer, ActiveExtent* extent) -> absl::Status {
               ISOSCOPE_ASSIGN_OR_RETURN(extent->cells, wire::ActiveBoxFromProto(answer, layout));
               extent->active_block_count = answer.active_block_count();
               return absl::OkStatus();
             });
}

QueryOutcome<std::optional<math::IndexBox>> AskCellBox(const QueryTarget& target,
                                                       const volume::BlockLayout& layout,
                                                       const std::vector<volume::InsideRule>& rules,
                                                       const view::ClipRegion& clip,
                                                       const base::TraceContext& identity,
                                                       const base::Cancellation& cancellation) {
  using Response = internal::GetCellBoxResponse;
  auto questions = QuestionsToParts<internal::GetCellBoxRequest, Response>(target);
  for (auto& question : questions) {
    AddRules(rules, &question.request);
    *question.request.mutable_clip() = wire::ToProto(clip);
  }
  return Ask(identity, cancellation, &Async::GetCellBox, std::move(questions),
             std::optional<math::IndexBox>(),
             [&](std::size_t, const Response& answer,
                 std::optional<math::IndexBox>* whole) -> absl::Status {
               ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<math::IndexBox> part,
                                         wire::CellBoxFromProto(answer, layout));
               if (part.has_value()) {
                 math::IndexBox box = whole->value_or(math::IndexBox());
                 box.Add(*part);
                 *whole = box;
               }
               return absl::OkStatus();
             });
}

QueryOutcome<visibility::DepthBounds> AskDepthBounds(const QueryTarget& target,
                                                     const frame::FrameSpec& spec,
                                                     const base::TraceContext& identity,
                                                     const base::Cancellation& cancellation) {
  using Response = internal::GetDepthBoundsResponse;
  const view::Viewport size = frame::ImageSizeOf(spec);
  const std::size_t pixels =
      static_cast<std::size_t>(size.width_px) * static_cast<std::size_t>(size.height_px);
  // All answers together stay below the memory that the frame has for them.
  const std::size_t part_count = std::clamp<std::size_t>(
      frame::kMaxBoundsPixels / pixels, 1,
      std::min(target.parts.size(), static_cast<std::size_t>(wire::kMaxBoundsParts)));
  Questions<internal::GetDepthBoundsRequest, Response> questions(part_count);
  for (std::size_t i = 0; i < part_count; ++i) {
    questions[i].agents = AnyAgents({target.dataset_id, target.parts, /*turn=*/i});
    questions[i].request.set_dataset_id(target.dataset_id);
    *questions[i].request.mutable_frame() = wire::ToProto(spec);
    questions[i].request.set_part_index(static_cast<std::int32_t>(i));
    questions[i].request.set_part_count(static_cast<std::int32_t>(part_count));
  }
  return Ask(
      identity, cancellation, &Async::GetDepthBounds, std::move(questions),
      visibility::DepthBounds(size.width_px, size.height_px),
      [&](std::size_t, const Response& answer, visibility::DepthBounds* whole) -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(const visibility::DepthBounds part,
                                  wire::DepthBoundsFromProto(answer, size));
        whole->UniteWith(part);
        return absl::OkStatus();
      });
}

QueryOutcome<std::int64_t> AskUnresolved(const QueryTarget& target, std::int64_t block_count,
                                         int level, const volume::InsideRule& rule,
                                         const base::TraceContext& identity,
                                         const base::Cancellation& cancellation) {
  using Response = internal::GetResolvedBlocksResponse;
  auto questions = QuestionsToParts<internal::GetResolvedBlocksRequest, Response>(target);
  for (auto& question : questions) {
    question.request.set_level(level);
    question.request.set_isovalue(rule.isovalue);
    question.request.mutable_labels()->Assign(rule.labels.begin(), rule.labels.end());
    question.may_hedge = false;  // it reads as much on every agent
  }
  volume::BlockSet resolved(block_count);
  std::optional<std::int64_t> active;  // all agents know it
  return Ask(
      identity, cancellation, &Async::GetResolvedBlocks, std::move(questions), std::int64_t{0},
      [&](std::size_t, const Response& answer, std::int64_t* unresolved) -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<volume::BlockId> blocks,
                                  wire::BlockListFromProto(answer.blocks(), block_count, "blocks"));
        resolved.InsertAll(blocks);
        const std::int64_t stated = answer.active_block_count();
        const std::int64_t resolved_count = resolved.Count();
        if (stated < resolved_count || stated > block_count || stated != active.value_or(stated)) {
          return absl::InvalidArgumentError(
              absl::StrCat("active_block_count is ", stated, ": must be that of the volume of ",
                           block_count, " blocks, the same in all answers, and at least ",
                           resolved_count, ", which were named"));
        }
        active = stated;
        *unresolved = stated - resolved_count;
        return absl::OkStatus();
      });
}

QueryOutcome<std::vector<PointAnswer>> AskPoints(const QueryTarget& target,
                                                 const std::vector<ShownPoint>& points,
                                                 const std::vector<std::string>& volume_ids,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation) {
  using Response = internal::GetGradientsResponse;
  auto questions = QuestionsToParts<internal::GetGradientsRequest, Response>(target);
  for (auto& question : questions) {
    AddPoints(points, volume_ids, &question.request);
  }
  std::vector<volume::InsideRule> rules;
  for (const ShownPoint& point : points) {
    rules.push_back(point.rule);
  }
  std::vector<std::optional<math::Vec3d>> gradients(points.size());
  std::vector<std::optional<int>> shards(points.size());
  std::vector<std::vector<double>> values(points.size());
  std::vector<std::optional<double>> labels(points.size());
  auto outcome =
      Ask(identity, cancellation, &Async::GetGradients, std::move(questions),
          std::vector<PointAnswer>(points.size()),
          [&](std::size_t i, const Response& answer, std::vector<PointAnswer>*) {
            absl::Status status = wire::AddGradients(answer, &gradients);
            status.Update(wire::AddPointShards(answer, target.parts[i].shard_indices, &shards));
            status.Update(wire::AddPointValues(answer, volume_ids.size(), &values));
            status.Update(wire::AddPointLabels(answer, rules, &labels));
            return status;
          });
  for (std::size_t i = 0; outcome.result.ok() && i < points.size(); ++i) {
    (*outcome.result)[i] = {.gradient = gradients[i],
                            .shard_index = shards[i],
                            .values = std::move(values[i]),
                            .label = labels[i]};
  }
  return outcome;
}

}  // namespace isoscope::server
