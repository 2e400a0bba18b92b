#include "server/frame/agent_call.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace isoscope::server {

absl::Status CallStatus(const absl::Status& status, bool was_cancelled_by_us) {
  const bool is_cut =
      (absl::IsCancelled(status) && !was_cancelled_by_us) ||
      (absl::IsUnknown(status) && absl::StrContains(status.message(), "Stream removed"));
  if (is_cut) {
    return absl::UnavailableError(status.message());
  }
  if (absl::IsUnimplemented(status)) {
    return absl::UnavailableError(
        absl::StrCat("the agent does not know the call, which was damaged on its way, or is of "
                     "another version: ",
                     status.message()));
  }
  return absl::IsInvalidArgument(status) ? absl::InternalError(status.message()) : status;
}

void SetDeadline(absl::Time deadline, grpc::ClientContext* context) {
  if (deadline != absl::InfiniteFuture()) {
    context->set_deadline(absl::ToChronoTime(deadline));
  }
}

}  // namespace isoscope::server
