// The cost of a frame, as clients see it.

#ifndef ISOSCOPE_SERVER_FRAME_RENDER_STATISTICS_H_
#define ISOSCOPE_SERVER_FRAME_RENDER_STATISTICS_H_

#include "isoscope/v1/frame.pb.h"
#include "server/frame/frame_coordinator.h"

namespace isoscope::server {

// Returns sums over agents and the coordinator's own times, without size and time of the PNG.
isoscope::v1::RenderStatistics StatisticsOf(const FrameResult& result);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_RENDER_STATISTICS_H_
