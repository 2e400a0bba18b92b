#include "core/frame/drawn_window.h"

#include <algorithm>
#include <string>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

namespace isoscope::frame {
namespace {

int LongerSide(const view::Viewport& size) { return std::max(size.width_px, size.height_px); }

std::string SizeText(const view::Viewport& size) {
  return absl::StrCat(size.width_px, " x ", size.height_px);
}

}  // namespace

DrawnWindow DrawnWindowOf(const FrameSpec& spec) {
  const int scale = spec.effects.samples_per_side;
  DrawnWindow window;
  window.viewport = {spec.viewport.width_px * scale, spec.viewport.height_px * scale};
  if (!spec.region.has_value()) {
    return window;
  }
  const view::Region& region = *spec.region;
  const int margin = spec.effects.margin_px();
  const int begin_x = std::max(region.x - margin, 0);
  const int begin_y = std::max(region.y - margin, 0);
  const int end_x = std::min(region.x + region.width_px + margin, spec.viewport.width_px);
  const int end_y = std::min(region.y + region.height_px + margin, spec.viewport.height_px);
  window.region = view::Region{begin_x * scale, begin_y * scale, (end_x - begin_x) * scale,
                               (end_y - begin_y) * scale};
  window.begin_x = (region.x - begin_x) * scale;
  window.begin_y = (region.y - begin_y) * scale;
  return window;
}

absl::Status CheckDrawnWindow(const FrameSpec& spec) {
  const DrawnWindow window = DrawnWindowOf(spec);
  const int scale = spec.effects.samples_per_side;
  if (LongerSide(window.viewport) > view::kMaxWholeViewportPx) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "samples is %d with a viewport of %s pixels: its sides times %d must be at most %d; ask "
        "for fewer samples",
        spec.effects.samples(), SizeText(spec.viewport), scale, view::kMaxWholeViewportPx));
  }
  if (spec.culling == Culling::kMask && !window.fits_a_view()) {
    const int margin = spec.region.has_value() ? spec.effects.margin_px() : 0;
    return absl::InvalidArgumentError(absl::StrFormat(
        "samples is %d with a %s of %s pixels%s: with CULLING_MASK, which is never drawn in bands, "
        "its sides times %d must be at most %d; ask for %s",
        spec.effects.samples(), spec.region.has_value() ? "region" : "viewport",
        SizeText(ImageSizeOf(spec)),
        margin > 0 ? absl::StrCat(" and a margin of ", margin, " for effects") : "", scale,
        view::kMaxViewportPx,
        spec.region.has_value() ? "a smaller region" : "regions of it, or for fewer samples"));
  }
  return absl::OkStatus();
}

}  // namespace isoscope::frame
