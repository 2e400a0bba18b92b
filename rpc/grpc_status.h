// The only place where absl::Status becomes grpc::Status and back. Codes have the same numbers and
// meanings on both sides; messages are kept. The retry delay of a refusal (base/retry_delay.h)
// travels as google.rpc.RetryInfo in a google.rpc.Status, in the metadata grpc-status-details-bin,
// as in other gRPC services. So does the reason (base/error_reason.h), as google.rpc.ErrorInfo with
// kErrorDomain and the metadata transient = true or false. Other details are not read.

#ifndef ISOSCOPE_RPC_GRPC_STATUS_H_
#define ISOSCOPE_RPC_GRPC_STATUS_H_

#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include <grpcpp/support/status.h>

namespace isoscope::rpc {

// A message that takes more than kMaxStatusMessageBytes in a header, where each byte beyond ASCII
// takes three, is cut (base::CutText). '?' stands for a byte that is no UTF-8.
grpc::Status ToGrpcStatus(const absl::Status& status);
inline constexpr int kMaxStatusMessageBytes = 4096;
// Returns the message that ToGrpcStatus sends.
std::string BoundedMessage(absl::string_view message);
inline constexpr char kErrorDomain[] = "isoscope";

// A code that gRPC does not define becomes UNKNOWN. gRPC's own UNKNOWN "Stream removed", which says
// that the connection broke, becomes UNAVAILABLE. Details that can't be read are left out.
absl::Status ToAbslStatus(const grpc::Status& status);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_GRPC_STATUS_H_
