// A small picture of a frame, for what it tells about a large one.

#ifndef ISOSCOPE_CLIENT_CLI_COMMANDS_SMALL_FRAME_H_
#define ISOSCOPE_CLIENT_CLI_COMMANDS_SMALL_FRAME_H_

#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

// Returns the whole of a frame with at most `side_px` pixels a side, one sample a pixel, as a PNG.
isoscope::v1::RenderIsosurfaceRequest SmallFrameOf(
    const isoscope::v1::RenderIsosurfaceRequest& frame, int side_px);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_COMMANDS_SMALL_FRAME_H_
