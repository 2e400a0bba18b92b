#include "rpc/health_probe.h"

#include <cstdint>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "absl/synchronization/notification.h"
#include "google/protobuf/io/coded_stream.h"
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/support/byte_buffer.h>

#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/grpc_time.h"

namespace isoscope::rpc {
namespace {

// grpc.health.v1.HealthCheckResponse.ServingStatus; Debian has no header of it.
constexpr std::uint64_t kServing = 1;
// The field `status`, a varint.
constexpr std::uint32_t kStatusTag = 1U << 3U;

// The status of a HealthCheckResponse; 0 (UNKNOWN) if it has none.
std::uint64_t StatusOf(grpc::ByteBuffer* response) {
  grpc::Slice slice;
  if (!response->DumpToSingleSlice(&slice).ok()) {
    return 0;
  }
  google::protobuf::io::CodedInputStream stream(slice.begin(), static_cast<int>(slice.size()));
  std::uint64_t status = 0;
  return stream.ReadTag() == kStatusTag && stream.ReadVarint64(&status) ? status : 0;
}

}  // namespace

absl::Status ProbeHealth(const std::string& address, const Dialing& dialing, absl::Duration timeout,
                         Probe probe) {
  grpc::GenericStub stub(MakeFreshChannel(address, dialing));
  grpc::ClientContext context;
  context.set_deadline(base::MonotonicNow() + timeout);
  const grpc::ByteBuffer request(nullptr, 0);  // a HealthCheckRequest for the server as a whole
  grpc::ByteBuffer response;
  grpc::Status status;
  absl::Notification done;
  stub.UnaryCall(&context, "/grpc.health.v1.Health/Check", grpc::StubOptions(), &request, &response,
                 [&](const grpc::Status& ended) {
                   status = ended;
                   done.Notify();
                 });
  done.WaitForNotification();
  const absl::Status answered = ToAbslStatus(status);
  if (probe == Probe::kLive && (answered.ok() || absl::IsNotFound(answered))) {
    return absl::OkStatus();  // NOT_FOUND: its health service runs, and has no status yet
  }
  if (absl::IsDeadlineExceeded(answered)) {
    return absl::DeadlineExceededError(absl::StrCat(address, " does not answer within ",
                                                    absl::FormatDuration(timeout),
                                                    ": look at its process and its log"));
  }
  ISOSCOPE_RETURN_IF_ERROR(answered);
  const std::uint64_t serving = StatusOf(&response);
  return serving == kServing
             ? absl::OkStatus()
             : absl::UnavailableError(
                   absl::StrCat("the server says that it does not serve (status ", serving, ")"));
}

std::string OwnAddress(absl::string_view listen_address) {
  absl::string_view port = listen_address;
  if (absl::ConsumePrefix(&port, "0.0.0.0:")) {
    return absl::StrCat("127.0.0.1:", port);
  }
  if (absl::ConsumePrefix(&port, "[::]:")) {
    return absl::StrCat("[::1]:", port);
  }
  return std::string(listen_address);
}

}  // namespace isoscope::rpc
