// The picks of one call: the surface points at some pixels. A pick is a frame of the smallest
// region that holds its pixels. The agents then tell the shards of the blocks at these pixels, and
// the gradients and the values of all fields there.

#ifndef ISOSCOPE_SERVER_FRAME_PICK_JOB_H_
#define ISOSCOPE_SERVER_FRAME_PICK_JOB_H_

#include <memory>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "isoscope/v1/isosurface_service.pb.h"
#include "server/frame/agent_queries.h"
#include "server/frame/frame_runner.h"
#include "server/frame/frame_ticket.h"
#include "server/picture/frame_output.h"
#include "wire/pick_convert.h"

namespace isoscope::server {

// Holds the images, as PictureJob does. For one thread at a time.
class PickJob {
 public:
  using Request = isoscope::v1::PickSurfaceRequest;
  using Response = isoscope::v1::PickSurfaceResponse;

  // As PictureJob::Admit.
  static absl::StatusOr<std::unique_ptr<PickJob>> Admit(FrameRunner* runner,
                                                        std::shared_ptr<FrameTicket> ticket,
                                                        const Request& request);

  // Fills `response`. Blocks. Errors as IsosurfaceService says. Call once.
  absl::Status Run(Response* response);

 private:
  // The surface point that a pixel shows.
  struct Point {
    std::optional<PixelPoint> seen;  // not set: the background
    bool is_on_cap = false;
    PointAnswer answer;  // of the agents
  };

  PickJob(FrameRunner* runner, std::shared_ptr<FrameTicket> ticket, wire::PickSpec pick);

  absl::Status TryRun(Response* response);
  // Sets the shards, gradients and values of fields of all points that were hit.
  absl::Status AskAgentsOfPoints(const FrameTarget& target, const std::vector<FramePart>& parts);

  FrameRunner& runner_;
  const std::shared_ptr<FrameTicket> ticket_;
  AskedFrame asked_;  // has a region
  const std::vector<wire::PixelPosition> pixels_;
  FrameResult drawn_;
  FrameCost cost_;
  std::vector<Point> points_;  // by pixel
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_PICK_JOB_H_
