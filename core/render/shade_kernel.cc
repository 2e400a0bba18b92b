// The shade of a pixel whose triangle is known, one pixel in each lane:
//
// 1. Set up the ray through the pixel's centre. Origin and direction are linear over the picture
//    (ShadeRays), so they cost two multiplications a component.
// 2. Find where the ray meets the plane of the triangle a, b, c, as weights of b and c. With p =
//    direction x (c - a), q = (origin - a) x (b - a) and determinant = (b - a) . p, they are wb =
//    (origin - a) . p / determinant and wc = direction . q / determinant. The pixel lies in the
//    triangle, except for the snapping of vertices; so weights are clamped.
// 3. Mix the normals of the vertices with the weights; and the levels, if the surface has them.
// 4. The step is |n . v| * 4096, rounded, with n the unit normal and v the unit direction of the
//    ray. A table of the surface then gives the colour.
//
// A triangle that is seen from the side has a small determinant, in which most digits cancel. Where
// rounding could move a weight by more than a quarter, the pixel is reported as inexact and the
// caller computes its step in doubles. Both ways depend on triangle, view and pixel alone, not on
// the lane, so a pixel gets the same bits in every batch.
//
// Source: Moeller, Trumbore 1997, "Fast, minimum storage ray-triangle intersection".

#include "core/render/shade_kernel.h"

#include <algorithm>

#include "core/math/matrix.h"
#include "core/math/vec.h"
#include "core/mesh/compact_mesh.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/render/shade_kernel.cc"
#include "hwy/foreach_target.h"
//
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::render {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::CappedTag<float, 16>;
using DI = hn::RebindToSigned<DF>;
using DU = hn::RebindToUnsigned<DF>;
using VF = hn::Vec<DF>;

struct Vec3 {
  VF x;
  VF y;
  VF z;
};
HWY_INLINE Vec3 Subtract(const Vec3& a, const Vec3& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
HWY_INLINE VF Dot(const Vec3& a, const Vec3& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE Vec3 Cross(const Vec3& a, const Vec3& b) {
  return {hn::Sub(hn::Mul(a.y, b.z), hn::Mul(a.z, b.y)),
          hn::Sub(hn::Mul(a.z, b.x), hn::Mul(a.x, b.z)),
          hn::Sub(hn::Mul(a.x, b.y), hn::Mul(a.y, b.x))};
}
HWY_INLINE VF SumOfMagnitudes(const Vec3& a) {
  return hn::Add(hn::Add(hn::Abs(a.x), hn::Abs(a.y)), hn::Abs(a.z));
}
HWY_INLINE Vec3 At(const view::LinearVec3f& f, VF x, VF y) {
  const DF df;
  const auto axis = [&](std::size_t i) HWY_ATTR {
    return hn::Add(hn::Add(hn::Set(df, f.at[i]), hn::Mul(hn::Set(df, f.per_x[i]), x)),
                   hn::Mul(hn::Set(df, f.per_y[i]), y));
  };
  return {axis(0), axis(1), axis(2)};
}
HWY_INLINE Vec3 LoadPosition(const ShadeBatch& batch, std::size_t corner, std::size_t i) {
  const auto axis = [&](std::size_t k) HWY_ATTR {
    return hn::LoadU(DF(), batch.position[3 * corner + k].data() + i);
  };
  return {axis(0), axis(1), axis(2)};
}
HWY_INLINE Vec3 LoadNormal(const ShadeBatch& batch, std::size_t corner, std::size_t i) {
  const auto axis = [&](std::size_t k) HWY_ATTR {
    return hn::ConvertTo(DF(), hn::LoadU(DI(), batch.normal[3 * corner + k].data() + i));
  };
  return {axis(0), axis(1), axis(2)};
}

// If the levels at all corners are equal, the result is that level, for any weights.
HWY_INLINE void MixMapLevels(VF wb, VF wc, std::size_t i, ShadeBatch* batch) {
  const DF df;
  const VF a = hn::LoadU(df, batch->map_level[0].data() + i);
  const VF b = hn::Sub(hn::LoadU(df, batch->map_level[1].data() + i), a);
  const VF c = hn::Sub(hn::LoadU(df, batch->map_level[2].data() + i), a);
  hn::StoreU(hn::Add(a, hn::Add(hn::Mul(b, wb), hn::Mul(c, wc))), df,
             batch->mixed_map_level.data() + i);
}

void ComputeShadeSteps(const ShadeRays& rays, ShadeBatch* batch) {
  const DF df;
  const DU du;
  const VF zero = hn::Zero(df);
  const VF one = hn::Set(df, 1.0F);
  // Rounding errs by a few units of 2^-24 of the numbers that cancel. If the determinant is more
  // than 2^-20 of them, a weight is wrong by a quarter at most.
  const VF resolution = hn::Set(df, 0x1p-20F);
  const VF no_normal = hn::Set(df, 1e-12F * mesh::kNormalScale * mesh::kNormalScale);
  batch->inexact_count = 0;
  for (std::size_t i = 0; i < batch->count; i += hn::Lanes(df)) {
    // Step 1: rays through the pixels.
    const VF x = hn::LoadU(df, batch->x.data() + i);
    const VF y = hn::LoadU(df, batch->y.data() + i);
    const Vec3 origin = At(rays.index_origin, x, y);
    const Vec3 direction = At(rays.index_direction, x, y);
    // Step 2: weights.
    const Vec3 a = LoadPosition(*batch, 0, i);
    const Vec3 ab = Subtract(LoadPosition(*batch, 1, i), a);
    const Vec3 ac = Subtract(LoadPosition(*batch, 2, i), a);
    const Vec3 to_origin = Subtract(origin, a);
    const Vec3 p = Cross(direction, ac);
    const Vec3 q = Cross(to_origin, ab);
    const VF determinant = Dot(ab, p);
    const VF cancelling = hn::Mul(
        hn::Mul(hn::Add(SumOfMagnitudes(origin), SumOfMagnitudes(a)), SumOfMagnitudes(direction)),
        hn::Add(SumOfMagnitudes(ab), SumOfMagnitudes(ac)));
    const auto is_exact = hn::Gt(hn::Abs(determinant), hn::Mul(cancelling, resolution));
    const VF inverse = hn::Div(one, determinant);
    const VF wb = hn::Min(hn::Max(hn::Mul(Dot(to_origin, p), inverse), zero), one);
    const VF wc = hn::Min(hn::Max(hn::Mul(Dot(direction, q), inverse), zero), hn::Sub(one, wb));

    // Step 3: normals.
    const Vec3 na = LoadNormal(*batch, 0, i);
    const Vec3 nb = Subtract(LoadNormal(*batch, 1, i), na);
    const Vec3 nc = Subtract(LoadNormal(*batch, 2, i), na);
    const auto mix = [&](VF n, VF b, VF c)
                         HWY_ATTR { return hn::Add(n, hn::Add(hn::Mul(b, wb), hn::Mul(c, wc))); };
    const Vec3 normal{mix(na.x, nb.x, nc.x), mix(na.y, nb.y, nc.y), mix(na.z, nb.z, nc.z)};
    if (batch->keeps_normals) {
      hn::StoreU(normal.x, df, batch->mixed_normal[0].data() + i);
      hn::StoreU(normal.y, df, batch->mixed_normal[1].data() + i);
      hn::StoreU(normal.z, df, batch->mixed_normal[2].data() + i);
    }
    if (batch->keeps_map_levels) {
      MixMapLevels(wb, wc, i, batch);
    }
    // Step 4: the step of |n . v|. Without a normal the surface is shaded as if it faced the eye.
    const Vec3 ray = At(rays.world_direction, x, y);
    const VF normal_squared = Dot(normal, normal);
    const VF facing =
        hn::Div(hn::Abs(Dot(normal, ray)), hn::Sqrt(hn::Mul(normal_squared, Dot(ray, ray))));
    const VF cosine = hn::IfThenElse(hn::Gt(normal_squared, no_normal), hn::Min(facing, one), one);
    const VF step =
        hn::Add(hn::Mul(cosine, hn::Set(df, static_cast<float>(kShadeSteps))), hn::Set(df, 0.5F));
    // An inexact step may be NaN. It is replaced by 0 and listed for the caller.
    const VF safe_step = hn::IfThenElseZero(is_exact, step);
    hn::StoreU(hn::BitCast(du, hn::ConvertTo(DI(), safe_step)), du, batch->step.data() + i);
    const auto is_inexact = hn::Not(hn::RebindMask(du, is_exact));
    const auto in_use = hn::FirstN(du, std::min(batch->count - i, hn::Lanes(du)));
    const auto redo = hn::And(is_inexact, in_use);
    if (!hn::AllFalse(du, redo)) {
      hn::StoreU(hn::Compress(hn::Iota(du, static_cast<std::uint32_t>(i)), redo), du,
                 batch->inexact.data() + batch->inexact_count);
      batch->inexact_count += hn::CountTrue(du, redo);
    }
  }
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::render
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace isoscope::render {
namespace {

HWY_EXPORT(ComputeShadeSteps);

}  // namespace

ShadeRays::ShadeRays(const view::View& view) {
  view::PixelRays rays = view.image_plane().rays;
  world_direction = view::ToFloats(rays.direction);
  // Go on to the near plane.
  const double near_distance = view.near_distance();
  rays.origin = {rays.origin.at + rays.direction.at * near_distance,
                 rays.origin.per_x + rays.direction.per_x * near_distance,
                 rays.origin.per_y + rays.direction.per_y * near_distance};
  rays = rays.TransformedBy(view.index_from_world());
  index_origin = view::ToFloats(rays.origin);
  index_direction = view::ToFloats(rays.direction);
}

void ComputeShadeSteps(const ShadeRays& rays, ShadeBatch* batch) {
  HWY_DYNAMIC_DISPATCH(ComputeShadeSteps)(rays, batch);
}

}  // namespace isoscope::render
#endif  // HWY_ONCE
