// Takes the vertices of a block to the screen: x and y in 1/256 pixel, and window depth. Two blocks
// that share a vertex get the same integers for it, because the result depends on the vertex's
// position and the projection alone.

#ifndef ISOSCOPE_CORE_RENDER_SCREEN_VERTICES_H_
#define ISOSCOPE_CORE_RENDER_SCREEN_VERTICES_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/math/vec.h"

namespace isoscope::render {

inline constexpr int kSubpixelBits = 8;
inline constexpr std::int32_t kSubpixels = 1 << kSubpixelBits;
// Vertices further out than this are clipped first, so that products of coordinate differences fit
// 64 bits with room: (2 * 2^15 px * 2^8)^2 = 2^48.
inline constexpr double kGuardBandPx = 32768;
// The same for viewports above view::kMaxViewportPx: (2 * 2^17 px * 2^8)^2 = 2^52.
inline constexpr double kWideGuardBandPx = 131072;
// The largest depth of a vertex. Depths behind the far plane all show as 1, but must stay finite.
inline constexpr double kMaxVertexDepth = 4;
// The most elements that one vector operation reads or writes.
inline constexpr std::size_t kLaneSlack = 16;

// Takes index space to the screen.
struct Projection {
  std::array<double, 16> clip_from_index{};
  double width_px = 0;  // of the whole viewport
  double height_px = 0;
  // Screen coordinates count from this pixel of the whole viewport, which is the first of the
  // picture.
  std::int32_t origin_x = 0;
  std::int32_t origin_y = 0;
  double guard_band_px = kGuardBandPx;  // on both sides of the whole's first pixel
};

struct ClipVertex {
  double x = 0, y = 0, z = 0, w = 0;
};
// x and y from the picture's top left.
struct ScreenVertex {
  std::int32_t x = 0;
  std::int32_t y = 0;
  float z = 0;
};

// The vertices of a mesh on the screen. The vectors only grow, and are at least kLaneSlack elements
// longer than `count`.
struct ScreenVertices {
  std::size_t count = 0;
  std::vector<std::int32_t> x;
  std::vector<std::int32_t> y;
  std::vector<float> z;
  std::vector<std::uint32_t> packed;  // scratch of FillTinyTriangles

  void Resize(std::size_t vertex_count);
  [[nodiscard]] ScreenVertex operator[](std::size_t i) const { return {x[i], y[i], z[i]}; }
};

// The bounds of a block's vertices, in 1/256 pixel. Valid only if every vertex lies behind the near
// plane, as seen from the eye, and in the guard band.
struct ScreenBounds {
  bool is_valid = false;
  std::int32_t min_x = 0, min_y = 0, max_x = 0, max_y = 0;
};

// Fills x, y and z. REQUIRES: positions is not empty.
ScreenBounds TransformVertices(const Projection& projection, std::span<const math::Vec3f> positions,
                               ScreenVertices* vertices);

// One vertex, with the bits of TransformVertices, in two steps. The second has no value if the
// vertex must be clipped first.
ClipVertex ToClip(const Projection& projection, const math::Vec3f& position);
std::optional<ScreenVertex> ToScreen(const Projection& projection, const ClipVertex& clip);

}  // namespace isoscope::render

#endif  // ISOSCOPE_CORE_RENDER_SCREEN_VERTICES_H_
