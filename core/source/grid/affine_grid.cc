#include "core/source/grid/affine_grid.h"

#include <cmath>
#include <cstddef>
#include <numbers>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/math/elementary.h"

namespace isoscope::source {
namespace {

constexpr double kMaxCosine = 3e-4;

math::Vec3d ColumnOf(const AffineRows& rows, std::size_t column) {
  return {rows[0][column], rows[1][column], rows[2][column]};
}

}  // namespace

std::optional<Shear> FindShear(const AffineRows& rows) {
  return FindShear(math::Mat3d{{ColumnOf(rows, 0), ColumnOf(rows, 1), ColumnOf(rows, 2)}});
}

std::optional<Shear> FindShear(const math::Mat3d& directions) {
  std::optional<Shear> worst;
  for (int a = 0; a < 2; ++a) {
    for (int b = a + 1; b < 3; ++b) {
      const math::Vec3d& u = directions.columns[static_cast<std::size_t>(a)];
      const math::Vec3d& v = directions.columns[static_cast<std::size_t>(b)];
      const double cosine = math::Dot(u, v) / (math::Length(u) * math::Length(v));
      if (std::abs(cosine) > kMaxCosine &&
          (!worst.has_value() || std::abs(cosine) > std::abs(worst->cosine))) {
        worst = Shear{.first_axis = a, .second_axis = b, .cosine = cosine};
      }
    }
  }
  return worst;
}

// Halves an interval instead of calling acos, whose bits differ between machines.
double DegreesOf(const Shear& shear) {
  double low = 0;
  double high = std::numbers::pi;
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2;
    (math::Cos(middle) > shear.cosine ? low : high) = middle;
  }
  return low * 180 / std::numbers::pi;
}

absl::Status ShearError(const Shear& shear, const std::string& path) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s: the transform of the header is sheared: axes %c and %c meet at %.4g degrees (cosine "
      "%.4g); expected right angles: resample the volume onto a straight grid, or give "
      "--ignore-shear, which takes the nearest right angles",
      path, "xyz"[shear.first_axis], "xyz"[shear.second_axis], DegreesOf(shear), shear.cosine));
}

absl::StatusOr<volume::GridGeometry> GridFromAffine(const math::Index3& dims,
                                                    const AffineRows& rows, PatientWorld world,
                                                    const std::string& path, GridFaults* faults) {
  for (const std::array<double, 4>& row : rows) {
    for (const double number : row) {
      if (!std::isfinite(number) && faults == nullptr) {
        return absl::InvalidArgumentError(absl::StrFormat(
            "%s: the transform of the header has %g in it: the file is damaged", path, number));
      }
    }
  }
  const double turn = world == PatientWorld::kRas ? -1 : 1;
  const auto turned = [turn](const math::Vec3d& v) {
    return math::Vec3d{turn * v.x, turn * v.y, v.z};
  };
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const math::Vec3d column = turned(ColumnOf(rows, axis));
    const double length = math::Length(column);
    geometry.spacing[static_cast<int>(axis)] = length;
    if (length > 0) {
      geometry.direction.columns[axis] = column * (1 / length);
    } else if (faults != nullptr) {
      geometry.direction.columns[axis] = {0, 0, 0};
    }
  }
  geometry.origin = turned(ColumnOf(rows, 3));
  if (faults != nullptr) {
    ReplaceFaults(path, &geometry, faults);
  }
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  return geometry;
}

}  // namespace isoscope::source
