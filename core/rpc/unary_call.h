// Answers a unary call at once, for the handlers of cheap questions.

#ifndef ISOSCOPE_CORE_RPC_UNARY_CALL_H_
#define ISOSCOPE_CORE_RPC_UNARY_CALL_H_

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"
#include "google/protobuf/message.h"
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include "core/rpc/grpc_status.h"
#include "core/rpc/known_fields.h"

namespace isoscope::rpc {

// Refuses a request with a field that this program does not know (CheckKnownFields); else calls
// `answer`, which fills the response and must be quick, and ends the call with its status.
inline grpc::ServerUnaryReactor* AnswerUnary(grpc::CallbackServerContext* context,
                                             const google::protobuf::Message& request,
                                             absl::FunctionRef<absl::Status()> answer) {
  absl::Status status = CheckKnownFields(request);
  if (status.ok()) {
    status = answer();
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(ToGrpcStatus(status));
  return reactor;
}

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_UNARY_CALL_H_
