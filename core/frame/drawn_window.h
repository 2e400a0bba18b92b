// The window that agents draw for a picture. It has more pixels than the picture if the picture has
// several samples a pixel. It has a margin around a region whose pixels depend on their neighbours.

#ifndef ISOSCOPE_CORE_FRAME_DRAWN_WINDOW_H_
#define ISOSCOPE_CORE_FRAME_DRAWN_WINDOW_H_

#include <algorithm>
#include <cstddef>
#include <optional>

#include "absl/status/status.h"

#include "core/frame/frame_spec.h"
#include "core/view/camera.h"

namespace isoscope::frame {

// All lengths are in drawn pixels. A pixel of the picture has samples_per_side of them on each
// axis.
struct DrawnWindow {
  view::Viewport viewport;             // the whole
  std::optional<view::Region> region;  // the drawn part; not set: all of it
  // The first pixel of the picture within the drawn window.
  int begin_x = 0;
  int begin_y = 0;

  // Whether the picture equals the drawn window, pixel for pixel.
  [[nodiscard]] bool is_picture_of(const FrameSpec& spec) const {
    return viewport == spec.viewport && image_size() == ImageSizeOf(spec);
  }
  [[nodiscard]] view::Viewport image_size() const { return view::ImageSizeOf(viewport, region); }
  // Whether one view can draw it. A larger one is drawn in bands.
  [[nodiscard]] bool fits_a_view() const {
    return std::max(image_size().width_px, image_size().height_px) <= view::kMaxViewportPx;
  }

  friend bool operator==(const DrawnWindow&, const DrawnWindow&) = default;
};

// Pixels outside the viewport are background, so a margin ends at its border. REQUIRES: the spec's
// viewport and region validate, and their drawn sides fit an int.
DrawnWindow DrawnWindowOf(const FrameSpec& spec);

// INVALID_ARGUMENT if the drawn viewport is larger than a view's can be, or the drawn window is and
// the frame has the mask's culling, which is never drawn in bands. The message names samples,
// viewport and region.
absl::Status CheckDrawnWindow(const FrameSpec& spec);

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_DRAWN_WINDOW_H_
