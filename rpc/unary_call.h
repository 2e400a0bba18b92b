// Answers a unary call: at once, for the handlers of cheap questions, or on a thread of its own.

#ifndef ISOSCOPE_RPC_UNARY_CALL_H_
#define ISOSCOPE_RPC_UNARY_CALL_H_

#include <algorithm>
#include <functional>
#include <memory>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "google/protobuf/message.h"
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include "core/base/cancellation.h"
#include "core/base/executor.h"
#include "core/base/monotonic_time.h"
#include "core/base/no_memory.h"
#include "core/base/retry_delay.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/request_context.h"
#include "wire/known_fields.h"

namespace isoscope::rpc {

// Called with the status of an ended call, its duration, and the id of its request. May be empty.
using OnCallEnd = std::function<void(const absl::Status& status, absl::Duration duration,
                                     const base::TraceContext& identity)>;

// Refuses a request with a field that this program does not know (CheckKnownFields); else calls
// `answer`, which fills the response and must be quick, and ends the call with its status.
inline grpc::ServerUnaryReactor* AnswerUnary(grpc::CallbackServerContext* context,
                                             const google::protobuf::Message& request,
                                             absl::FunctionRef<absl::Status()> answer,
                                             const OnCallEnd& on_end = nullptr) {
  const base::MonotonicTime start = base::MonotonicNow();
  const base::TraceContext identity = AnswerTraceContext(context);
  absl::Status status = wire::CheckKnownFields(request);
  if (status.ok()) {
    status = answer();
  }
  if (on_end != nullptr) {
    on_end(status, base::MonotonicNow() - start, identity);
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(ToGrpcStatus(status));
  return reactor;
}

// A unary call that is answered on a thread of an executor. It owns itself until gRPC is done with
// it.
class UnaryTask final : public grpc::ServerUnaryReactor {
 public:
  static constexpr absl::Duration kBusyDelay = absl::Milliseconds(500);
  using Answer = std::function<absl::Status(const base::Cancellation& cancellation,
                                            const base::TraceContext& identity)>;

  // Refuses a request with a field that this program does not know; else lets `answer` fill the
  // response, and ends the call with its status. The cancellation fires when the caller cancels;
  // its deadline is the caller's, or `max_duration` from now if that is sooner. RESOURCE_EXHAUSTED
  // if the executor's queue is full (retry after kBusyDelay), or if memory runs out.
  static grpc::ServerUnaryReactor* Start(grpc::CallbackServerContext* context,
                                         const google::protobuf::Message& request,
                                         base::Executor* executor, absl::Duration max_duration,
                                         Answer answer, OnCallEnd on_end = nullptr) {
    const std::shared_ptr<UnaryTask> task(new UnaryTask(
        AnswerTraceContext(context),
        std::min(DeadlineOf(*context), base::MonotonicNow() + max_duration), std::move(on_end)));
    task->self_ = task;
    const absl::Status status = wire::CheckKnownFields(request);
    if (!status.ok()) {
      task->End(status);
    } else if (!executor->TrySchedule([task, answer = std::move(answer)] {
                 const absl::Status checked = task->cancellation_.Check();
                 task->End(base::OrNoMemory("the answer", [&] {
                   return checked.ok() ? answer(task->cancellation_, task->identity_) : checked;
                 }));
               })) {
      task->End(base::WithRetryDelay(
          absl::ResourceExhaustedError(
              "too many calls of this kind are in work: retry later, with back-off"),
          kBusyDelay));
    }
    return task.get();
  }

  void OnCancel() override { cancellation_.Cancel(); }
  void OnDone() override { const std::shared_ptr<UnaryTask> last_use = std::move(self_); }

 private:
  UnaryTask(base::TraceContext identity, base::MonotonicTime deadline, OnCallEnd on_end)
      : identity_(std::move(identity)), cancellation_(deadline), on_end_(std::move(on_end)) {}

  void End(const absl::Status& status) {
    if (on_end_ != nullptr) {
      on_end_(status, base::MonotonicNow() - start_, identity_);
    }
    Finish(ToGrpcStatus(status));
  }

  const base::TraceContext identity_;
  const base::MonotonicTime start_ = base::MonotonicNow();
  base::Cancellation cancellation_;
  const OnCallEnd on_end_;
  std::shared_ptr<UnaryTask> self_;  // reset by OnDone
};

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_UNARY_CALL_H_
