#include "core/volume/grid_geometry.h"

#include <cmath>
#include <cstdint>
#include <limits>

#include "absl/strings/str_format.h"

namespace isoscope::volume {
namespace {

// The most samples on an axis. Positions are 32-bit floats in samples: up to here every sample has
// a float of its own, so that a vertex never leaves its cell.
constexpr std::int64_t kMaxAxisSamples = std::int64_t{1} << 24;
// The least and the largest distance between samples, in world units, and the largest coordinate of
// a corner of the volume. World positions, and the values computed from them for a pixel, are
// 32-bit floats. These limits keep all of them far from underflow and overflow.
constexpr double kMinSampleDistance = 1e-24;
constexpr double kMaxSampleDistance = 1e24;
constexpr double kMaxCoordinate = 1e30;

math::Mat3d LinearPart(const GridGeometry& geometry) {
  return {{geometry.direction.columns[0] * geometry.spacing.x,
           geometry.direction.columns[1] * geometry.spacing.y,
           geometry.direction.columns[2] * geometry.spacing.z}};
}

// Whether the world positions of samples are far from underflow and overflow of 32-bit floats.
absl::Status CheckFloats(const GridGeometry& geometry) {
  for (int axis = 0; axis < 3; ++axis) {
    const double distance =
        geometry.spacing[axis] *
        math::Length(geometry.direction.columns[static_cast<std::size_t>(axis)]);
    if (!(distance >= kMinSampleDistance && distance <= kMaxSampleDistance)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "spacing %g, %g, %g: samples along axis %d are %g world units apart; %g to %g are "
          "possible, because world positions are 32-bit floats; choose another unit",
          geometry.spacing.x, geometry.spacing.y, geometry.spacing.z, axis, distance,
          kMinSampleDistance, kMaxSampleDistance));
    }
  }
  const math::Box3d bounds = geometry.Bounds();
  for (const math::Vec3d& corner : {bounds.min, bounds.max}) {
    for (int axis = 0; axis < 3; ++axis) {
      if (!(std::abs(corner[axis]) <= kMaxCoordinate)) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "origin %g, %g, %g: the volume reaches to %g world units; at most %g are possible, "
            "because world positions are 32-bit floats; choose another unit or origin",
            geometry.origin.x, geometry.origin.y, geometry.origin.z, corner[axis], kMaxCoordinate));
      }
    }
  }
  return absl::OkStatus();
}

}  // namespace

math::Mat4d GridGeometry::world_from_index() const {
  return math::MakeAffine(LinearPart(*this), origin);
}

math::Mat4d GridGeometry::index_from_world() const {
  const math::Mat3d inverse = math::Inverted(LinearPart(*this));
  return math::MakeAffine(inverse, -(inverse * origin));
}

math::Mat3d GridGeometry::world_gradient_from_index() const {
  return math::Transposed(math::Inverted(LinearPart(*this)));
}

math::Box3d GridGeometry::Bounds() const {
  math::Box3d index_box;
  index_box.Add({0, 0, 0});
  index_box.Add({static_cast<double>(sample_dims.x - 1), static_cast<double>(sample_dims.y - 1),
                 static_cast<double>(sample_dims.z - 1)});
  const math::Mat4d to_world = world_from_index();
  math::Box3d bounds;
  for (const math::Vec3d& corner : index_box.Corners()) {
    bounds.Add(math::TransformPoint(to_world, corner));
  }
  return bounds;
}

absl::Status Validate(const GridGeometry& geometry) {
  const math::Index3& dims = geometry.sample_dims;
  if (dims.x < 2 || dims.y < 2 || dims.z < 2) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "volume of %d x %d x %d samples: an isosurface needs at least 2 on each axis", dims.x,
        dims.y, dims.z));
  }
  if (dims.x > kMaxAxisSamples || dims.y > kMaxAxisSamples || dims.z > kMaxAxisSamples) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "volume of %d x %d x %d samples: each axis must have at most 2^24 (%d), because positions "
        "are 32-bit floats; cut the volume into parts",
        dims.x, dims.y, dims.z, kMaxAxisSamples));
  }
  constexpr std::int64_t kMaxSamples = std::int64_t{1} << 62;
  if (dims.x > kMaxSamples / dims.y / dims.z) {
    return absl::InvalidArgumentError(
        absl::StrFormat("volume of %d x %d x %d samples: more than 2^62", dims.x, dims.y, dims.z));
  }
  const math::Vec3d& spacing = geometry.spacing;
  if (!math::IsFinite(spacing) || !(spacing.x > 0 && spacing.y > 0 && spacing.z > 0)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("spacing %g, %g, %g: each must be finite and greater than 0", spacing.x,
                        spacing.y, spacing.z));
  }
  if (!math::IsFinite(geometry.origin)) {
    return absl::InvalidArgumentError(absl::StrFormat("origin %g, %g, %g: each must be finite",
                                                      geometry.origin.x, geometry.origin.y,
                                                      geometry.origin.z));
  }
  const double determinant = math::Determinant(geometry.direction);
  if (!std::isfinite(determinant) || std::abs(determinant) < 1e-6) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "direction matrix with determinant %g: its columns must be independent", determinant));
  }
  return CheckFloats(geometry);
}

}  // namespace isoscope::volume
