// The messages of google.rpc are not in Debian's packages for C++. The needed messages have few
// fields, which are written and read by their numbers:
//
//   Status     1: code (int32), 2: message (string), 3: details (Any, repeated)
//   Any        1: type_url (string), 2: value (bytes)
//   RetryInfo  1: retry_delay (Duration)
//   ErrorInfo  1: reason (string), 2: domain (string), 3: metadata (map: 1: key, 2: value)

#include "rpc/grpc_status.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "google/protobuf/duration.pb.h"
#include "google/protobuf/unknown_field_set.h"

#include "core/base/error_reason.h"
#include "core/base/printable.h"
#include "core/base/retry_delay.h"
#include "wire/proto_convert.h"

namespace isoscope::rpc {
namespace {

using google::protobuf::UnknownField;
using google::protobuf::UnknownFieldSet;

// The message is also in the header grpc-message.
constexpr std::size_t kMaxDetailMessageBytes = 1024;
constexpr int kCodeField = 1;
constexpr int kMessageField = 2;
constexpr int kDetailsField = 3;
constexpr int kTypeUrlField = 1;
constexpr int kValueField = 2;
constexpr int kRetryDelayField = 1;
constexpr char kRetryInfoUrl[] = "type.googleapis.com/google.rpc.RetryInfo";
constexpr int kReasonField = 1;
constexpr int kDomainField = 2;
constexpr int kMetadataField = 3;
constexpr int kMapKeyField = 1;
constexpr int kMapValueField = 2;
constexpr char kErrorInfoUrl[] = "type.googleapis.com/google.rpc.ErrorInfo";

// A byte of a header, which is ASCII, takes one byte; each other one three: %e4.
std::size_t HeaderBytesOf(char c) { return c >= ' ' && c <= '~' && c != '%' ? 1 : 3; }

// Adds a message as an Any.
void AddDetail(const char* url, const UnknownFieldSet& message, UnknownFieldSet* details) {
  UnknownFieldSet detail;
  *detail.AddLengthDelimited(kTypeUrlField) = url;
  message.SerializeToString(detail.AddLengthDelimited(kValueField));
  detail.SerializeToString(details->AddLengthDelimited(kDetailsField));
}

void AddErrorInfo(base::ErrorReason reason, UnknownFieldSet* details) {
  UnknownFieldSet entry;
  *entry.AddLengthDelimited(kMapKeyField) = "transient";
  *entry.AddLengthDelimited(kMapValueField) = base::IsTransient(reason) ? "true" : "false";
  UnknownFieldSet error_info;
  *error_info.AddLengthDelimited(kReasonField) = base::NameOf(reason);
  *error_info.AddLengthDelimited(kDomainField) = kErrorDomain;
  entry.SerializeToString(error_info.AddLengthDelimited(kMetadataField));
  AddDetail(kErrorInfoUrl, error_info, details);
}

std::string DetailsOf(const absl::Status& status, const std::string& message) {
  UnknownFieldSet details;
  details.AddVarint(kCodeField, static_cast<std::uint64_t>(status.raw_code()));
  *details.AddLengthDelimited(kMessageField) = base::CutText(message, kMaxDetailMessageBytes);
  if (const std::optional<absl::Duration> delay = base::RetryDelayOf(status)) {
    UnknownFieldSet retry_info;
    *retry_info.AddLengthDelimited(kRetryDelayField) = wire::ToProto(*delay).SerializeAsString();
    AddDetail(kRetryInfoUrl, retry_info, &details);
  }
  AddErrorInfo(base::ReasonOf(status), &details);
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
  const absl::Duration read = wire::DurationFromProto(delay);
  return read >= absl::ZeroDuration() ? std::optional<absl::Duration>(read) : std::nullopt;
}

// Returns none for the reasons of other services.
std::optional<base::ErrorReason> ReasonOfErrorInfo(const std::string& bytes) {
  UnknownFieldSet error_info;
  if (!error_info.ParseFromString(bytes)) {
    return std::nullopt;
  }
  const std::string* const reason = FindBytes(error_info, kReasonField);
  const std::string* const domain = FindBytes(error_info, kDomainField);
  return reason != nullptr && domain != nullptr && *domain == kErrorDomain
             ? base::ErrorReasonFromName(*reason)
             : std::nullopt;
}

struct Details {
  std::optional<absl::Duration> delay;
  std::optional<base::ErrorReason> reason;
};

Details ReadDetails(const std::string& details) {
  Details read;
  UnknownFieldSet fields;
  if (details.empty() || !fields.ParseFromString(details)) {
    return read;
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
    if (url == nullptr || value == nullptr) {
      continue;
    }
    if (*url == kRetryInfoUrl && !read.delay.has_value()) {
      read.delay = DelayOfRetryInfo(*value);
    } else if (*url == kErrorInfoUrl && !read.reason.has_value()) {
      read.reason = ReasonOfErrorInfo(*value);
    }
  }
  return read;
}

}  // namespace

std::string BoundedMessage(absl::string_view message) {
  constexpr std::size_t kMaxRemarkBytes = 40;  // CutText's
  std::string text = base::ValidUtf8(message);
  std::size_t header_bytes = 0;
  std::size_t kept = 0;
  for (const char c : text) {
    header_bytes += HeaderBytesOf(c);
    kept += header_bytes + kMaxRemarkBytes <= kMaxStatusMessageBytes ? 1 : 0;
  }
  return header_bytes <= kMaxStatusMessageBytes ? std::move(text) : base::CutText(text, kept);
}

grpc::Status ToGrpcStatus(const absl::Status& status) {
  if (status.ok()) {
    return grpc::Status::OK;
  }
  const std::string message = BoundedMessage(status.message());
  // Both sides number the codes alike: google/rpc/code.proto.
  const auto code = static_cast<grpc::StatusCode>(status.raw_code());
  return {code, message, DetailsOf(status, message)};
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
  // gRPC's own message for a connection that broke, as on a damaged TLS record. No server sends it.
  if (status.error_code() == grpc::StatusCode::UNKNOWN &&
      status.error_message() == "Stream removed") {
    return absl::UnavailableError("the connection broke: Stream removed");
  }
  absl::Status converted(static_cast<absl::StatusCode>(number), status.error_message());
  const Details details = ReadDetails(status.error_details());
  if (details.delay.has_value()) {
    converted = base::WithRetryDelay(std::move(converted), *details.delay);
  }
  // A reason that follows from the code would only make the message longer.
  if (details.reason.has_value() && *details.reason != base::DefaultReasonOf(converted)) {
    converted = base::WithReason(std::move(converted), *details.reason);
  }
  return converted;
}

}  // namespace isoscope::rpc
