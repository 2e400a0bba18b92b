// The messages of google.rpc are not in Debian's packages for C++. What is needed of them has few
// fields, which are written and read by their numbers:
//
//   Status     1: code (int32), 2: message (string), 3: details (Any, repeated)
//   Any        1: type_url (string), 2: value (bytes)
//   RetryInfo  1: retry_delay (Duration)

#include "core/rpc/grpc_status.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "google/protobuf/duration.pb.h"
#include "google/protobuf/unknown_field_set.h"

#include "core/base/retry_delay.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::rpc {
namespace {

using google::protobuf::UnknownField;
using google::protobuf::UnknownFieldSet;

// The message stands in the header beside it, too.
constexpr std::size_t kMaxDetailMessageBytes = 1024;
constexpr int kCodeField = 1;
constexpr int kMessageField = 2;
constexpr int kDetailsField = 3;
constexpr int kTypeUrlField = 1;
constexpr int kValueField = 2;
constexpr int kRetryDelayField = 1;
constexpr char kRetryInfoUrl[] = "type.googleapis.com/google.rpc.RetryInfo";

std::string DetailsOf(const absl::Status& status, const std::string& message,
                      absl::Duration delay) {
  UnknownFieldSet retry_info;
  *retry_info.AddLengthDelimited(kRetryDelayField) = ToProto(delay).SerializeAsString();
  UnknownFieldSet detail;
  *detail.AddLengthDelimited(kTypeUrlField) = kRetryInfoUrl;
  retry_info.SerializeToString(detail.AddLengthDelimited(kValueField));
  UnknownFieldSet details;
  details.AddVarint(kCodeField, static_cast<std::uint64_t>(status.raw_code()));
  *details.AddLengthDelimited(kMessageField) = message.substr(0, kMaxDetailMessageBytes);
  detail.SerializeToString(details.AddLengthDelimited(kDetailsField));
  std::string bytes;
  details.SerializeToString(&bytes);
  return bytes;
}

// The last of the fields of this number that holds bytes; null if there is none.
const std::string* FindBytes(const UnknownFieldSet& fields, int number) {
  const std::string* found = nullptr;
  for (int i = 0; i < fields.field_count(); ++i) {
    const UnknownField& field = fields.field(i);
    if (field.number() == number && field.type() == UnknownField::TYPE_LENGTH_DELIMITED) {
      found = &field.length_delimited();
    }
  }
  return found;
}

std::optional<absl::Duration> DelayOfRetryInfo(const std::string& bytes) {
  UnknownFieldSet retry_info;
  google::protobuf::Duration delay;
  if (!retry_info.ParseFromString(bytes)) {
    return std::nullopt;
  }
  const std::string* const delay_bytes = FindBytes(retry_info, kRetryDelayField);
  // An empty message is a delay of 0.
  if (delay_bytes != nullptr && !delay.ParseFromString(*delay_bytes)) {
    return std::nullopt;
  }
  const absl::Duration read = DurationFromProto(delay);
  return read >= absl::ZeroDuration() ? std::optional<absl::Duration>(read) : std::nullopt;
}

std::optional<absl::Duration> FindDelay(const std::string& details) {
  UnknownFieldSet fields;
  if (details.empty() || !fields.ParseFromString(details)) {
    return std::nullopt;
  }
  for (int i = 0; i < fields.field_count(); ++i) {
    const UnknownField& field = fields.field(i);
    UnknownFieldSet detail;
    if (field.number() != kDetailsField || field.type() != UnknownField::TYPE_LENGTH_DELIMITED ||
        !detail.ParseFromString(field.length_delimited())) {
      continue;
    }
    const std::string* const url = FindBytes(detail, kTypeUrlField);
    const std::string* const value = FindBytes(detail, kValueField);
    if (url != nullptr && *url == kRetryInfoUrl && value != nullptr) {
      return DelayOfRetryInfo(*value);
    }
  }
  return std::nullopt;
}

}  // namespace

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
  const auto code = static_cast<grpc::StatusCode>(status.raw_code());
  const std::optional<absl::Duration> delay = base::RetryDelayOf(status);
  return delay.has_value() ? grpc::Status(code, message, DetailsOf(status, message, *delay))
                           : grpc::Status(code, message);
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
  absl::Status converted(static_cast<absl::StatusCode>(number), status.error_message());
  const std::optional<absl::Duration> delay = FindDelay(status.error_details());
  return delay.has_value() ? base::WithRetryDelay(std::move(converted), *delay) : converted;
}

}  // namespace isoscope::rpc
