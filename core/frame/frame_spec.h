// The one description of a frame. The coordinator makes it from a request (wire::FrameSpecFromProto)
// and edits nothing else from then on. Agents get what they draw of it (wire::ToProto). A new
// parameter of a frame becomes a member here, one that agents do not draw a member of PictureEffects.

#ifndef ISOSCOPE_CORE_FRAME_FRAME_SPEC_H_
#define ISOSCOPE_CORE_FRAME_FRAME_SPEC_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"

#include "core/frame/appearance.h"
#include "core/frame/culling.h"
#include "core/frame/output_spec.h"
#include "core/frame/picture_effects.h"
#include "core/frame/picture_revision.h"
#include "core/image/fragment.h"
#include "core/view/camera.h"
#include "core/view/clip_region.h"
#include "core/volume/inside_rule.h"

namespace isoscope::frame {

// One surface of a frame.
struct Surface {
  volume::InsideRule rule = {};
  Appearance appearance = {};
  std::optional<ColorBy> color_by = std::nullopt;  // in place of the base colour
  float opacity = 1;                               // in (0, 1]; times that of the colour map

  [[nodiscard]] bool is_translucent() const {
    return opacity < 1 || (color_by.has_value() && color_by->is_translucent());
  }
  [[nodiscard]] bool shows_gradient() const { return Shows(ColorBy::Quantity::kGradientMagnitude); }
  [[nodiscard]] bool shows_field() const { return Shows(ColorBy::Quantity::kField); }
  // Whether its colour shows a value that vertices have.
  [[nodiscard]] bool shows_values() const { return shows_gradient() || shows_field(); }

  friend bool operator==(const Surface&, const Surface&) = default;

 private:
  [[nodiscard]] bool Shows(ColorBy::Quantity quantity) const {
    return color_by.has_value() && color_by->quantity == quantity;
  }
};

// Planes and lines have one byte for a surface, and 255 for none.
inline constexpr std::size_t kMaxSurfaces = 128;
inline constexpr int kMaxLayers = 16;
inline constexpr int kDefaultLayers = 8;

struct FrameSpec {
  // 1 to kMaxSurfaces. If fragments have equal depths, the one of the earlier surface shows.
  std::vector<Surface> surfaces;
  // Not set: the default camera of the dataset. The coordinator sets it before agents see it.
  std::optional<view::Camera> camera;
  view::Viewport viewport;
  // The window of the viewport that the picture shows, with the whole's pixels. Not set: all of it.
  std::optional<view::Region> region;
  Culling culling = Culling::kDepth;
  image::Rgba8 background_color{0, 0, 0, 255};
  view::ClipRegion clip;
  std::optional<ClipCaps> caps;  // not set: cuts are open
  // The largest number of translucent fragments that show in a pixel, nearest first; 1 to
  // kMaxLayers.
  int max_layers = kDefaultLayers;
  std::vector<Light> lights;  // at most kMaxLights; none: the head light
  std::uint64_t ray_seed = 0;
  // Agents never get these three. Missing values (NaN) that a colour map would show have this
  // colour; not set: DefaultNanColor of the map.
  std::optional<image::Rgba8> nan_color;
  OutputSpec output;
  PictureEffects effects;
  // Whether pixels carry normals (image::EncodeNormal) in place of colours. The coordinator decides
  // it, as the next one.
  bool sends_normals = false;
  // Whether pixels of surfaces that show values of vertices carry a step of the colour map
  // beside the normal (image/normal_and_step.h). Only with sends_normals.
  bool sends_map_steps = false;
  // Level whose samples are drawn; the coordinator chooses it. Camera, clip planes and values are
  // those of level 0 at every level.
  int level = 0;

  friend bool operator==(const FrameSpec&, const FrameSpec&) = default;
};

// Returns the size of the picture.
inline view::Viewport ImageSizeOf(const FrameSpec& spec) {
  return view::ImageSizeOf(spec.viewport, spec.region);
}

// Returns a frame of the same depths, owners and normals, for planes and picks. It has no effects.
// Its caps show surfaces: caps that show samples have a colour, but no normal.
FrameSpec WithoutLook(FrameSpec spec, bool sends_normals);

// Returns a frame whose isovalues and ranges of samples are those of stored values: field units times
// a power of two (volume::VolumeLevel::value_scale). Labels stay: their levels are not scaled.
//
// value_scale:  of the drawn volume, at least 1
// color_scales: by surface, of the volume that its colour shows; empty: all are 1
FrameSpec InStoredValues(FrameSpec spec, double value_scale,
                         const std::vector<double>& color_scales);
// Returns the isovalue, or the rule of labels as it is. The largest isovalues stay finite.
volume::InsideRule InStoredValues(volume::InsideRule rule, double value_scale);

// Returns true if a surface is translucent: then the frame has layers (image::LayerStack).
bool HasLayers(const FrameSpec& spec);

// Whether a surface shows values of vertices.
bool ShowsValues(const FrameSpec& spec);
// Whether caps show samples through a colour map.
inline bool HasSampleCaps(const FrameSpec& spec) {
  return spec.caps.has_value() && spec.caps->map.has_value();
}
// Returns the colour of missing values (NaN) beside the colours of a map.
inline image::Rgba8 NanColorOf(const FrameSpec& spec, ColorMap map) {
  return spec.nan_color.value_or(DefaultNanColor(map));
}
// Returns the back end that draws a frame on agents of `agents_back_end`: the CPU draws values. It
// decides the frame's tie rule and the margin of its caps.
inline BackEnd DrawnBy(const FrameSpec& spec, BackEnd agents_back_end) {
  return ShowsValues(spec) ? BackEnd::kCpu : agents_back_end;
}

// Returns the rules of the surfaces, in their order.
std::vector<volume::InsideRule> RulesOf(const FrameSpec& spec);
// Returns them as text, for logs and errors: "isovalue 3.5; label 7". The first 16 are told.
std::string TextOf(const std::vector<volume::InsideRule>& rules);

// Returns the number of surfaces that owners tell apart. If pixels carry normals, a cap that shows
// samples still has a colour. Its owner is then an extra surface, after the last one.
std::size_t OwnerSurfaceCount(const FrameSpec& spec);

// INVALID_ARGUMENT if the owners of fragments of `surface_count` surfaces, in a volume of
// `block_count` blocks, do not fit into 32 bits (image::FragmentOrder).
absl::Status CheckOwners(std::size_t surface_count, std::int64_t block_count);

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_FRAME_SPEC_H_
