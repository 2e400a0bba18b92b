// Projects in double and snaps x and y to 1/256 pixel, ties to even. TransformVertices does it for
// a vertex in each lane, ToClip and ToScreen for one vertex. Both have the same operations in the
// same order, without fused multiply-add, and so give the same bits on every instruction set.

#include "core/render/screen_vertices.h"

#include <algorithm>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/render/screen_vertices.cc"
#include "hwy/foreach_target.h"
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::render {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// 1.5 * 2^52: adding it leaves a number's nearest integer (ties to even) in the low bits.
constexpr double kRoundingShift = 6755399441055744.0;

ScreenBounds TransformVertices(const Projection& projection, std::span<const math::Vec3f> positions,
                               ScreenVertices* vertices) {
  const hn::CappedTag<double, 8> dd;
  const hn::RebindToUnsigned<decltype(dd)> d64;
  const hn::Rebind<float, decltype(dd)> df;
  const hn::Rebind<std::uint32_t, decltype(dd)> du;
  const hn::Rebind<std::int32_t, decltype(dd)> di;
  using VD = hn::Vec<decltype(dd)>;
  const std::size_t lanes = hn::Lanes(dd);

  const std::array<double, 16>& m = projection.clip_from_index;
  const VD one = hn::Set(dd, 1.0);
  const VD half = hn::Set(dd, 0.5);
  const VD width = hn::Set(dd, projection.width_px);
  const VD height = hn::Set(dd, projection.height_px);
  const VD band = hn::Set(dd, projection.guard_band_px);
  const VD subpixels = hn::Set(dd, static_cast<double>(kSubpixels));
  // The origin is a whole number of pixels, so that taking it off here does not change how a
  // coordinate is rounded.
  const VD shift_x = hn::Set(dd, kRoundingShift - projection.origin_x * kSubpixels);
  const VD shift_y = hn::Set(dd, kRoundingShift - projection.origin_y * kSubpixels);
  const VD max_depth = hn::Set(dd, kMaxVertexDepth);
  auto all_valid = hn::FirstN(dd, lanes);
  auto min_x = hn::Set(di, std::int32_t{1} << 30);
  auto min_y = min_x;
  auto max_x = hn::Neg(min_x);
  auto max_y = max_x;

  const auto transform = [&](const float* from, std::size_t to) HWY_ATTR {
    // Positions become clip coordinates, in double.
    hn::Vec<decltype(df)> fx, fy, fz;
    hn::LoadInterleaved3(df, from, fx, fy, fz);
    const VD px = hn::PromoteTo(dd, fx);
    const VD py = hn::PromoteTo(dd, fy);
    const VD pz = hn::PromoteTo(dd, fz);
    const auto row = [&](std::size_t r) HWY_ATTR {
      const VD xy = hn::Add(hn::Mul(hn::Set(dd, m[r]), px), hn::Mul(hn::Set(dd, m[4 + r]), py));
      return hn::Add(hn::Add(xy, hn::Mul(hn::Set(dd, m[8 + r]), pz)), hn::Set(dd, m[12 + r]));
    };
    const VD clip_x = row(0);
    const VD clip_y = row(1);
    const VD clip_z = row(2);
    const VD clip_w = row(3);
    // Clip coordinates become pixels and window depth, row 0 at the top.
    const VD inverse_w = hn::Div(one, clip_w);
    const VD x = hn::Mul(hn::Add(hn::Mul(hn::Mul(clip_x, inverse_w), half), half), width);
    const VD y = hn::Mul(hn::Sub(half, hn::Mul(hn::Mul(clip_y, inverse_w), half)), height);
    const VD z = hn::Add(hn::Mul(hn::Mul(clip_z, inverse_w), half), half);
    // One vertex that must be clipped makes the whole block take the path that clips.
    const auto in_front = hn::And(hn::Gt(clip_w, hn::Zero(dd)), hn::Ge(clip_z, hn::Neg(clip_w)));
    const auto in_band = hn::And(hn::Le(hn::Abs(x), band), hn::Le(hn::Abs(y), band));
    all_valid = hn::And(all_valid, hn::And(in_front, in_band));
    // The low 32 bits of the shifted number are v in 1/256 pixel, rounded.
    const auto snap = [&](VD v, VD shift) HWY_ATTR {
      const VD shifted = hn::Add(hn::Mul(v, subpixels), shift);
      return hn::BitCast(di, hn::TruncateTo(du, hn::BitCast(d64, shifted)));
    };
    const auto xi = snap(x, shift_x);
    const auto yi = snap(y, shift_y);
    min_x = hn::Min(min_x, xi);
    min_y = hn::Min(min_y, yi);
    max_x = hn::Max(max_x, xi);
    max_y = hn::Max(max_y, yi);
    hn::StoreU(xi, di, vertices->x.data() + to);
    hn::StoreU(yi, di, vertices->y.data() + to);
    hn::StoreU(hn::DemoteTo(df, hn::Min(z, max_depth)), df, vertices->z.data() + to);
  };

  vertices->Resize(positions.size());
  std::size_t i = 0;
  for (; i + lanes <= positions.size(); i += lanes) {
    transform(&positions[i].x, i);
  }
  if (i < positions.size()) {
    // The last vertex fills the lanes that are left over.
    std::array<math::Vec3f, 8> rest;
    for (std::size_t k = 0; k < lanes; ++k) {
      rest[k] = positions[std::min(i + k, positions.size() - 1)];
    }
    transform(&rest[0].x, i);
  }
  return {.is_valid = hn::AllTrue(dd, all_valid),
          .min_x = hn::GetLane(hn::MinOfLanes(di, min_x)),
          .min_y = hn::GetLane(hn::MinOfLanes(di, min_y)),
          .max_x = hn::GetLane(hn::MaxOfLanes(di, max_x)),
          .max_y = hn::GetLane(hn::MaxOfLanes(di, max_y))};
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::render {
namespace {

HWY_EXPORT(TransformVertices);

}  // namespace

void ScreenVertices::Resize(std::size_t vertex_count) {
  count = vertex_count;
  const std::size_t padded = vertex_count + kLaneSlack;
  if (x.size() < padded) {
    y.resize(padded);
    z.resize(padded);
    packed.resize(padded);
    x.resize(padded);  // the last: if memory runs out before, the next call resizes all
  }
}

ScreenBounds TransformVertices(const Projection& projection, std::span<const math::Vec3f> positions,
                               ScreenVertices* vertices) {
  return HWY_DYNAMIC_DISPATCH(TransformVertices)(projection, positions, vertices);
}

ClipVertex ToClip(const Projection& projection, const math::Vec3f& position) {
  const std::array<double, 16>& m = projection.clip_from_index;
  const double x = static_cast<double>(position.x);
  const double y = static_cast<double>(position.y);
  const double z = static_cast<double>(position.z);
  return {m[0] * x + m[4] * y + m[8] * z + m[12], m[1] * x + m[5] * y + m[9] * z + m[13],
          m[2] * x + m[6] * y + m[10] * z + m[14], m[3] * x + m[7] * y + m[11] * z + m[15]};
}

std::optional<ScreenVertex> ToScreen(const Projection& projection, const ClipVertex& clip) {
  if (!(clip.w > 0) || !(clip.z >= -clip.w)) {
    return std::nullopt;
  }
  const double inverse_w = 1.0 / clip.w;
  const double x = (clip.x * inverse_w * 0.5 + 0.5) * projection.width_px;
  const double y = (0.5 - clip.y * inverse_w * 0.5) * projection.height_px;
  if (!(std::abs(x) <= projection.guard_band_px && std::abs(y) <= projection.guard_band_px)) {
    return std::nullopt;
  }
  const auto snap = [](double v, std::int32_t origin) {
    return static_cast<std::int32_t>(std::lrint(v * kSubpixels)) - origin * kSubpixels;
  };
  return ScreenVertex{
      .x = snap(x, projection.origin_x),
      .y = snap(y, projection.origin_y),
      .z = static_cast<float>(std::min(clip.z * inverse_w * 0.5 + 0.5, kMaxVertexDepth))};
}

}  // namespace isoscope::render
#endif  // HWY_ONCE
