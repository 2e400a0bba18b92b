// One call of InteractService.Interact.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_CALL_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_CALL_H_

#include "absl/time/time.h"

#include "isoscope/v1/interact_service.grpc.pb.h"
#include "server/access/access_control.h"
#include "server/frame/frame_runner.h"
#include "server/interact/interact_streams.h"

namespace isoscope::server {

struct InteractServiceOptions {
  FrameRunner* runner = nullptr;    // outlives the service
  AccessControl* access = nullptr;  // outlives the service, too
  absl::Duration max_frame_duration = absl::Minutes(5);
};

// Answers the call. The reactor owns itself until gRPC is done with it. `streams` and what
// `options` points to outlive it. An idle stream holds no thread.
grpc::ServerBidiReactor<isoscope::v1::InteractRequest, isoscope::v1::InteractResponse>*
StartInteractCall(const InteractServiceOptions& options, InteractStreams* streams,
                  grpc::CallbackServerContext* context);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_CALL_H_
