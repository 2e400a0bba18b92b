// The only place where absl::Status becomes grpc::Status and back. Codes have the same numbers and
// meanings on both sides; messages are kept. The retry delay of a refusal (base/retry_delay.h)
// travels as google.rpc.RetryInfo in a google.rpc.Status, in the metadata grpc-status-details-bin,
// as in other gRPC services. So does the reason (base/error_reason.h), as google.rpc.ErrorInfo with
// kErrorDomain and the metadata transient = true or false. Other details are not read.

#ifndef ISOSCOPE_CORE_RPC_GRPC_STATUS_H_
#define ISOSCOPE_CORE_RPC_GRPC_STATUS_H_

#include "absl/status/status.h"
#include <grpcpp/support/status.h>

namespace isoscope::rpc {

// A message longer than kMaxStatusMessageBytes is cut: it travels in a header of limited size.
grpc::Status ToGrpcStatus(const absl::Status& status);
inline constexpr int kMaxStatusMessageBytes = 4096;
inline constexpr char kErrorDomain[] = "isoscope";

// A code that gRPC does not define becomes UNKNOWN. gRPC's own UNKNOWN "Stream removed", which says
// that the connection broke, becomes UNAVAILABLE. Details that can't be read are left out.
absl::Status ToAbslStatus(const grpc::Status& status);

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_GRPC_STATUS_H_
