// The numbers of chunked arrays: their types and names in Zarr 2 and 3, and single values of JSON.

#ifndef ISOSCOPE_CORE_SOURCE_CHUNKS_NUMBER_TYPE_H_
#define ISOSCOPE_CORE_SOURCE_CHUNKS_NUMBER_TYPE_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include <nlohmann/json_fwd.hpp>

#include "core/base/check.h"
#include "core/source/adapt/wide_source.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// kBool is a byte, 0 or 1. kFloat16 is kept as its bits: only CarrierType makes floats of it.
enum class NumberType : std::uint8_t {
  kBool,
  kUint8,
  kInt8,
  kUint16,
  kInt16,
  kUint32,
  kInt32,
  kUint64,
  kInt64,
  kFloat16,
  kFloat32,
  kFloat64,
};

std::size_t SizeOf(NumberType type);
// "bool", "uint8", ..., "float64": the names of Zarr 3.
absl::string_view NameOf(NumberType type);
std::optional<NumberType> NumberTypeFromName(absl::string_view name);

// A type as NumPy and Zarr 2 write it: "<u2", ">f4", "|b1".
struct StoredNumber {
  NumberType type = NumberType::kUint8;
  bool is_big_endian = false;
};
// INVALID_ARGUMENT: no number, or one of another size (complex, text, records, dates); names it. It
// takes names of Zarr 3, too. The message is to follow a name and a colon.
absl::StatusOr<StoredNumber> ParseNumpyType(absl::string_view text);

// The type of a volume's samples: that of the stored bits, and what they mean if no volume has it.
struct SampleType {
  volume::ScalarType stored = volume::ScalarType::kUint8;
  std::optional<WideType> wide{};
};
SampleType SampleTypeOf(NumberType type);

// The bytes of one value, little-endian. `value` is a number, a bool, or of a float also "NaN",
// "Infinity", "-Infinity" or its bits: "0x7fc00000". INVALID_ARGUMENT: none of these, or no value
// of the type; the message is to follow a name and a colon.
absl::StatusOr<std::string> NumberBytes(const nlohmann::json& value, NumberType type);

// Calls visitor.operator()<T>() with the C++ type of the bits: std::uint8_t for kBool,
// std::uint16_t for kFloat16.
template <typename Visitor>
decltype(auto) VisitNumberType(NumberType type, Visitor&& visitor) {
  switch (type) {
    case NumberType::kBool:
    case NumberType::kUint8:
      return std::forward<Visitor>(visitor).template operator()<std::uint8_t>();
    case NumberType::kInt8:
      return std::forward<Visitor>(visitor).template operator()<std::int8_t>();
    case NumberType::kUint16:
    case NumberType::kFloat16:
      return std::forward<Visitor>(visitor).template operator()<std::uint16_t>();
    case NumberType::kInt16:
      return std::forward<Visitor>(visitor).template operator()<std::int16_t>();
    case NumberType::kUint32:
      return std::forward<Visitor>(visitor).template operator()<std::uint32_t>();
    case NumberType::kInt32:
      return std::forward<Visitor>(visitor).template operator()<std::int32_t>();
    case NumberType::kUint64:
      return std::forward<Visitor>(visitor).template operator()<std::uint64_t>();
    case NumberType::kInt64:
      return std::forward<Visitor>(visitor).template operator()<std::int64_t>();
    case NumberType::kFloat32:
      return std::forward<Visitor>(visitor).template operator()<float>();
    case NumberType::kFloat64:
      return std::forward<Visitor>(visitor).template operator()<double>();
  }
  base::CheckFailed(__FILE__, __LINE__, "number type out of range");
}

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHUNKS_NUMBER_TYPE_H_
