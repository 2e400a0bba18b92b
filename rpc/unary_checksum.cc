#include "rpc/unary_checksum.h"

#include <cstdint>
#include <string>

#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"

#include "core/base/crc32c.h"
#include "proto/message_checksum.h"

namespace isoscope::rpc {
namespace {

constexpr char kChecksumKey[] = "isoscope-crc32c";

std::string ChecksumOf(const google::protobuf::Message& request, const absl::Status& status,
                       const google::protobuf::Message& response) {
  std::uint32_t crc = base::Crc32c(request.SerializeAsString());
  if (status.ok()) {
    const std::string answer = response.SerializeAsString();
    crc = base::ExtendCrc32c(crc, answer.data(), answer.size());
  }
  return absl::StrFormat("%08x", crc);
}

}  // namespace

void AnswerChecksum(const google::protobuf::Message& request, const absl::Status& status,
                    const google::protobuf::Message& response, grpc::ServerContextBase* context) {
  context->AddTrailingMetadata(kChecksumKey, ChecksumOf(request, status, response));
}

absl::Status CheckAnswer(const google::protobuf::Message& request, const absl::Status& status,
                         const google::protobuf::Message& response,
                         const grpc::ClientContext& context) {
  if (!status.ok() && !absl::IsInvalidArgument(status)) {
    return status;
  }
  const auto& trailing = context.GetServerTrailingMetadata();
  const auto found = trailing.find(kChecksumKey);
  if (found == trailing.end()) {
    return status.ok() ? proto::DamagedError() : status;
  }
  const absl::string_view sent(found->second.data(), found->second.size());
  return sent == ChecksumOf(request, status, response) ? status : proto::DamagedError();
}

}  // namespace isoscope::rpc
