// The pixels at which blocks could still win, from the coordinator to the agent that draws them:
// the list of masks of the blocks of one agent as bytes. The layout is in docs/format/wire.md.

#ifndef ISOSCOPE_CORE_VISIBILITY_OPEN_PIXELS_H_
#define ISOSCOPE_CORE_VISIBILITY_OPEN_PIXELS_H_

#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/image/pixel_mask.h"
#include "core/view/view.h"

namespace isoscope::visibility {

// Encodes the bits of masks, whose shapes the receiver knows (ClosedMaskOf). Thread-safe; pure.
std::string EncodeOpenPixels(std::span<const image::PixelMask> masks);

// The masks, each with the shape of ClosedMaskOf of its rectangle. Safe on hostile bytes: what is
// allocated depends on `rects` alone. DATA_LOSS if the bytes are damaged or are not of so many
// masks of these shapes. Thread-safe; pure. REQUIRES: rectangles as ClosedMaskOf does.
absl::StatusOr<std::vector<image::PixelMask>> DecodeOpenPixels(
    absl::string_view bytes, std::span<const view::PixelRect> rects);

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_OPEN_PIXELS_H_
