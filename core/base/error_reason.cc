#include "core/base/error_reason.h"

#include <array>
#include <cstddef>

#include "absl/strings/cord.h"
#include "absl/strings/str_cat.h"

#include "core/base/retry_delay.h"

namespace isoscope::base {
namespace {

// The payload is text, so that a status that is printed can be read.
constexpr absl::string_view kPayload = "isoscope.reason";

struct Entry {
  const char* name;
  bool is_transient;
};
// Indexed by the value of the enumerator.
constexpr std::array<Entry, kErrorReasonCount> kEntries = {{
    {"DATASET_UNKNOWN", false}, {"DATASET_INCOMPLETE", true}, {"DATASET_ID_DIFFERS", false},
    {"INVALID_FIELD", false},   {"TOO_BUSY", true},           {"RATE_LIMITED", true},
    {"TOO_LARGE", false},       {"AGENT_LOST", true},         {"AGENT_OPENING", true},
    {"SERVER_STOPS", true},     {"SHARD_DAMAGED", false},     {"SOURCE_UNREADABLE", true},
    {"DEADLINE_PASSED", true},  {"UNAUTHENTICATED", false},   {"PERMISSION_DENIED", false},
    {"NOT_POSSIBLE", false},    {"CANCELLED", false},         {"UNIMPLEMENTED", false},
    {"INTERNAL", false},
}};

const Entry& EntryOf(ErrorReason reason) { return kEntries[static_cast<std::size_t>(reason)]; }

}  // namespace

const char* NameOf(ErrorReason reason) { return EntryOf(reason).name; }

std::optional<ErrorReason> ErrorReasonFromName(absl::string_view name) {
  for (std::size_t i = 0; i < kEntries.size(); ++i) {
    if (name == kEntries[i].name) {
      return static_cast<ErrorReason>(i);
    }
  }
  return std::nullopt;
}

bool IsTransient(ErrorReason reason) { return EntryOf(reason).is_transient; }

absl::Status WithReason(absl::Status status, ErrorReason reason) {
  status.SetPayload(kPayload, absl::Cord(NameOf(reason)));
  return status;
}

absl::Status WithPrefix(absl::string_view prefix, const absl::Status& status) {
  absl::Status named(status.code(), absl::StrCat(prefix, status.message()));
  status.ForEachPayload(
      [&](absl::string_view url, const absl::Cord& payload) { named.SetPayload(url, payload); });
  return named;
}

ErrorReason ReasonOf(const absl::Status& status) {
  if (const auto payload = status.GetPayload(kPayload); payload.has_value()) {
    if (const auto reason = ErrorReasonFromName(std::string(*payload)); reason.has_value()) {
      return *reason;
    }
  }
  return DefaultReasonOf(status);
}

ErrorReason DefaultReasonOf(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kNotFound:
      return ErrorReason::kDatasetUnknown;
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
      return ErrorReason::kInvalidField;
    case absl::StatusCode::kResourceExhausted:
      return RetryDelayOf(status).has_value() ? ErrorReason::kTooBusy : ErrorReason::kTooLarge;
    case absl::StatusCode::kUnavailable:
      return ErrorReason::kAgentLost;
    case absl::StatusCode::kDataLoss:
      return ErrorReason::kShardDamaged;
    case absl::StatusCode::kDeadlineExceeded:
      return ErrorReason::kDeadlinePassed;
    case absl::StatusCode::kUnauthenticated:
      return ErrorReason::kUnauthenticated;
    case absl::StatusCode::kPermissionDenied:
      return ErrorReason::kPermissionDenied;
    case absl::StatusCode::kFailedPrecondition:
      return ErrorReason::kNotPossible;
    case absl::StatusCode::kCancelled:
      return ErrorReason::kCancelled;
    case absl::StatusCode::kUnimplemented:
      return ErrorReason::kUnimplemented;
    default:
      return ErrorReason::kInternal;
  }
}

}  // namespace isoscope::base
