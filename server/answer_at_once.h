// Answers a cheap unary call of a public service at once.

#ifndef ISOSCOPE_SERVER_ANSWER_AT_ONCE_H_
#define ISOSCOPE_SERVER_ANSWER_AT_ONCE_H_

#include <string>
#include <utility>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "absl/time/time.h"
#include "google/protobuf/message.h"
#include <grpcpp/server_context.h>

#include "rpc/peer.h"
#include "rpc/unary_call.h"
#include "server/access/audit_log.h"
#include "server/frame/frame_runner.h"

namespace isoscope::server {

// Works as rpc::AnswerUnary. Then counts the call, and writes its line of the audit log. `answer`
// may add to the record.
//
// dataset: name in the request; "": none
inline grpc::ServerUnaryReactor* AnswerAtOnce(
    FrameRunner* runner, RequestMethod method, grpc::CallbackServerContext* context,
    const google::protobuf::Message& request, const std::string& dataset,
    absl::FunctionRef<absl::Status(const rpc::Peer& peer, AuditRecord* record)> answer) {
  const rpc::Peer peer = rpc::PeerOf(*context);
  AuditRecord record = RecordOf(peer, context->peer());
  record.dataset = dataset;
  return rpc::AnswerUnary(
      context, request, [&] { return answer(peer, &record); },
      [&](const absl::Status& status, absl::Duration duration, const base::TraceContext& identity) {
        runner->EndRequest(method, record, identity, status, duration);
      });
}

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ANSWER_AT_ONCE_H_
