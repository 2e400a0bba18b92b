// What reading boxes of a source costs.

#ifndef ISOSCOPE_CORE_SOURCE_BOX_DECODING_H_
#define ISOSCOPE_CORE_SOURCE_BOX_DECODING_H_

#include <cstdint>

#include "core/source/volume_source.h"

namespace isoscope::source {

// A source whose boxes have other samples among theirs: those of other channels or steps. A source that
// is made of others hands the factor on.
class BoxDecoding {
 public:
  virtual ~BoxDecoding() = default;

  // VolumeSource::ReadBox of n bytes of samples takes the memory of decoding so many times n; at least 1.
  [[nodiscard]] virtual std::int64_t decoding_factor() const = 0;
};

// Returns the factor of a source; 1 if it is no BoxDecoding.
inline std::int64_t DecodingFactorOf(const VolumeSource& source) {
  const auto* const decoding = dynamic_cast<const BoxDecoding*>(&source);
  return decoding == nullptr ? 1 : decoding->decoding_factor();
}

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BOX_DECODING_H_
