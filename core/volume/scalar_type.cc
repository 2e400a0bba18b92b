#include "core/volume/scalar_type.h"

#include <array>

#include "absl/strings/str_cat.h"

namespace isoscope::volume {
namespace {

struct Row {
  ScalarType type;
  absl::string_view name;
};

constexpr std::array<Row, 8> kRows{{{ScalarType::kUint8, "uint8"},
                                    {ScalarType::kInt8, "int8"},
                                    {ScalarType::kUint16, "uint16"},
                                    {ScalarType::kInt16, "int16"},
                                    {ScalarType::kUint32, "uint32"},
                                    {ScalarType::kInt32, "int32"},
                                    {ScalarType::kFloat32, "float32"},
                                    {ScalarType::kFloat64, "float64"}}};

}  // namespace

std::size_t SizeOf(ScalarType type) {
  return VisitScalarType(type, []<typename T>() { return sizeof(T); });
}

absl::string_view NameOf(ScalarType type) {
  for (const Row& row : kRows) {
    if (row.type == type) {
      return row.name;
    }
  }
  base::CheckFailed(__FILE__, __LINE__, "scalar type out of range");
}

absl::StatusOr<ScalarType> ScalarTypeFromName(absl::string_view name) {
  for (const Row& row : kRows) {
    if (row.name == name) {
      return row.type;
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat("sample type \"", name,
                   "\": expected uint8, int8, uint16, int16, uint32, int32, float32 or float64"));
}

}  // namespace isoscope::volume
