#include "client-cli/output/frame_name.h"

#include <algorithm>
#include <cstddef>
#include <optional>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/cli/usage.h"

namespace isoscope::cli {
namespace {

// Wider numbers are no conversions: "%20d" is an escaped space and a letter in an address.
constexpr int kMaxDigits = 9;

// A conversion in a name: text that begins with a percent sign.
struct Conversion {
  enum class Kind { kNumber, kPercent, kNone };
  Kind kind = Kind::kNone;
  std::size_t begin = 0;
  std::size_t size = 0;
  int digits = 0;  // least number of digits
};

// REQUIRES: pattern[begin] is '%'.
Conversion ReadConversion(absl::string_view pattern, std::size_t begin) {
  std::size_t end = begin + 1;
  while (end < pattern.size() && absl::ascii_isdigit(static_cast<unsigned char>(pattern[end]))) {
    ++end;
  }
  const absl::string_view digits = pattern.substr(begin + 1, end - begin - 1);
  const char letter = end < pattern.size() ? pattern[end] : '\0';
  Conversion conversion{.begin = begin, .size = std::min(end + 1, pattern.size()) - begin};
  if (letter == '%' && digits.empty()) {
    conversion.kind = Conversion::Kind::kPercent;
  } else if (letter == '%') {
    --conversion.size;  // the next conversion begins there
  } else if (letter == 'd' && (digits.empty() || (absl::SimpleAtoi(digits, &conversion.digits) &&
                                                  conversion.digits <= kMaxDigits))) {
    conversion.kind = Conversion::Kind::kNumber;
  }
  return conversion;
}

// Returns the conversions of a name, in order.
std::vector<Conversion> ConversionsOf(absl::string_view pattern) {
  std::vector<Conversion> conversions;
  for (std::size_t i = pattern.find('%'); i != absl::string_view::npos;
       i = pattern.find('%', conversions.back().begin + conversions.back().size)) {
    conversions.push_back(ReadConversion(pattern, i));
  }
  return conversions;
}

bool IsNumber(const Conversion& conversion) { return conversion.kind == Conversion::Kind::kNumber; }

}  // namespace

std::string FrameFileName(absl::string_view pattern, int index) {
  const std::vector<Conversion> conversions = ConversionsOf(pattern);
  if (std::none_of(conversions.begin(), conversions.end(), IsNumber)) {
    return std::string(pattern);
  }
  std::string name;
  std::size_t end = 0;  // end of the part that `name` has
  bool has_number = false;
  for (const Conversion& conversion : conversions) {
    absl::StrAppend(&name, pattern.substr(end, conversion.begin - end));
    end = conversion.begin + conversion.size;
    if (conversion.kind == Conversion::Kind::kPercent) {
      name += '%';
    } else if (IsNumber(conversion) && !has_number) {
      absl::StrAppendFormat(&name, "%0*d", conversion.digits, index);
      has_number = true;
    } else {
      absl::StrAppend(&name, pattern.substr(conversion.begin, conversion.size));
    }
  }
  return absl::StrCat(name, pattern.substr(end));
}

bool HasFrameNumber(absl::string_view pattern) {
  return FrameFileName(pattern, 0) != FrameFileName(pattern, 1);
}

absl::Status CheckFrameName(absl::string_view pattern, int frame_count) {
  const std::vector<Conversion> conversions = ConversionsOf(pattern);
  const auto number_count = std::count_if(conversions.begin(), conversions.end(), IsNumber);
  if (number_count > 1) {
    return UsageError(absl::StrCat("--output '", pattern,
                                   "' numbers the frames twice: leave one %d, and write %% for a "
                                   "percent sign"));
  }
  const auto wrong =
      std::find_if(conversions.begin(), conversions.end(), [&](const Conversion& conversion) {
        return !IsNumber(conversion) &&
               (number_count == 0 || conversion.kind != Conversion::Kind::kPercent);
      });
  const bool is_literal = number_count == 0 && frame_count == 1;
  if (wrong == conversions.end() || is_literal) {
    return absl::OkStatus();
  }
  return UsageError(absl::StrCat(
      "--output '", pattern, "': '", pattern.substr(wrong->begin, wrong->size),
      "' is no number of a frame",
      number_count == 0
          ? absl::StrCat(", so that ", frame_count, " frames would overwrite each other")
          : std::string(),
      "; write %d, or %03d for leading zeros (up to %0", kMaxDigits, "d)",
      number_count == 0 ? "" : ", and %% for a percent sign"));
}

}  // namespace isoscope::cli
