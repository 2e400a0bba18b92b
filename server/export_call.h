// One call of IsosurfaceService.ExportIsosurface.

#ifndef ISOSCOPE_SERVER_EXPORT_CALL_H_
#define ISOSCOPE_SERVER_EXPORT_CALL_H_

#include "absl/time/time.h"

#include "isoscope/v1/isosurface_service.grpc.pb.h"
#include "server/access/access_control.h"
#include "server/admission/admission.h"
#include "server/cluster/agent_registry.h"
#include "server/export/export_pace.h"
#include "server/frame/frame_runner.h"

namespace isoscope::server {

// All of them outlive the calls.
struct ExportCallOptions {
  AgentRegistry* registry = nullptr;
  FrameRunner* runner = nullptr;
  AccessControl* access = nullptr;
  Admission* admission = nullptr;  // of exports
  // An export ends if an agent sends nothing for so long.
  absl::Duration max_agent_silence = absl::Minutes(5);
  ExportLimits limits = {};
};

// Answers the call. The reactor owns itself until gRPC is done with it.
grpc::ServerWriteReactor<isoscope::v1::ExportIsosurfaceResponse>* StartExportCall(
    const ExportCallOptions& options, grpc::CallbackServerContext* context,
    const isoscope::v1::ExportIsosurfaceRequest& request);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_EXPORT_CALL_H_
