// The end and the deadline of a call to an agent: what all such calls have in common.

#ifndef ISOSCOPE_SERVER_FRAME_AGENT_CALL_H_
#define ISOSCOPE_SERVER_FRAME_AGENT_CALL_H_

#include "absl/status/status.h"
#include <grpcpp/client_context.h>

#include "core/base/monotonic_time.h"

namespace isoscope::server {

// Returns how a call to an agent ended, as AgentFailure::status, with the agent's reason and retry
// delay. Keeps codes, except those that would mislead the client:
//
// - NOT_FOUND becomes DATA_LOSS: a file of a shard is gone, not the dataset (an older agent).
// - UNAUTHENTICATED and PERMISSION_DENIED become UNAVAILABLE: the agent refuses the coordinator.
// - UNAVAILABLE replaces the codes of a stream that was cut, but not by us, and of a call that the
//   agent does not know.
// - INVALID_ARGUMENT (the coordinator's message was wrong), OUT_OF_RANGE, ALREADY_EXISTS, ABORTED
//   and UNKNOWN become INTERNAL.
//
// Of a source that the agent can't read (ErrorReason::kSourceUnreadable) all codes stay.
absl::Status CallStatus(const absl::Status& status, bool was_cancelled_by_us);

// Returns true if only the shards of the agent are missing in a picture that may lack some: the agent
// is gone, its shards are damaged, or it can't read their source. Other errors would occur in the
// other parts too. `status` is of CallStatus, or OK.
bool LacksParts(const absl::Status& status);

// The call ends by itself then; base::MonotonicTime::InfiniteFuture(): never.
void SetDeadline(base::MonotonicTime deadline, grpc::ClientContext* context);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_AGENT_CALL_H_
