// Tells why surfaces do not show in a picture (RenderIsosurfaceRequest.with_notes).

#ifndef ISOSCOPE_SERVER_FRAME_SURFACE_NOTES_H_
#define ISOSCOPE_SERVER_FRAME_SURFACE_NOTES_H_

#include <bitset>
#include <vector>

#include "absl/status/statusor.h"

#include "core/frame/frame_spec.h"
#include "core/view/camera.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/cluster/frame_part.h"
#include "server/frame/frame_runner.h"

namespace isoscope::server {

// The longer side of a picture that the search draws, in pixels, unless it is that of a region.
inline constexpr int kMaxNoteSidePx = 1024;

// A frame that was drawn. All objects that it points to outlive the call.
struct NotedFrame {
  FrameRunner* runner = nullptr;
  const FrameIdentity* identity = nullptr;
  const frame::FrameSpec* spec = nullptr;  // with the camera that was used
  const FrameTarget* target = nullptr;
  const std::vector<FramePart>* parts = nullptr;  // of all shards
  view::Viewport band;                            // the most that is drawn at a time
  std::bitset<frame::kMaxSurfaces> shown;         // picture::PictureContents
};

// Returns the notes, in ascending order of surfaces. Blocks: asks for the histogram, and draws the
// surfaces that do not show. Errors as FrameRunner::Run and AskHistogram.
absl::StatusOr<std::vector<isoscope::v1::SurfaceNote>> NotesOf(const NotedFrame& frame);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_SURFACE_NOTES_H_
