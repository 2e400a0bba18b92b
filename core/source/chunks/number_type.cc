#include "core/source/chunks/number_type.h"

#include <array>
#include <cmath>
#include <limits>
#include <type_traits>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "core/base/coding.h"
#include "core/base/printable.h"

namespace isoscope::source {
namespace {

struct NamedNumber {
  absl::string_view name;
  absl::string_view numpy;  // without the byte order
  NumberType type;
};

constexpr std::array<NamedNumber, 12> kNumbers = {{
    {"bool", "b1", NumberType::kBool},
    {"uint8", "u1", NumberType::kUint8},
    {"int8", "i1", NumberType::kInt8},
    {"uint16", "u2", NumberType::kUint16},
    {"int16", "i2", NumberType::kInt16},
    {"uint32", "u4", NumberType::kUint32},
    {"int32", "i4", NumberType::kInt32},
    {"uint64", "u8", NumberType::kUint64},
    {"int64", "i8", NumberType::kInt64},
    {"float16", "f2", NumberType::kFloat16},
    {"float32", "f4", NumberType::kFloat32},
    {"float64", "f8", NumberType::kFloat64},
}};

// What JSON may have for a value of the type.
std::string ValuesOf(NumberType type) {
  if (type == NumberType::kBool) {
    return "true or false";
  }
  return VisitNumberType(type, [&]<typename T>() -> std::string {
    if (std::is_floating_point_v<T> || type == NumberType::kFloat16) {
      return absl::StrFormat(
          R"(a number, "NaN", "Infinity", "-Infinity", or its bits: "0x" and %d digits)",
          2 * sizeof(T));
    }
    return absl::StrCat("an integer from ", +std::numeric_limits<T>::lowest(), " to ",
                        +std::numeric_limits<T>::max());
  });
}

absl::Status NoValueOf(const nlohmann::json& value, NumberType type) {
  constexpr std::size_t kMaxShown = 60;
  return absl::InvalidArgumentError(absl::StrFormat(
      "%s is no %s; expected %s",
      base::Printable(
          value.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace).substr(0, kMaxShown)),
      NameOf(type), ValuesOf(type)));
}

template <typename T>
std::string BytesOf(T value) {
  std::string bytes;
  base::AppendLittleEndian(value, &bytes);
  return bytes;
}

// An integer, or a float that is one.
template <typename T>
std::optional<T> IntegerFrom(const nlohmann::json& value) {
  if (value.is_boolean()) {
    return static_cast<T>(value.get<bool>() ? 1 : 0);
  }
  if (value.is_number_unsigned()) {
    const auto number = value.get<std::uint64_t>();
    return number <= static_cast<std::uint64_t>(std::numeric_limits<T>::max())
               ? std::optional(static_cast<T>(number))
               : std::nullopt;
  }
  if (value.is_number_integer()) {
    const auto number = value.get<std::int64_t>();
    return std::in_range<T>(number) ? std::optional(static_cast<T>(number)) : std::nullopt;
  }
  if (value.is_number_float()) {
    const auto number = value.get<double>();
    constexpr double kMaxExact = 0x1p53;
    const bool fits = std::abs(number) <= kMaxExact && number == std::floor(number) &&
                      number >= static_cast<double>(std::numeric_limits<T>::lowest()) &&
                      number <= static_cast<double>(std::numeric_limits<T>::max());
    return fits ? std::optional(static_cast<T>(number)) : std::nullopt;
  }
  return std::nullopt;
}

// The bits of a float in hexadecimal.
std::optional<std::uint64_t> HexBits(absl::string_view text, std::size_t size) {
  std::uint64_t bits = 0;
  if (!absl::StartsWith(text, "0x") || text.size() != 2 + 2 * size ||
      !absl::SimpleHexAtoi(text, &bits)) {
    return std::nullopt;
  }
  return bits;
}

// The nearest float of 16 bits; ties to even.
std::uint16_t HalfBits(double value) {
  const std::uint16_t sign = std::signbit(value) ? 0x8000 : 0;
  const double magnitude = std::abs(value);
  if (std::isnan(value)) {
    return static_cast<std::uint16_t>(sign | 0x7e00);
  }
  if (magnitude >= 65520) {  // half a unit above the largest
    return static_cast<std::uint16_t>(sign | 0x7c00);
  }
  if (magnitude < 0x1p-14) {
    return static_cast<std::uint16_t>(
        sign | static_cast<std::uint16_t>(std::nearbyint(std::ldexp(magnitude, 24))));
  }
  int exponent = 0;
  std::frexp(magnitude, &exponent);  // magnitude in [2^(exponent - 1), 2^exponent)
  const auto fraction =
      static_cast<std::uint32_t>(std::nearbyint(std::ldexp(magnitude, 11 - exponent)));  // 2^10 on
  return static_cast<std::uint16_t>(sign + (static_cast<std::uint32_t>(exponent + 13) << 10) +
                                    fraction);
}

}  // namespace

std::size_t SizeOf(NumberType type) {
  return VisitNumberType(type, []<typename T>() { return sizeof(T); });
}

absl::string_view NameOf(NumberType type) { return kNumbers[static_cast<std::size_t>(type)].name; }

std::optional<NumberType> NumberTypeFromName(absl::string_view name) {
  for (const NamedNumber& number : kNumbers) {
    if (number.name == name) {
      return number.type;
    }
  }
  return std::nullopt;
}

absl::StatusOr<StoredNumber> ParseNumpyType(absl::string_view text) {
  if (const auto named = NumberTypeFromName(text); named.has_value()) {
    return StoredNumber{.type = *named};
  }
  const bool has_order = !text.empty() && absl::StrContains("<>|=", text.substr(0, 1));
  for (const NamedNumber& number : kNumbers) {
    if (text.substr(has_order ? 1 : 0) == number.numpy) {
      return StoredNumber{.type = number.type, .is_big_endian = text[0] == '>'};
    }
  }
  constexpr std::size_t kMaxShown = 60;
  return absl::InvalidArgumentError(absl::StrFormat(
      "type \"%s\"; expected bool, integers of 8 to 64 bits or floats of 16 to 64 bits",
      base::Printable(text.substr(0, kMaxShown))));
}

SampleType SampleTypeOf(NumberType type) {
  switch (type) {
    case NumberType::kBool:
    case NumberType::kUint8:
      return {.stored = volume::ScalarType::kUint8};
    case NumberType::kInt8:
      return {.stored = volume::ScalarType::kInt8};
    case NumberType::kUint16:
      return {.stored = volume::ScalarType::kUint16};
    case NumberType::kInt16:
      return {.stored = volume::ScalarType::kInt16};
    case NumberType::kUint32:
      return {.stored = volume::ScalarType::kUint32};
    case NumberType::kInt32:
      return {.stored = volume::ScalarType::kInt32};
    case NumberType::kUint64:
      return {.stored = CarrierType(WideType::kUint64), .wide = WideType::kUint64};
    case NumberType::kInt64:
      return {.stored = CarrierType(WideType::kInt64), .wide = WideType::kInt64};
    case NumberType::kFloat16:
      return {.stored = CarrierType(WideType::kFloat16), .wide = WideType::kFloat16};
    case NumberType::kFloat32:
      return {.stored = volume::ScalarType::kFloat32};
    case NumberType::kFloat64:
      return {.stored = volume::ScalarType::kFloat64};
  }
  base::CheckFailed(__FILE__, __LINE__, "number type out of range");
}

absl::StatusOr<std::string> NumberBytes(const nlohmann::json& value, NumberType type) {
  const bool is_float =
      type == NumberType::kFloat16 || type == NumberType::kFloat32 || type == NumberType::kFloat64;
  if (!is_float) {
    return VisitNumberType(type, [&]<typename T>() -> absl::StatusOr<std::string> {
      if constexpr (std::is_integral_v<T>) {
        const std::optional<T> number = IntegerFrom<T>(value);
        if (number.has_value() && (type != NumberType::kBool || *number <= 1)) {
          return BytesOf(*number);
        }
      }
      return NoValueOf(value, type);
    });
  }
  double number = 0;
  if (value.is_string()) {
    const std::string& text = value.get_ref<const std::string&>();
    if (const auto bits = HexBits(text, SizeOf(type)); bits.has_value()) {
      return BytesOf(*bits).substr(0, SizeOf(type));
    }
    if (text == "NaN") {
      number = std::numeric_limits<double>::quiet_NaN();
    } else if (text == "Infinity" || text == "-Infinity") {
      number = (text[0] == '-' ? -1 : 1) * std::numeric_limits<double>::infinity();
    } else {
      return NoValueOf(value, type);
    }
  } else if (value.is_number() || value.is_boolean()) {
    number = value.is_boolean() ? static_cast<double>(value.get<bool>()) : value.get<double>();
  } else {
    return NoValueOf(value, type);
  }
  if (type == NumberType::kFloat64) {
    return BytesOf(number);
  }
  return type == NumberType::kFloat32 ? BytesOf(static_cast<float>(number))
                                      : BytesOf(HalfBits(number));
}

}  // namespace isoscope::source
