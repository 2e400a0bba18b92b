// What one agent is asked to do for one frame; no wire types.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_REQUEST_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_REQUEST_H_

#include <cstdint>

#include "core/frame/culling.h"
#include "core/render/appearance.h"
#include "core/view/camera.h"

namespace isoscope::agent {

struct FrameRequest {
  std::int64_t frame_number = 0;  // the coordinator's
  double isovalue = 0;            // finite
  view::Camera camera;
  view::Viewport viewport;
  frame::Culling culling = frame::Culling::kDepth;
  render::Appearance appearance;
  std::uint64_t ray_seed = 0;
  int agent_index = 0;  // its part of the rays: agent_index of agent_count
  int agent_count = 1;
  bool report_active_blocks = true;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_REQUEST_H_
