// Sample types that a file may have and a dataset has not: 64-bit integers, and floats of 16 bits.

#ifndef ISOSCOPE_CORE_SOURCE_ADAPT_WIDE_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_ADAPT_WIDE_SOURCE_H_

#include <memory>
#include <optional>

#include "absl/strings/string_view.h"

#include "core/source/volume_source.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// int64 and uint64 become float64 where that is exact, float16 becomes float32.
enum class WideType { kInt64, kUint64, kFloat16 };

// "int64", "uint64", "float16"; not set for any other name.
std::optional<WideType> WideTypeFromName(absl::string_view name);
// The sample type that a reader gives the stored bits, whose size it has: float64, float64, uint16.
volume::ScalarType CarrierType(WideType type);

// Serves the values of the samples whose bits `stored` reads as CarrierType(type). All else is as
// in `stored`. ReadRows also: INVALID_ARGUMENT for an integer beyond 2^53 on either side, with its
// value and its index (x, y, z). Holds nothing of its own.
std::unique_ptr<VolumeSource> MakeWideSource(std::unique_ptr<VolumeSource> stored, WideType type);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_ADAPT_WIDE_SOURCE_H_
