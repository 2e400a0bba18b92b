// Why a call failed, as programs read it: a reason finer than the code of a status, and whether the
// same call may work later. rpc/grpc_status sends both as google.rpc.ErrorInfo;
// docs/operations.md has the reasons in a table.

#ifndef ISOSCOPE_CORE_BASE_ERROR_REASON_H_
#define ISOSCOPE_CORE_BASE_ERROR_REASON_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::base {

enum class ErrorReason {
  kDatasetUnknown,
  kDatasetIncomplete,
  kDatasetIdDiffers,
  kInvalidField,
  kTooBusy,
  kRateLimited,
  kTooLarge,
  kAgentLost,
  kAgentOpening,
  kServerStops,
  kShardDamaged,
  kSourceUnreadable,
  kDeadlinePassed,
  kUnauthenticated,
  kPermissionDenied,
  kNotPossible,
  kCancelled,
  kUnimplemented,
  kInternal,
};
inline constexpr int kErrorReasonCount = static_cast<int>(ErrorReason::kInternal) + 1;

// "DATASET_UNKNOWN".
const char* NameOf(ErrorReason reason);
// Returns the reason of that name; none if there is none.
std::optional<ErrorReason> ErrorReasonFromName(absl::string_view name);
// Whether the same call may work later, without a change of the request.
bool IsTransient(ErrorReason reason);

// Returns `status` with the reason as a payload. REQUIRES: it is an error.
absl::Status WithReason(absl::Status status, ErrorReason reason);
// Returns `status` with text before its message. It keeps its reason and its retry delay.
absl::Status WithPrefix(absl::string_view prefix, const absl::Status& status);
// The reason that was set; without one, that of the code. REQUIRES: `status` is an error.
ErrorReason ReasonOf(const absl::Status& status);
// Returns the reason of an error that has none set. It follows from the code, and from whether the
// error has a retry delay.
ErrorReason DefaultReasonOf(const absl::Status& status);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_ERROR_REASON_H_
