// IsosurfaceService over gRPC's callback API. Reactions validate the request, then start a
// frame_ticket with a picture_job or a pick_job. export_call.cc has exports.

#ifndef ISOSCOPE_SERVER_ISOSURFACE_SERVICE_IMPL_H_
#define ISOSCOPE_SERVER_ISOSURFACE_SERVICE_IMPL_H_

#include "absl/time/time.h"

#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "rpc/signs_of_life.h"
#include "server/admission/admission.h"
#include "server/admission/export_pace.h"
#include "server/frame/coordinator_state.h"
#include "server/frame/frame_runner.h"

namespace isoscope::server {

struct IsosurfaceServiceOptions {
  CoordinatorState* state = nullptr;  // outlives the service, as the runner does
  FrameRunner* runner = nullptr;
  absl::Duration max_frame_duration = absl::Minutes(5);
  // An export ends if an agent sends nothing for this long.
  absl::Duration max_agent_silence = absl::Minutes(5);
  // An export that has nothing to send tells its client this often that it goes on.
  absl::Duration sign_of_life_interval = rpc::kSignOfLifeInterval;
  ExportLimits export_limits = {};
};

// Thread-safe. Destroy it only after its server has shut down. A frame holds a thread from its
// beginning to its end; exports have threads of their own, because a slow client holds one.
class IsosurfaceServiceImpl final : public isoscope::v1::IsosurfaceService::CallbackService {
 public:
  static constexpr int kMaxConcurrentExports = 4;
  static constexpr int kMaxQueuedExports = 16;

  explicit IsosurfaceServiceImpl(const IsosurfaceServiceOptions& options);

  grpc::ServerUnaryReactor* RenderIsosurface(
      grpc::CallbackServerContext* context, const isoscope::v1::RenderIsosurfaceRequest* request,
      isoscope::v1::RenderIsosurfaceResponse* response) override;
  grpc::ServerWriteReactor<isoscope::v1::RenderIsosurfaceStreamResponse>* RenderIsosurfaceStream(
      grpc::CallbackServerContext* context,
      const isoscope::v1::RenderIsosurfaceStreamRequest* request) override;
  grpc::ServerUnaryReactor* PickSurface(grpc::CallbackServerContext* context,
                                        const isoscope::v1::PickSurfaceRequest* request,
                                        isoscope::v1::PickSurfaceResponse* response) override;
  grpc::ServerWriteReactor<isoscope::v1::ExportIsosurfaceResponse>* ExportIsosurface(
      grpc::CallbackServerContext* context,
      const isoscope::v1::ExportIsosurfaceRequest* request) override;

 private:
  class ExportCall;

  const IsosurfaceServiceOptions options_;
  Admission exports_;  // last: its threads use the members above
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ISOSURFACE_SERVICE_IMPL_H_
