// Effects that the coordinator applies once, to composited depths and colours. Agents take no part,
// so their number can't show.

#ifndef ISOSCOPE_CORE_FRAME_PICTURE_EFFECTS_H_
#define ISOSCOPE_CORE_FRAME_PICTURE_EFFECTS_H_

#include <optional>

#include "core/image/fragment.h"

namespace isoscope::frame {

// Darkens hollows. All lengths are in pixels of the final picture.
struct AmbientOcclusion {
  static constexpr int kMinRadiusPx = 4;
  static constexpr int kMaxRadiusPx = 56;
  // The distance beyond the radius that the effect reads, for its blur and its grid.
  static constexpr int kBorderPx = 8;

  int radius_px = 32;
  float strength = 1;  // 0 .. 1: the share of the light that a closed hollow loses

  friend bool operator==(const AmbientOcclusion&, const AmbientOcclusion&) = default;
};

// Lines where a surface ends in front of another one or of the background.
struct Silhouette {
  static constexpr int kMaxWidthPx = 16;
  // The distance beyond its width that a line reads, for the slopes beside a jump.
  static constexpr int kBorderPx = 2;

  int width_px = 2;  // of the final picture, 1 .. kMaxWidthPx
  image::Rgba8 color{0, 0, 0, 255};

  friend bool operator==(const Silhouette&, const Silhouette&) = default;
};

struct PictureEffects {
  // A pixel is the mean of samples_per_side x samples_per_side drawn ones: 1 .. kMaxSamplesPerSide.
  int samples_per_side = 1;
  std::optional<AmbientOcclusion> ambient_occlusion;
  std::optional<Silhouette> silhouette;

  static constexpr int kMaxSamplesPerSide = 4;
  [[nodiscard]] int samples() const { return samples_per_side * samples_per_side; }
  // Whether a pixel depends on its neighbours.
  [[nodiscard]] bool look_around() const {
    return ambient_occlusion.has_value() || silhouette.has_value();
  }

  friend bool operator==(const PictureEffects&, const PictureEffects&) = default;
};

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_PICTURE_EFFECTS_H_
