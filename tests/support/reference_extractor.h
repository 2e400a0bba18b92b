// Marching cubes as plainly as it can be written, over a whole volume at once: what BlockExtractor
// is compared with. It shares the case table with it (which has tests of its own) and nothing else.

#ifndef ISOSCOPE_TESTS_SUPPORT_REFERENCE_EXTRACTOR_H_
#define ISOSCOPE_TESTS_SUPPORT_REFERENCE_EXTRACTOR_H_

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/base/coding.h"
#include "core/extract/case_table.h"
#include "core/math/vec.h"
#include "core/volume/grid_geometry.h"
#include "core/volume/scalar_type.h"

namespace isoscope::testing {

struct ReferenceVertex {
  math::Vec3f position;
  math::Vec3f normal;
};

struct ReferenceSurface {
  std::map<std::int64_t, ReferenceVertex> vertices;    // by edge key; those triangles use
  std::vector<std::array<std::int64_t, 3>> triangles;  // edge keys
  std::int64_t crossed_edge_count = 0;
};

class ReferenceExtractor {
 public:
  ReferenceExtractor(const volume::GridGeometry& geometry, volume::ScalarType type,
                     const std::string& bytes)
      : geometry_(geometry), dims_(geometry.sample_dims) {
    volume::VisitScalarType(type, [&]<typename T>() {
      for (std::size_t i = 0; i < bytes.size(); i += sizeof(T)) {
        samples_.push_back(static_cast<double>(base::LoadLittleEndian<T>(bytes.data() + i)));
      }
    });
  }

  [[nodiscard]] ReferenceSurface Extract(double isovalue) const {
    ReferenceSurface surface;
    for (std::int64_t z = 0; z < dims_.z; ++z) {
      for (std::int64_t y = 0; y < dims_.y; ++y) {
        for (std::int64_t x = 0; x < dims_.x; ++x) {
          for (int axis = 0; axis < 3; ++axis) {
            math::Index3 upper{x, y, z};
            if (++upper[axis] == dims_[axis]) {
              continue;
            }
            const double a = At({x, y, z});
            const double b = At(upper);
            if (!std::isnan(a) && !std::isnan(b) && (a >= isovalue) != (b >= isovalue)) {
              ++surface.crossed_edge_count;
            }
          }
          AddCell({x, y, z}, isovalue, &surface);
        }
      }
    }
    return surface;
  }

 private:
  [[nodiscard]] double At(const math::Index3& p) const {
    return samples_[static_cast<std::size_t>(p.x + dims_.x * (p.y + dims_.y * p.z))];
  }

  void AddCell(const math::Index3& cell, double isovalue, ReferenceSurface* surface) const {
    if (cell.x + 1 == dims_.x || cell.y + 1 == dims_.y || cell.z + 1 == dims_.z) {
      return;
    }
    std::size_t cell_case = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const double value = At(Corner(cell, corner));
      if (std::isnan(value)) {
        return;
      }
      cell_case |= value >= isovalue ? std::size_t{1} << corner : 0;
    }
    const extract::CaseTable& table = extract::GetCaseTable();
    for (std::size_t i = 0; i < table.triangle_counts[cell_case]; ++i) {
      std::array<std::int64_t, 3> keys{};
      for (std::size_t k = 0; k < 3; ++k) {
        const int edge = table.edges[cell_case][3 * i + k];
        const math::Index3 lower = Corner(cell, extract::CornersOfEdge(edge).lower);
        const int axis = edge / 4;
        keys[k] = 3 * (lower.x + dims_.x * (lower.y + dims_.y * lower.z)) + axis;
        surface->vertices.try_emplace(keys[k], MakeVertex(lower, axis, isovalue));
      }
      surface->triangles.push_back(keys);
    }
  }

  static math::Index3 Corner(const math::Index3& cell, int corner) {
    return cell + math::Index3{corner & 1, corner >> 1 & 1, corner >> 2};
  }

  [[nodiscard]] ReferenceVertex MakeVertex(const math::Index3& lower, int axis,
                                           double isovalue) const {
    math::Index3 upper = lower;
    ++upper[axis];
    const double t = Fraction(At(lower), At(upper), isovalue);
    math::Vec3d position{static_cast<double>(lower.x), static_cast<double>(lower.y),
                         static_cast<double>(lower.z)};
    position[axis] += t;
    const math::Vec3d a = Gradient(lower);
    const math::Vec3d b = Gradient(upper);
    const math::Vec3d world = -(geometry_.world_gradient_from_index() * (a + (b - a) * t));
    const double largest =
        std::fmax(std::fabs(world.x), std::fmax(std::fabs(world.y), std::fabs(world.z)));
    ReferenceVertex vertex{{static_cast<float>(position.x), static_cast<float>(position.y),
                            static_cast<float>(position.z)},
                           {}};
    if (math::IsFinite(world) && largest > 0) {
      const math::Vec3d unit = math::Normalized(world * (1 / largest));
      vertex.normal = {static_cast<float>(unit.x), static_cast<float>(unit.y),
                       static_cast<float>(unit.z)};
    }
    return vertex;
  }

  static double Fraction(double a, double b, double isovalue) {
    if (std::isinf(a) || std::isinf(b)) {
      return std::isinf(a) && std::isinf(b) ? 0.5 : std::isinf(a) ? 1 : 0;
    }
    return std::isinf(b - a) ? (isovalue / 2 - a / 2) / (b / 2 - a / 2) : (isovalue - a) / (b - a);
  }

  [[nodiscard]] math::Vec3d Gradient(const math::Index3& p) const {
    math::Vec3d gradient;
    for (int axis = 0; axis < 3; ++axis) {
      math::Index3 lower = p;
      math::Index3 upper = p;
      double steps = 0;
      if (p[axis] > 0) {
        --lower[axis];
        if (std::isfinite(At(lower))) {
          ++steps;
        } else {
          lower = p;
        }
      }
      if (p[axis] + 1 < dims_[axis]) {
        ++upper[axis];
        if (std::isfinite(At(upper))) {
          ++steps;
        } else {
          upper = p;
        }
      }
      const bool is_known = steps > 0 && std::isfinite(At(lower)) && std::isfinite(At(upper));
      gradient[axis] = is_known ? (At(upper) - At(lower)) * 2 / steps : 0;
    }
    return gradient;
  }

  const volume::GridGeometry geometry_;
  const math::Index3 dims_;
  std::vector<double> samples_;
};

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_REFERENCE_EXTRACTOR_H_
