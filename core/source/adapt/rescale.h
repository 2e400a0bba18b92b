// Stored samples that a header scales.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_RESCALE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_RESCALE_H_

#include <cstddef>

#include "core/volume/scalar_type.h"

namespace isoscope::source {

struct Rescaling {
  double slope = 1;
  double intercept = 0;

  friend bool operator==(const Rescaling&, const Rescaling&) = default;
};

// float32 if it holds every stored value, as in ITK; else float64, where ITK would round.
volume::ScalarType RescaledType(volume::ScalarType stored);

// Writes slope * stored + intercept, computed in double, as RescaledType(stored). Both
// little-endian; `in` may be the tail of `out`: every sample is read before it is overwritten.
void Rescale(volume::ScalarType stored, std::size_t count, double slope, double intercept,
             const char* in, char* out);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_RESCALE_H_
