// InteractService over gRPC's callback API. InteractiveSchedule decides which frame is drawn and
// when, RateControl how finely, and InteractOutbox which answer is sent. Frames are picture jobs,
// as those of IsosurfaceService.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_

#include "absl/time/time.h"

#include "isoscope/v1/interact_service.grpc.pb.h"
#include "server/frame/coordinator_state.h"
#include "server/frame/frame_runner.h"
#include "server/interact/interact_streams.h"

namespace isoscope::server {

struct InteractServiceOptions {
  CoordinatorState* state = nullptr;  // outlives the service, as the runner does
  FrameRunner* runner = nullptr;
  absl::Duration max_frame_duration = absl::Minutes(5);
};

// Thread-safe. Destroy it only after its server has shut down. An idle stream holds no thread.
class InteractServiceImpl final : public isoscope::v1::InteractService::CallbackService {
 public:
  explicit InteractServiceImpl(const InteractServiceOptions& options);
  ~InteractServiceImpl() override;

  grpc::ServerBidiReactor<isoscope::v1::InteractRequest, isoscope::v1::InteractResponse>* Interact(
      grpc::CallbackServerContext* context) override;

  // Ends all streams when the server stops: clients would keep them open.
  void EndStreams();

 private:
  class InteractCall;

  const InteractServiceOptions options_;
  InteractStreams<InteractCall> streams_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_
