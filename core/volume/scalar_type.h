// The sample types of a volume, and VisitScalarType, which turns a run-time type into a C++ type.

#ifndef ISOSCOPE_CORE_VOLUME_SCALAR_TYPE_H_
#define ISOSCOPE_CORE_VOLUME_SCALAR_TYPE_H_

#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/check.h"

namespace isoscope::volume {

// On disk (docs/format/dataset.md, shard.md): never change the values.
enum class ScalarType : std::uint8_t {
  kUint8 = 1,
  kInt8 = 2,
  kUint16 = 3,
  kInt16 = 4,
  kUint32 = 5,
  kInt32 = 6,
  kFloat32 = 7,
  kFloat64 = 8,
};

std::size_t SizeOf(ScalarType type);
// Returns "uint8", "int8", ..., "float64": the names of the command line and of manifests.
absl::string_view NameOf(ScalarType type);
// Returns the type of that name. INVALID_ARGUMENT, listing the names, if there is none.
absl::StatusOr<ScalarType> ScalarTypeFromName(absl::string_view name);

// Calls visitor.template operator()<T>() with the C++ type T of `type` and returns its result:
//   VisitScalarType(type, [&]<typename T>() { ... });
template <typename Visitor>
decltype(auto) VisitScalarType(ScalarType type, Visitor&& visitor) {
  switch (type) {
    case ScalarType::kUint8:
      return std::forward<Visitor>(visitor).template operator()<std::uint8_t>();
    case ScalarType::kInt8:
      return std::forward<Visitor>(visitor).template operator()<std::int8_t>();
    case ScalarType::kUint16:
      return std::forward<Visitor>(visitor).template operator()<std::uint16_t>();
    case ScalarType::kInt16:
      return std::forward<Visitor>(visitor).template operator()<std::int16_t>();
    case ScalarType::kUint32:
      return std::forward<Visitor>(visitor).template operator()<std::uint32_t>();
    case ScalarType::kInt32:
      return std::forward<Visitor>(visitor).template operator()<std::int32_t>();
    case ScalarType::kFloat32:
      return std::forward<Visitor>(visitor).template operator()<float>();
    case ScalarType::kFloat64:
      return std::forward<Visitor>(visitor).template operator()<double>();
  }
  base::CheckFailed(__FILE__, __LINE__, "scalar type out of range");
}

}  // namespace isoscope::volume

#endif  // ISOSCOPE_CORE_VOLUME_SCALAR_TYPE_H_
