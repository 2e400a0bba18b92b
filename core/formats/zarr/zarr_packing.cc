#include "core/formats/zarr/zarr_packing.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

bool IsFloatNumber(NumberType type) {
  return type == NumberType::kFloat16 || type == NumberType::kFloat32 ||
         type == NumberType::kFloat64;
}

// The stored value of a number's bytes; not set for float16.
std::optional<double> ValueOfNumber(NumberType type, const std::string& bytes) {
  if (type == NumberType::kFloat16) {
    return std::nullopt;
  }
  return VisitNumberType(type, [&]<typename T>() {
    return static_cast<double>(base::LoadLittleEndian<T>(bytes.data()));
  });
}

// xarray writes numbers of Zarr 3 as their bytes in base64.
std::vector<double> MissingIn(const ZarrArray& array, const char* name) {
  const ZarrJson* const value = MemberOf(array.attributes, name);
  std::string bytes;
  if (value != nullptr && value->is_string() && !NumberOf(*value).has_value() &&
      absl::Base64Unescape(value->get<std::string>(), &bytes)) {
    if (bytes.size() == sizeof(double)) {  // whatever the type
      return {base::LoadLittleEndian<double>(bytes.data())};
    }
    const auto number =
        bytes.size() == SizeOf(array.type) ? ValueOfNumber(array.type, bytes) : std::nullopt;
    return number.has_value() ? std::vector<double>{*number} : std::vector<double>();
  }
  return NumbersOf(array.attributes, name);
}

absl::StatusOr<std::optional<double>> OneNumber(const ZarrArray& array, const char* name) {
  const ZarrJson* const value = MemberOf(array.attributes, name);
  if (value == nullptr) {
    return std::nullopt;
  }
  const std::vector<double> numbers = NumbersOf(array.attributes, name);
  if (numbers.size() != 1 || !std::isfinite(numbers[0])) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "its attribute %s is %s; expected a finite number: correct it, or remove it", name,
        ShownJson(*value)));
  }
  return numbers[0];
}

}  // namespace

absl::StatusOr<ZarrPacking> ZarrPackingOf(const ZarrArray& array) {
  ZarrPacking packing;
  ISOSCOPE_ASSIGN_OR_RETURN(const auto scale, OneNumber(array, "scale_factor"));
  ISOSCOPE_ASSIGN_OR_RETURN(const auto offset, OneNumber(array, "add_offset"));
  packing.slope = scale.value_or(1);
  packing.intercept = offset.value_or(0);
  if (packing.slope == 0) {
    return absl::InvalidArgumentError(
        "its attribute scale_factor is 0; expected another number: correct it, or remove it");
  }
  packing.missing = MissingIn(array, "_FillValue");
  const std::vector<double> others = MissingIn(array, "missing_value");
  packing.missing.insert(packing.missing.end(), others.begin(), others.end());
  const bool is_scaled = scale.has_value() || offset.has_value();
  const auto fill = ValueOfNumber(array.type, array.fill);
  if (array.has_fill && !array.dimension_names.empty() && fill.has_value() &&
      packing.missing.empty() && (is_scaled || (IsFloatNumber(array.type) && *fill != 0))) {
    packing.missing.push_back(*fill);
  }
  packing.missing.erase(std::remove_if(packing.missing.begin(), packing.missing.end(),
                                       [](double number) { return std::isnan(number); }),
                        packing.missing.end());
  ISOSCOPE_ASSIGN_OR_RETURN(packing.valid_min, OneNumber(array, "valid_min"));
  ISOSCOPE_ASSIGN_OR_RETURN(packing.valid_max, OneNumber(array, "valid_max"));
  if (const std::vector<double> range = NumbersOf(array.attributes, "valid_range");
      range.size() == 2 && std::isfinite(range[0]) && std::isfinite(range[1])) {
    packing.valid_min = range[0];
    packing.valid_max = range[1];
  }
  if (packing.valid_min.value_or(0) > packing.valid_max.value_or(packing.valid_min.value_or(0))) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "no sample is valid from %g to %g: correct valid_range, valid_min and valid_max, or remove "
        "them",
        *packing.valid_min, *packing.valid_max));
  }
  if (array.type == NumberType::kFloat16 && !packing.is_plain()) {
    return absl::InvalidArgumentError(
        "its attributes scale float16 or call values of it missing; expected another type");
  }
  return packing;
}

volume::ScalarType UnpackedType(NumberType stored) {
  switch (stored) {
    case NumberType::kUint32:
    case NumberType::kInt32:
    case NumberType::kUint64:
    case NumberType::kInt64:
    case NumberType::kFloat64:
      return volume::ScalarType::kFloat64;
    default:
      return volume::ScalarType::kFloat32;
  }
}

void UnpackZarr(const ZarrPacking& packing, NumberType stored, std::size_t count, const char* in,
                char* out) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const double least = packing.valid_min.value_or(-kInfinity);
  const double most = packing.valid_max.value_or(kInfinity);
  const auto unpack = [&]<typename Out, typename In>() {
    for (std::size_t i = 0; i < count; ++i) {
      const auto value = static_cast<double>(base::LoadLittleEndian<In>(in + i * sizeof(In)));
      const bool is_missing = std::find(packing.missing.begin(), packing.missing.end(), value) !=
                                  packing.missing.end() ||
                              value < least || value > most;
      base::StoreLittleEndian(is_missing
                                  ? std::numeric_limits<Out>::quiet_NaN()
                                  : static_cast<Out>(value * packing.slope + packing.intercept),
                              out + i * sizeof(Out));
    }
  };
  VisitNumberType(stored, [&]<typename In>() {
    if (UnpackedType(stored) == volume::ScalarType::kFloat32) {
      unpack.template operator()<float, In>();
    } else {
      unpack.template operator()<double, In>();
    }
  });
}

}  // namespace isoscope::source
