// What a frame took, as clients see it.

#ifndef ISOSCOPE_SERVER_RENDER_STATISTICS_H_
#define ISOSCOPE_SERVER_RENDER_STATISTICS_H_

#include "isoscope/v1/frame.pb.h"
#include "server/frame_coordinator.h"

namespace isoscope::server {

// Sums over agents, and what the coordinator measured; without the PNG's size and time.
isoscope::v1::RenderStatistics StatisticsOf(const FrameResult& result);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_RENDER_STATISTICS_H_
