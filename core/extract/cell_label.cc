#include "core/extract/cell_label.h"

#include <cmath>
#include <cstddef>
#include <limits>

#include "core/base/check.h"
#include "core/extract/case_table.h"

namespace isoscope::extract {

std::optional<double> LabelInCell(const std::array<double, 8>& samples, const math::Index3& cell,
                                  const math::Vec3d& position, const volume::InsideRule& rule) {
  ISOSCOPE_CHECK(rule.has_labels());
  std::array<bool, 8> inside{};
  for (std::size_t corner = 0; corner < 8; ++corner) {
    if (std::isnan(samples[corner])) {
      return std::nullopt;
    }
    inside[corner] = rule.IsInside(samples[corner]);
  }
  std::optional<double> label;
  double least = std::numeric_limits<double>::infinity();
  for (int edge = 0; edge < 12; ++edge) {
    const EdgeCorners corners = CornersOfEdge(edge);
    const auto lower = static_cast<std::size_t>(corners.lower);
    const auto upper = static_cast<std::size_t>(corners.upper);
    if (inside[lower] == inside[upper]) {
      continue;
    }
    double square = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const int doubled = (corners.lower >> axis & 1) + (corners.upper >> axis & 1);
      const double middle = static_cast<double>(cell[axis]) + 0.5 * doubled;
      square += (position[axis] - middle) * (position[axis] - middle);
    }
    if (square < least) {
      least = square;
      label = inside[lower] ? samples[lower] : samples[upper];
    }
  }
  return label;
}

}  // namespace isoscope::extract
