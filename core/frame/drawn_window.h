// The window that agents draw for a picture. It has more pixels than the picture if the picture has
// several samples a pixel. It has a margin around a region whose pixels depend on their neighbours.

#ifndef ISOSCOPE_CORE_FRAME_DRAWN_WINDOW_H_
#define ISOSCOPE_CORE_FRAME_DRAWN_WINDOW_H_

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

  friend bool operator==(const DrawnWindow&, const DrawnWindow&) = default;
};

// Pixels outside the viewport are background, so a margin ends at its border. REQUIRES: the spec's
// viewport and region validate, and their drawn sides fit an int.
DrawnWindow DrawnWindowOf(const FrameSpec& spec);

// INVALID_ARGUMENT if the drawn window is larger than a view can be; the message names samples,
// viewport and region.
absl::Status CheckDrawnWindow(const FrameSpec& spec);

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_DRAWN_WINDOW_H_
