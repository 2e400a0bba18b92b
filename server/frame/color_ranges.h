// Gives the colour maps of a frame their ranges, before agents draw it (isoscope.v1.ColorRange).

#ifndef ISOSCOPE_SERVER_FRAME_COLOR_RANGES_H_
#define ISOSCOPE_SERVER_FRAME_COLOR_RANGES_H_

#include <vector>

#include "absl/status/status.h"

#include "core/frame/frame_spec.h"
#include "core/view/camera.h"
#include "server/cluster/frame_part.h"
#include "server/frame/frame_ends.h"
#include "server/frame/frame_runner.h"

namespace isoscope::server {

// A frame whose camera is known. All objects that it points to outlive the call.
struct FrameToRange {
  FrameRunner* runner = nullptr;
  const FrameIdentity* identity = nullptr;
  const FrameTarget* target = nullptr;
  // Those of the target; with allow_partial they lose those that no agent could do.
  std::vector<FramePart>* parts = nullptr;
  // Regions of the picture, which are drawn one after another to find what is visible; empty: all at
  // once.
  std::vector<view::Region> bands = {};
  bool is_drawn_after = false;          // the picture, with these ranges
  FollowingCalls* following = nullptr;  // as DrawingContext::following
};

// Returns the frame with steps of maps in place of colours, as it is drawn to find what is visible:
// without effects and output.
frame::FrameSpec SpecOfValues(const frame::FrameSpec& spec);

// Sets all ranges of `asked->spec` that its maps need. They follow from dataset, request and, with
// missing shards, from these alone. Those of what is visible have only values of the parts that are
// left in the end.
// Blocks: percentiles ask for the histogram unless it is known, and ranges of what is visible draw
// the frame, without effects, one to four times. Errors as FrameRunner::Run, AskHistogram and
// wire::ResolveColorRanges.
absl::Status ResolveRanges(const FrameToRange& frame, AskedFrame* asked);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_COLOR_RANGES_H_
