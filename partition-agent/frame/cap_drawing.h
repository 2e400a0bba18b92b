// Draws the caps of a frame (core/render/clip_caps.h) that lie in an agent's blocks.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_CAP_DRAWING_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_CAP_DRAWING_H_

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/frame/frame_spec.h"
#include "core/frame/picture_revision.h"
#include "core/image/frame_image.h"
#include "core/view/view.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/shard/shard.h"
#include "partition-agent/supply/color_volumes.h"

namespace isoscope::agent {

// Adds the caps in the blocks of `shards` to `image`, which the view drew. The first of two
// fragments of a pixel, in the order of the frame, stays. Each block that the cut meets is read at
// most once, also in the volumes of `colors` that caps show. Blocks that their spans decide are not
// read. Returns the bytes read. Blocks; works in the arena. DATA_LOSS if a block is damaged; the
// error of `cancellation` if it fires.
//
// spec:     has caps
// drawn_by: the back end that drew the image; decides the tie rule and the margin of caps
absl::StatusOr<std::int64_t> DrawCaps(const Shards& shards, const ColorVolumes& colors,
                                      const view::View& view, const frame::FrameSpec& spec,
                                      frame::BackEnd drawn_by, const AgentResources& resources,
                                      const base::Cancellation& cancellation,
                                      image::FrameImage* image);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_CAP_DRAWING_H_
