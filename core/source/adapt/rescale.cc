#include "core/source/adapt/rescale.h"

#include "core/base/coding.h"

namespace isoscope::source {
namespace {

template <typename Out, typename In>
void RescaleAs(std::size_t count, double slope, double intercept, const char* in, char* out) {
  for (std::size_t i = 0; i < count; ++i) {
    const auto stored = static_cast<double>(base::LoadLittleEndian<In>(in + i * sizeof(In)));
    base::StoreLittleEndian(static_cast<Out>(stored * slope + intercept), out + i * sizeof(Out));
  }
}

}  // namespace

volume::ScalarType RescaledType(volume::ScalarType stored) {
  switch (stored) {
    case volume::ScalarType::kUint32:
    case volume::ScalarType::kInt32:
    case volume::ScalarType::kFloat64:
      return volume::ScalarType::kFloat64;
    default:
      return volume::ScalarType::kFloat32;
  }
}

void Rescale(volume::ScalarType stored, std::size_t count, double slope, double intercept,
             const char* in, char* out) {
  volume::VisitScalarType(stored, [&]<typename In>() {
    if (RescaledType(stored) == volume::ScalarType::kFloat32) {
      RescaleAs<float, In>(count, slope, intercept, in, out);
    } else {
      RescaleAs<double, In>(count, slope, intercept, in, out);
    }
  });
}

}  // namespace isoscope::source
