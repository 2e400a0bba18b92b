#include "core/extract/field_values.h"

#include "core/base/coding.h"

namespace isoscope::extract {
namespace {

template <typename Value>
void Fill(const volume::BlockSamples& field, const VerticesOnEdges& vertices, Value* to) {
  volume::VisitScalarType(field.type, [&]<typename T>() {
    const auto at = [&](std::size_t sample) {
      return static_cast<double>(base::LoadLittleEndian<T>(field.bytes + sample * sizeof(T)));
    };
    for (std::size_t i = 0; i < vertices.count; ++i) {
      const std::size_t lower = vertices.lower_samples[i];
      const double t = vertices.numerators[i] / vertices.denominators[i];
      to[i] = static_cast<Value>(ValueBetween(at(lower), at(lower + vertices.upper_distance), t));
    }
  });
}

}  // namespace

void FillFieldValues(const volume::BlockSamples& field, const VerticesOnEdges& vertices,
                     float* to) {
  Fill(field, vertices, to);
}

void FillFieldValues(const volume::BlockSamples& field, const VerticesOnEdges& vertices,
                     double* to) {
  Fill(field, vertices, to);
}

}  // namespace isoscope::extract
