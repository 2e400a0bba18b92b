#include "server/frame/agent_call.h"

#include <optional>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

#include "core/base/error_reason.h"
#include "core/base/monotonic_time.h"
#include "core/base/retry_delay.h"
#include "rpc/grpc_time.h"

namespace isoscope::server {

namespace {

// Returns the error with another code. Its reason goes with the old one, unless it was set.
absl::Status WithCode(absl::StatusCode code, absl::string_view prefix, const absl::Status& status) {
  absl::Status changed(code, absl::StrCat(prefix, status.message()));
  if (const std::optional<absl::Duration> delay = base::RetryDelayOf(status); delay.has_value()) {
    changed = base::WithRetryDelay(std::move(changed), *delay);
  }
  return changed;
}

bool IsOfSource(const absl::Status& status) {
  return !status.ok() && base::ReasonOf(status) == base::ErrorReason::kSourceUnreadable;
}

}  // namespace

absl::Status CallStatus(const absl::Status& status, bool was_cancelled_by_us) {
  if (IsOfSource(status)) {
    return status;
  }
  switch (status.code()) {
    case absl::StatusCode::kCancelled:
      return was_cancelled_by_us ? status : absl::UnavailableError(status.message());
    case absl::StatusCode::kUnknown:
      return WithCode(absl::StrContains(status.message(), "Stream removed")
                          ? absl::StatusCode::kUnavailable
                          : absl::StatusCode::kInternal,
                      "", status);
    case absl::StatusCode::kUnimplemented:
      return WithCode(absl::StatusCode::kUnavailable,
                      "the agent does not know the call, which was damaged on its way, or is of "
                      "another version: ",
                      status);
    case absl::StatusCode::kNotFound:
      return WithCode(absl::StatusCode::kDataLoss, "", status);
    case absl::StatusCode::kUnauthenticated:
    case absl::StatusCode::kPermissionDenied:
      return WithCode(absl::StatusCode::kUnavailable,
                      "the agent refuses the coordinator: ", status);
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kOutOfRange:
    case absl::StatusCode::kAlreadyExists:
    case absl::StatusCode::kAborted:
      return WithCode(absl::StatusCode::kInternal, "", status);
    default:
      return status;
  }
}

bool LacksParts(const absl::Status& status) {
  return absl::IsUnavailable(status) || absl::IsFailedPrecondition(status) ||
         absl::IsDataLoss(status) || IsOfSource(status);
}

void SetDeadline(base::MonotonicTime deadline, grpc::ClientContext* context) {
  if (deadline != base::MonotonicTime::InfiniteFuture()) {
    context->set_deadline(deadline);
  }
}

}  // namespace isoscope::server
