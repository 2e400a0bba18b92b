// The values of one field at the vertices of another field's surface, for its colour.

#ifndef ISOSCOPE_CORE_EXTRACT_FIELD_VALUES_H_
#define ISOSCOPE_CORE_EXTRACT_FIELD_VALUES_H_

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "core/volume/block_samples.h"
#include "core/volume/scalar_type.h"

namespace isoscope::extract {

// Returns true if floats do not hold all samples of the type: then values are doubles.
inline bool HasWideValues(volume::ScalarType type) {
  return volume::SizeOf(type) >= 4 && type != volume::ScalarType::kFloat32;
}

// Returns the value at t, in [0, 1], between two samples: a + t (b - a). NaN if a or b is NaN.
// Where b - a is not finite: a at t = 0, b at t = 1, else (1 - t) a + t b, which is NaN between
// infinities of both signs.
inline double ValueBetween(double a, double b, double t) {
  const double difference = b - a;
  if (std::isfinite(difference)) {
    return a + t * difference;
  }
  if (std::isnan(a) || std::isnan(b)) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  if (t == 0) {
    return a;
  }
  return t == 1 ? b : (1 - t) * a + t * b;
}

// Vertices on grid edges of one axis, and where on them.
struct VerticesOnEdges {
  std::size_t count = 0;
  const std::uint32_t* lower_samples = nullptr;  // the lower end of each edge, in the block
  std::size_t upper_distance = 0;                // from it to the upper end, in samples
  // By vertex: t = numerator / denominator, in [0, 1].
  const double* numerators = nullptr;
  const double* denominators = nullptr;
};

// Writes the field's value at each vertex, rounded once if floats are asked for.
void FillFieldValues(const volume::BlockSamples& field, const VerticesOnEdges& vertices, float* to);
void FillFieldValues(const volume::BlockSamples& field, const VerticesOnEdges& vertices,
                     double* to);

}  // namespace isoscope::extract

#endif  // ISOSCOPE_CORE_EXTRACT_FIELD_VALUES_H_
