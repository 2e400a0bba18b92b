// InteractService over gRPC's callback API. What is drawn and when is decided by
// interactive_schedule, how finely by rate_control, what is sent by interact_outbox. Frames are
// picture jobs, as those of IsosurfaceService.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_

#include "isoscope/v1/interact_service.grpc.pb.h"
#include "server/interact/interact_call.h"
#include "server/interact/interact_streams.h"

namespace isoscope::server {

// Thread-safe. Destroy it only after its server has shut down.
class InteractServiceImpl final : public isoscope::v1::InteractService::CallbackService {
 public:
  explicit InteractServiceImpl(const InteractServiceOptions& options);

  grpc::ServerBidiReactor<isoscope::v1::InteractRequest, isoscope::v1::InteractResponse>* Interact(
      grpc::CallbackServerContext* context) override {
    return StartInteractCall(options_, &streams_, context);
  }

  // For a server that stops: its clients would keep the streams open.
  void EndStreams() { streams_.EndAll(); }

 private:
  const InteractServiceOptions options_;
  InteractStreams streams_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_
