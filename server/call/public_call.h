// The life of a call of a public service. All calls have these stages, in this order; docs/
// architecture.md ("Life of a call") has a table of them. A stage that fails returns the status with
// which the call ends. The stages before it undo themselves.
//
//   1. arrival    PublicCall: identity of the request, peer, time of arrival
//   2. identify   PublicCall::Identify: the caller and its rights
//   3. check      by the service: the request alone
//   4. share      CallWork::TakeUse, TakeRate: the limits of the caller's token
//   5. place      CallWork::TakePlace: among the works of one kind, then Schedule for the turn
//   6. memory     CallWork::KeepMemory, on the thread of the turn
//   7. work       by the service
//   8. end        CallWork gives place and share back, PublicCall::End counts and audits the call.
//                 Only then the client gets the status, so that its next call finds all free.

#ifndef ISOSCOPE_SERVER_CALL_PUBLIC_CALL_H_
#define ISOSCOPE_SERVER_CALL_PUBLIC_CALL_H_

#include <cstddef>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "google/protobuf/message.h"
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include "core/base/metrics.h"
#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/trace_context.h"
#include "rpc/peer.h"
#include "rpc/write_timeout.h"
#include "server/access/access_control.h"
#include "server/access/audit_log.h"
#include "server/call/call_metrics.h"

namespace isoscope::server {

// State that all calls share. Outlives them.
struct CallDesk {
  AccessControl* access = nullptr;            // outlives the desk
  std::shared_ptr<AuditLog> audit = nullptr;  // null: none is kept
  CallMetrics metrics = {};
};

// The origin of a request, with its caller once that is known.
struct CallOrigin {
  base::TraceContext request;
  std::string client;  // as gRPC names the peer
  Caller caller = {};
};

// The dataset of a call: the name that was asked for, or name and id of the one that was found.
struct CallDataset {
  base::ForeignText name = {};
  base::ForeignText id = {};

  friend bool operator==(const CallDataset&, const CallDataset&) = default;
};

// A public call, as a part of its reactor, or on the stack of its handler. NoteDataset, Audit and
// End are thread-safe.
class PublicCall {
 public:
  // Stage 1. `dataset`: name in the request; empty without one.
  PublicCall(CallDesk* desk, RequestMethod method, grpc::CallbackServerContext* context,
             base::ForeignText dataset = {});
  PublicCall(const PublicCall&) = delete;
  PublicCall& operator=(const PublicCall&) = delete;

  // Stage 2. Errors as AccessControl::Identify.
  absl::Status Identify();

  [[nodiscard]] const rpc::Peer& peer() const { return peer_; }
  [[nodiscard]] const CallOrigin& origin() const { return origin_; }
  [[nodiscard]] const Caller& caller() const { return origin_.caller; }
  [[nodiscard]] const base::TraceContext& request() const { return origin_.request; }
  [[nodiscard]] base::MonotonicTime arrival() const { return arrival_; }
  // The client's own; infinite without one.
  [[nodiscard]] base::MonotonicTime deadline() const { return deadline_; }

  // The bytes of the answer that the client has not taken, and the time that it has for them. The
  // reactor stops the timeout in OnDone.
  [[nodiscard]] base::GaugeShare& unsent() { return unsent_; }
  [[nodiscard]] rpc::WriteTimeout& timeout() { return timeout_; }

  // Sets the dataset of the audit record.
  void NoteDataset(CallDataset dataset) ABSL_LOCKS_EXCLUDED(mutex_);
  // Writes a line of the audit log; for a part of a call that goes on.
  void Audit(const absl::Status& status) const ABSL_LOCKS_EXCLUDED(mutex_);
  // Counts that the coordinator ends the call early.
  void CountCut(CutReason reason) { desk_.metrics.CountCut(reason); }
  // Stage 8: counts the call and writes its line of the audit log. Returns the status for the
  // client. Call once.
  grpc::Status End(const absl::Status& status) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  CallDesk& desk_;
  const RequestMethod method_;
  const base::MonotonicTime arrival_ = base::MonotonicNow();
  const base::MonotonicTime deadline_;
  const rpc::Peer peer_;
  CallOrigin origin_;  // constant after Identify
  base::GaugeShare unsent_;
  rpc::WriteTimeout timeout_;
  mutable base::Mutex mutex_;
  AuditRecord record_ ABSL_GUARDED_BY(mutex_);
};

// All stages of a cheap unary call, which takes no share, place or memory. Refuses a request with a
// field that this program does not know; else `answer` identifies the caller and fills the
// response.
grpc::ServerUnaryReactor* AnswerAtOnce(CallDesk* desk, RequestMethod method,
                                       grpc::CallbackServerContext* context,
                                       const google::protobuf::Message& request,
                                       const std::string& dataset,
                                       absl::FunctionRef<absl::Status(PublicCall* call)> answer);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_CALL_PUBLIC_CALL_H_
