#include "core/formats/zarr/zarr_json.h"

#include <limits>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/printable.h"
#include "core/source/bytes/file_content.h"

namespace isoscope::source {
namespace {

constexpr int kMaxZarrJsonDepth = 64;
constexpr std::size_t kMaxNumbers = 64;

}  // namespace

absl::StatusOr<ZarrJson> ParseZarrJson(absl::string_view text, const std::string& name) {
  if (static_cast<std::int64_t>(text.size()) > kMaxZarrJsonBytes) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d bytes; metadata have at most %d",
                                                      name, text.size(), kMaxZarrJsonBytes));
  }
  // Quotes Python's names of numbers, and counts brackets, all outside of strings.
  std::string plain;
  plain.reserve(text.size());
  bool is_in_string = false;
  int depth = 0;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (is_in_string) {
      const std::size_t length = c == '\\' && i + 1 < text.size() ? 2 : 1;
      is_in_string = c != '"';
      plain.append(text.data() + i, length);
      i += length;
      continue;
    }
    is_in_string = c == '"';
    depth += c == '{' || c == '[' ? 1 : 0;
    depth -= c == '}' || c == ']' ? 1 : 0;
    if (depth > kMaxZarrJsonDepth) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: more than %d levels deep", name, kMaxZarrJsonDepth));
    }
    bool is_number = false;
    for (const absl::string_view number : {"NaN", "Infinity", "-Infinity"}) {
      if (absl::StartsWith(text.substr(i), number)) {
        absl::StrAppend(&plain, "\"", number, "\"");
        i += number.size();
        is_number = true;
        break;
      }
    }
    if (!is_number) {
      plain.push_back(c);
      ++i;
    }
  }
  ZarrJson json = ZarrJson::parse(plain, nullptr, /*allow_exceptions=*/false);
  if (!json.is_object() && absl::StartsWith(text, kLfsPointerMark)) {
    return LfsPointerError(name);
  }
  if (!json.is_object()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": no JSON object: it is damaged or cut"));
  }
  return json;
}

const ZarrJson* MemberOf(const ZarrJson& object, const char* name) {
  if (!object.is_object()) {
    return nullptr;
  }
  const auto found = object.find(name);
  return found == object.end() ? nullptr : &*found;
}

std::string TextOf(const ZarrJson& object, const char* name) {
  const ZarrJson* const member = MemberOf(object, name);
  return member != nullptr && member->is_string() ? member->get<std::string>() : "";
}

std::optional<double> NumberOf(const ZarrJson& value) {
  if (value.is_number()) {
    return value.get<double>();
  }
  if (value == "NaN") {
    return std::numeric_limits<double>::quiet_NaN();
  }
  if (value == "Infinity" || value == "-Infinity") {
    return (value == "Infinity" ? 1 : -1) * std::numeric_limits<double>::infinity();
  }
  return std::nullopt;
}

std::vector<double> NumbersOf(const ZarrJson& object, const char* name) {
  const ZarrJson* const member = MemberOf(object, name);
  if (member == nullptr) {
    return {};
  }
  if (const auto number = NumberOf(*member); number.has_value()) {
    return {*number};
  }
  std::vector<double> numbers;
  if (member->is_array() && member->size() <= kMaxNumbers) {
    for (const ZarrJson& item : *member) {
      const auto number = NumberOf(item);
      if (!number.has_value()) {
        return {};
      }
      numbers.push_back(*number);
    }
  }
  return numbers;
}

std::string ShownJson(const ZarrJson& value) {
  constexpr std::size_t kMaxShown = 80;
  if (value.is_structured() && value.size() > kMaxShown) {
    return absl::StrCat(value.is_array() ? "a list of " : "an object of ", value.size());
  }
  return base::Printable(
      base::CutText(value.dump(-1, ' ', true, ZarrJson::error_handler_t::replace), kMaxShown));
}

}  // namespace isoscope::source
