#include "core/volume/grid_geometry.h"

#include <cmath>
#include <limits>

#include "absl/strings/str_format.h"

namespace isoscope::volume {
namespace {

math::Mat3d LinearPart(const GridGeometry& geometry) {
  return {{geometry.direction.columns[0] * geometry.spacing.x,
           geometry.direction.columns[1] * geometry.spacing.y,
           geometry.direction.columns[2] * geometry.spacing.z}};
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
  return absl::OkStatus();
}

}  // namespace isoscope::volume
