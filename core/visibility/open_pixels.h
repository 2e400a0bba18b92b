// Encodes, for the blocks that an agent draws in step 3, the pixels that they could still win. The
// coordinator sends these masks to the agent. Layout: docs/format/wire.md, "Open pixels".

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

// Decodes one mask for each rectangle, with the shape of ClosedMaskOf(rect). Safe for any bytes:
// memory depends on `rects` alone. DATA_LOSS if the bytes are damaged, or hold other than one mask
// of that shape for each rectangle. Thread-safe; pure. REQUIRES: rectangles as for ClosedMaskOf.
absl::StatusOr<std::vector<image::PixelMask>> DecodeOpenPixels(
    absl::string_view bytes, std::span<const view::PixelRect> rects);

}  // namespace isoscope::visibility

#endif  // ISOSCOPE_CORE_VISIBILITY_OPEN_PIXELS_H_
