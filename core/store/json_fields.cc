// Typed access to members of a JSON object, in two layers:
//
//   ToInteger, ToDouble, ToCrc32c   one value: does it have the type, is it in range?
//   JsonFields                      one member: find it, convert it, remember the first error
//
// Every value is checked before the JSON library's accessors are called, which throw on another
// type; parsing reports errors without exceptions too. So nothing in a file can make this code
// throw.
//
// Example: {"seed": -1} read as an unsigned integer records "where: member "seed": expected an
// integer in [0, 2^64 - 1]" and leaves the target as it was.

#include "core/store/json_fields.h"

#include <cmath>
#include <limits>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include <nlohmann/json.hpp>

#include "core/base/check.h"
#include "core/base/status_macros.h"

namespace isoscope::store {
namespace {

bool ToInteger(const Json& json, std::int64_t min, std::int64_t max, std::int64_t* value) {
  if (!json.is_number_integer()) {
    return false;
  }
  // Non-negative literals are parsed as unsigned; get<int64_t> would wrap the large ones.
  if (json.is_number_unsigned() &&
      json.get<std::uint64_t>() >
          static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())) {
    return false;
  }
  const auto integer = json.get<std::int64_t>();
  if (integer < min || integer > max) {
    return false;
  }
  *value = integer;
  return true;
}

bool ToDouble(const Json& json, double* value) {
  if (json.is_number()) {
    *value = json.get<double>();
    return true;
  }
  if (json.is_string()) {
    const auto& text = json.get_ref<const std::string&>();
    if (text == "inf" || text == "-inf") {
      *value = text == "inf" ? std::numeric_limits<double>::infinity()
                             : -std::numeric_limits<double>::infinity();
      return true;
    }
  }
  return false;
}

bool ToCrc32c(const Json& json, std::uint32_t* value) {
  if (!json.is_string()) {
    return false;
  }
  const auto& text = json.get_ref<const std::string&>();
  std::uint32_t crc32c = 0;
  if (text.size() != 8 || text.find_first_not_of("0123456789abcdef") != std::string::npos ||
      !absl::SimpleHexAtoi(text, &crc32c)) {
    return false;
  }
  *value = crc32c;
  return true;
}

}  // namespace

Json JsonFromDouble(double value) {
  ISOSCOPE_CHECK(!std::isnan(value));
  if (std::isinf(value)) {
    return value > 0 ? "inf" : "-inf";
  }
  return value;
}

Json JsonFromCrc32c(std::uint32_t crc32c) { return absl::StrFormat("%08x", crc32c); }

std::string DumpJson(const Json& json) {
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

JsonFields::JsonFields(const Json& json, absl::string_view where) : json_(json), where_(where) {
  if (!json.is_object()) {
    status_ = absl::DataLossError(absl::StrCat(where, ": expected a JSON object"));
  }
}

void JsonFields::Fail(const absl::Status& status) { status_.Update(status); }

void JsonFields::Expected(const char* name, absl::string_view what) {
  Fail(absl::DataLossError(absl::StrCat(where_, ": member \"", name, "\": expected ", what)));
}

const Json* JsonFields::Find(const char* name) {
  if (!status_.ok()) {
    return nullptr;
  }
  const auto found = json_.find(name);
  if (found == json_.end()) {
    Expected(name, "it to be there");
    return nullptr;
  }
  return &*found;
}

bool JsonFields::Has(const char* name) const { return json_.is_object() && json_.contains(name); }

void JsonFields::Read(const char* name, std::string* value) {
  const Json* json = Find(name);
  if (json == nullptr) {
    return;
  }
  if (!json->is_string()) {
    return Expected(name, "a string");
  }
  *value = json->get_ref<const std::string&>();
}

void JsonFields::Read(const char* name, std::int64_t min, std::int64_t max, std::int64_t* value) {
  const Json* json = Find(name);
  if (json != nullptr && !ToInteger(*json, min, max, value)) {
    Expected(name, absl::StrFormat("an integer in [%d, %d]", min, max));
  }
}

void JsonFields::Read(const char* name, std::uint64_t* value) {
  const Json* json = Find(name);
  if (json == nullptr) {
    return;
  }
  if (!json->is_number_unsigned()) {
    return Expected(name, "an integer in [0, 2^64 - 1]");
  }
  *value = json->get<std::uint64_t>();
}

void JsonFields::ReadDoubles(const char* name, std::size_t count, double* values) {
  const Json* json = ReadArray(name);
  if (json == nullptr) {
    return;
  }
  bool is_good = json->size() == count;
  for (std::size_t i = 0; is_good && i < count; ++i) {
    is_good = ToDouble((*json)[i], values + i);
  }
  if (!is_good) {
    Expected(name, absl::StrFormat("%d numbers", count));
  }
}

void JsonFields::ReadIntegers(const char* name, std::size_t count, std::int64_t min,
                              std::int64_t max, std::int64_t* values) {
  const Json* json = ReadArray(name);
  if (json == nullptr) {
    return;
  }
  bool is_good = json->size() == count;
  for (std::size_t i = 0; is_good && i < count; ++i) {
    is_good = ToInteger((*json)[i], min, max, values + i);
  }
  if (!is_good) {
    Expected(name, absl::StrFormat("%d integers in [%d, %d]", count, min, max));
  }
}

void JsonFields::ReadDouble(const char* name, double* value) {
  const Json* json = Find(name);
  if (json != nullptr && !ToDouble(*json, value)) {
    Expected(name, "a number, \"inf\" or \"-inf\"");
  }
}

void JsonFields::ReadCrc32c(const char* name, std::uint32_t* value) {
  const Json* json = Find(name);
  if (json != nullptr && !ToCrc32c(*json, value)) {
    Expected(name, "8 lower-case hex digits");
  }
}

const Json* JsonFields::ReadArray(const char* name) {
  const Json* json = Find(name);
  if (json != nullptr && !json->is_array()) {
    Expected(name, "an array");
    return nullptr;
  }
  return json;
}

const Json* JsonFields::ReadObject(const char* name) {
  const Json* json = Find(name);
  if (json != nullptr && !json->is_object()) {
    Expected(name, "an object");
    return nullptr;
  }
  return json;
}

absl::StatusOr<std::shared_ptr<const Json>> ParseJsonFile(absl::string_view text,
                                                          absl::string_view where,
                                                          absl::string_view format,
                                                          std::int64_t newest_version) {
  auto json = std::make_shared<const Json>(
      Json::parse(text.begin(), text.end(), /*cb=*/nullptr, /*allow_exceptions=*/false));
  if (json->is_discarded()) {
    return absl::DataLossError(absl::StrCat(where, ": no valid JSON"));
  }
  JsonFields fields(*json, where);
  std::string stated_format;
  std::int64_t version = 0;
  fields.Read("format", &stated_format);
  fields.Read("format_version", 1, std::numeric_limits<std::int64_t>::max(), &version);
  ISOSCOPE_RETURN_IF_ERROR(fields.status());
  if (absl::string_view(stated_format) != format) {
    return absl::DataLossError(absl::StrCat(where, ": is a file of format \"", stated_format,
                                            "\", expected \"", format, "\""));
  }
  if (version > newest_version) {
    return absl::FailedPreconditionError(
        absl::StrFormat("%s: format version %d, this program reads up to %d; use a newer program",
                        where, version, newest_version));
  }
  return json;
}

}  // namespace isoscope::store
