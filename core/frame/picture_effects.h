// Effects that the coordinator applies once, to composited depths and colours. Agents take no part,
// so their number can't show. A new effect has its part of the message in wire/frame_convert, its
// stage in server/picture/picture_finish, and everything else here.

#ifndef ISOSCOPE_CORE_FRAME_PICTURE_EFFECTS_H_
#define ISOSCOPE_CORE_FRAME_PICTURE_EFFECTS_H_

#include <algorithm>
#include <cmath>
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

  [[nodiscard]] constexpr int margin_px() const { return radius_px + kBorderPx; }

  friend bool operator==(const AmbientOcclusion&, const AmbientOcclusion&) = default;
};

// Lines where a surface ends in front of another one or of the background.
struct Silhouette {
  static constexpr int kMaxWidthPx = 16;
  // The distance beyond its width that a line reads, for the slopes beside a jump.
  static constexpr int kBorderPx = 2;

  int width_px = 2;  // of the final picture, 1 .. kMaxWidthPx
  image::Rgba8 color{0, 0, 0, 255};

  [[nodiscard]] constexpr int margin_px() const { return width_px + kBorderPx; }

  friend bool operator==(const Silhouette&, const Silhouette&) = default;
};

// The most that a region's margin can be, in pixels of the picture.
inline constexpr int kMaxMarginPx = 64;
static_assert(AmbientOcclusion{.radius_px = AmbientOcclusion::kMaxRadiusPx}.margin_px() <=
              kMaxMarginPx);
static_assert(Silhouette{.width_px = Silhouette::kMaxWidthPx}.margin_px() <= kMaxMarginPx);

struct PictureEffects {
  // A pixel is the mean of samples_per_side x samples_per_side drawn ones: 1 .. kMaxSamplesPerSide.
  int samples_per_side = 1;
  std::optional<AmbientOcclusion> ambient_occlusion = std::nullopt;
  std::optional<Silhouette> silhouette = std::nullopt;

  static constexpr int kMaxSamplesPerSide = 4;
  [[nodiscard]] int samples() const { return samples_per_side * samples_per_side; }
  // Whether a pixel depends on its neighbours.
  [[nodiscard]] bool look_around() const {
    return ambient_occlusion.has_value() || silhouette.has_value();
  }
  // Returns how far the effects look around a pixel, in pixels of the picture: 0 to kMaxMarginPx.
  [[nodiscard]] int margin_px() const {
    return std::max(ambient_occlusion.has_value() ? ambient_occlusion->margin_px() : 0,
                    silhouette.has_value() ? silhouette->margin_px() : 0);
  }
  // Returns the effects of a picture whose sides are `factor` times as long; in (0, 1].
  [[nodiscard]] PictureEffects Scaled(double factor) const {
    const auto scaled = [&](int px, int least) {
      return std::max(least, static_cast<int>(std::lround(px * factor)));
    };
    PictureEffects effects = *this;
    if (effects.ambient_occlusion.has_value()) {
      effects.ambient_occlusion->radius_px =
          scaled(ambient_occlusion->radius_px, AmbientOcclusion::kMinRadiusPx);
    }
    if (effects.silhouette.has_value()) {
      effects.silhouette->width_px = scaled(silhouette->width_px, 1);
    }
    return effects;
  }

  friend bool operator==(const PictureEffects&, const PictureEffects&) = default;
};

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_PICTURE_EFFECTS_H_
