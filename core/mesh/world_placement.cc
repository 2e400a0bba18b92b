#include "core/mesh/world_placement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "core/math/box.h"
#include "core/math/vec_conversion.h"

namespace isoscope::mesh {
namespace {

double LargestOf(const math::Vec3d& v) {
  return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

// Returns the largest multiple, at most `value`, of a power of ten that is at most `extent`, > 0.
double RoundedDown(double value, double extent) {
  constexpr double kMaxPower = 1e200;
  double power = 1;
  double divisor = 1;
  while (power * 10 <= extent && power < kMaxPower) {
    power *= 10;
  }
  while (extent * divisor < 1 && divisor < kMaxPower) {
    divisor *= 10;
  }
  return std::floor(value * divisor / power) * power / divisor + 0.0;  // no -0
}

// The longest way in index space of a step of 1 on each axis of the world.
double IndexDistanceOfStep(const volume::GridGeometry& geometry) {
  const math::Mat4d inverse = geometry.index_from_world();
  math::Vec3d sum;
  for (int axis = 0; axis < 3; ++axis) {
    math::Vec3d unit;
    unit[axis] = 1;
    const math::Vec3d column = math::TransformVector(inverse, unit);
    sum = sum + math::Vec3d{std::abs(column.x), std::abs(column.y), std::abs(column.z)};
  }
  return LargestOf(sum);
}

}  // namespace

double StepOfFloat32(double size) {
  constexpr int kFloatBits = 24;
  constexpr int kLowestExponent = -149;
  int exponent = 0;
  std::frexp(size, &exponent);
  return std::ldexp(1.0,
                    size > 0 ? std::max(exponent - kFloatBits, kLowestExponent) : kLowestExponent);
}

WorldPlacement::WorldPlacement(const volume::GridGeometry& geometry) {
  const math::Box3d bounds = geometry.Bounds();
  const double largest = std::max(LargestOf(bounds.min), LargestOf(bounds.max));
  double sample_distance = geometry.spacing.x * math::Length(geometry.direction.columns[0]);
  for (const std::size_t axis : {std::size_t{1}, std::size_t{2}}) {
    sample_distance = std::min(sample_distance, geometry.spacing[static_cast<int>(axis)] *
                                                    math::Length(geometry.direction.columns[axis]));
  }
  const math::Index3& dims = geometry.sample_dims;
  const double index_step =
      StepOfFloat32(static_cast<double>(std::max({dims.x, dims.y, dims.z}) - 1));
  has_origin_ = StepOfFloat32(largest) > std::max(kLargestStep, 4 * index_step) * sample_distance;
  if (has_origin_) {
    const double extent = LargestOf(bounds.max - bounds.min);
    for (int axis = 0; axis < 3; ++axis) {
      origin_[axis] = RoundedDown(bounds.min[axis], extent);
    }
  }
  volume::GridGeometry shifted = geometry;
  shifted.origin = geometry.origin - origin_;
  offset_from_index_ = shifted.world_from_index();

  const double largest_offset = has_origin_ ? LargestOf(bounds.max - origin_) : largest;
  // Two roundings of half a step each, and that of the sum in double.
  constexpr double kSlack = 1.01;
  constexpr double kLargestBlur = 0.125;
  constexpr double kDoubleEpsilon = 0x1.0p-52;
  const double blur = kSlack * IndexDistanceOfStep(geometry) *
                      (StepOfFloat32(largest_offset) + kDoubleEpsilon * largest);
  blur_ = blur < kLargestBlur ? blur : 0;
}

// Not inlined: where GCC 12 vectorises a conversion to float and back, it leaves the rounding out.
[[gnu::noinline]] math::Vec3f WorldPlacement::OffsetOf(const math::Vec3f& position) const {
  const math::Vec3d offset = math::TransformPoint(offset_from_index_, math::DoubleOf(position));
  return {static_cast<float>(offset.x), static_cast<float>(offset.y), static_cast<float>(offset.z)};
}

math::Vec3d WorldPlacement::PositionOf(const math::Vec3f& position) const {
  return origin_ + math::DoubleOf(OffsetOf(position));
}

[[gnu::noinline]] math::Vec3d WorldPlacement::PlaceOf(const math::Vec3f& position) const {
  return blur_ > 0 ? PositionOf(position) : math::DoubleOf(position);
}

}  // namespace isoscope::mesh
