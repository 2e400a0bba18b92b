// The identity of a request in gRPC's metadata: that of a call, and that in its answer.

#ifndef ISOSCOPE_RPC_REQUEST_CONTEXT_H_
#define ISOSCOPE_RPC_REQUEST_CONTEXT_H_

#include <string>

#include <grpcpp/client_context.h>
#include <grpcpp/server_context.h>

#include "core/base/trace_context.h"

namespace isoscope::rpc {

// Keys of metadata: of a call, in the format of W3C Trace Context; and of the trailing metadata of
// its answer, with the request id.
inline constexpr char kTraceparentKey[] = "traceparent";
inline constexpr char kRequestIdKey[] = "x-request-id";

// Returns the identity that the caller gives its call, or a new one if it gives none, several, or a
// malformed one.
base::TraceContext TraceContextOf(const grpc::ServerContextBase& context);

// The same, and answers the call with the request id. Call it once, before the call is finished.
base::TraceContext AnswerTraceContext(grpc::ServerContextBase* context);

// Adds the identity to a call to another process.
void SetTraceparent(const base::TraceContext& identity, grpc::ClientContext* context);

// Returns the request id of an answered call; "" if the server gave none.
std::string RequestIdOf(const grpc::ClientContext& context);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_REQUEST_CONTEXT_H_
