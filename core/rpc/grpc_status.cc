#include "core/rpc/grpc_status.h"

#include <string>

#include "absl/strings/str_cat.h"

namespace isoscope::rpc {

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) {
    return grpc::Status::OK;
  }
  std::string message(status.message());
  if (message.size() > kMaxStatusMessageBytes) {
    message.resize(kMaxStatusMessageBytes - 3);
    message += "...";
  }
  // Both sides number the codes alike: google/rpc/code.proto.
  return {static_cast<grpc::StatusCode>(status.raw_code()), message};
}

absl::Status ToAbslStatus(const grpc::Status& status) {
  if (status.ok()) {
    return absl::OkStatus();
  }
  const int number = static_cast<int>(status.error_code());
  if (number < static_cast<int>(absl::StatusCode::kOk) ||
      number > static_cast<int>(absl::StatusCode::kUnauthenticated)) {
    return absl::UnknownError(absl::StrCat("status code ", number, ": ", status.error_message()));
  }
  // gRPC's own words for a connection that broke, as on a damaged TLS record. No server says so.
  if (status.error_code() == grpc::StatusCode::UNKNOWN &&
      status.error_message() == "Stream removed") {
    return absl::UnavailableError("the connection broke: Stream removed");
  }
  return {static_cast<absl::StatusCode>(number), status.error_message()};
}

}  // namespace isoscope::rpc
