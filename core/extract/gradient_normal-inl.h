// The normal of a gradient, for vertices of isovalues (vertex_placement-inl.h) and of labels
// (label_kernels.cc). Included once for each instruction set, by both kernels.
//
// The gradient is taken to world space, negated, scaled by its largest component, so that squares
// neither overflow nor vanish, and normalised. No step depends on the width of a register, so all
// instruction sets give the same bits. Formula: docs/numerics.md, "Normals".

// Highway's guard: defined and undefined in turn.
#if defined(ISOSCOPE_CORE_EXTRACT_GRADIENT_NORMAL_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ISOSCOPE_CORE_EXTRACT_GRADIENT_NORMAL_INL_H_
#undef ISOSCOPE_CORE_EXTRACT_GRADIENT_NORMAL_INL_H_
#else
#define ISOSCOPE_CORE_EXTRACT_GRADIENT_NORMAL_INL_H_
#endif

#include <array>
#include <cstdint>

#include "core/math/matrix.h"
#include "hwy/highway.h"

HWY_BEFORE_NAMESPACE();
namespace isoscope::extract {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

using DoubleTag = hn::ScalableTag<double>;
using DoubleVec = hn::Vec<DoubleTag>;
using FloatHalfTag = hn::Rebind<float, DoubleTag>;
using IntHalfTag = hn::Rebind<std::int32_t, DoubleTag>;

// Normals of a register of gradients, in world space.
struct GradientNormal {
  std::array<DoubleVec, 3> components;  // 0 where the gradient is zero or not finite
  DoubleVec largest;                    // component of the world gradient, without its sign
  DoubleVec square;                     // of the world gradient's length, in parts of `largest`
  hn::Mask<DoubleTag> is_usable;        // false: the gradient is zero or not finite
};

HWY_INLINE GradientNormal NormalOf(const std::array<DoubleVec, 3>& gradient,
                                   const math::Mat3d& to_world) {
  const DoubleTag d;
  const auto one = hn::Set(d, 1.0);
  const auto& columns = to_world.columns;
  const auto world = [&](double a, double b, double c) HWY_ATTR {
    return hn::Neg(
        hn::Add(hn::Add(hn::Mul(hn::Set(d, a), gradient[0]), hn::Mul(hn::Set(d, b), gradient[1])),
                hn::Mul(hn::Set(d, c), gradient[2])));
  };
  const auto gx = world(columns[0].x, columns[1].x, columns[2].x);
  const auto gy = world(columns[0].y, columns[1].y, columns[2].y);
  const auto gz = world(columns[0].z, columns[1].z, columns[2].z);
  const auto ax = hn::Abs(gx);
  const auto ay = hn::Abs(gy);
  const auto az = hn::Abs(gz);
  // Instead of Max, whose result for NaN differs between instruction sets.
  const auto axy = hn::IfThenElse(hn::Gt(ax, ay), ax, ay);
  const auto largest = hn::IfThenElse(hn::Gt(axy, az), axy, az);
  const auto scale = hn::Div(one, largest);
  const auto nx = hn::Mul(gx, scale);
  const auto ny = hn::Mul(gy, scale);
  const auto nz = hn::Mul(gz, scale);
  const auto square = hn::Add(hn::Add(hn::Mul(nx, nx), hn::Mul(ny, ny)), hn::Mul(nz, nz));
  // False for NaN.
  const auto usable = hn::And(hn::Ge(square, hn::Set(d, 0.5)), hn::Le(square, hn::Set(d, 4.0)));
  const auto inverse = hn::Div(one, hn::Sqrt(square));
  return {{hn::IfThenElseZero(usable, hn::Mul(nx, inverse)),
           hn::IfThenElseZero(usable, hn::Mul(ny, inverse)),
           hn::IfThenElseZero(usable, hn::Mul(nz, inverse))},
          largest,
          square,
          usable};
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace isoscope::extract
HWY_AFTER_NAMESPACE();

#endif  // ISOSCOPE_CORE_EXTRACT_GRADIENT_NORMAL_INL_H_
