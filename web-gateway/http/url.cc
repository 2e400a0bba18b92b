#include "web-gateway/http/url.h"

#include <algorithm>

#include "absl/status/status.h"
#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_split.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"

namespace isoscope::gateway {
namespace {

int HexDigit(char c) {
  if (c >= '0' && c <= '9') {
    return c - '0';
  }
  const char lower = absl::ascii_tolower(static_cast<unsigned char>(c));
  return lower >= 'a' && lower <= 'f' ? lower - 'a' + 10 : -1;
}

absl::StatusOr<std::string> Decode(absl::string_view text, bool plus_is_space) {
  std::string decoded;
  decoded.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    char c = text[i];
    if (c == '%') {
      const int high = i + 2 < text.size() ? HexDigit(text[i + 1]) : -1;
      const int low = high >= 0 ? HexDigit(text[i + 2]) : -1;
      if (low < 0) {
        return absl::InvalidArgumentError(
            absl::StrCat("the address has a '%' without two hexadecimal digits: ", Quoted(text)));
      }
      c = static_cast<char>(high * 16 + low);
      i += 2;
    } else if (c == '+' && plus_is_space) {
      c = ' ';
    }
    if (absl::ascii_iscntrl(static_cast<unsigned char>(c))) {
      return absl::InvalidArgumentError(
          absl::StrCat("the address has a control character: ", Quoted(text)));
    }
    decoded += c;
  }
  if (base::ValidUtf8(decoded) != decoded) {
    return absl::InvalidArgumentError(absl::StrCat("the address is no UTF-8: ", Quoted(text)));
  }
  return decoded;
}

absl::StatusOr<QueryParameters> ParseQuery(absl::string_view text) {
  QueryParameters query;
  for (const absl::string_view pair : absl::StrSplit(text, '&', absl::SkipEmpty())) {
    if (query.size() == kMaxQueryParameters) {
      return absl::InvalidArgumentError(
          absl::StrCat("the address has more than ", kMaxQueryParameters, " parameters"));
    }
    const std::vector<absl::string_view> parts = absl::StrSplit(pair, absl::MaxSplits('=', 1));
    ISOSCOPE_ASSIGN_OR_RETURN(std::string name, Decode(parts[0], /*plus_is_space=*/true));
    std::string value;
    if (parts.size() > 1) {
      ISOSCOPE_ASSIGN_OR_RETURN(value, Decode(parts[1], /*plus_is_space=*/true));
    }
    query.emplace_back(std::move(name), std::move(value));
  }
  return query;
}

}  // namespace

std::string Target::TakeParameter(absl::string_view name) {
  std::string value;
  bool is_first = true;
  for (const auto& [key, text] : query) {
    if (is_first && key == name) {
      value = text;
      is_first = false;
    }
  }
  query.erase(std::remove_if(query.begin(), query.end(),
                             [&](const auto& parameter) { return parameter.first == name; }),
              query.end());
  return value;
}

absl::StatusOr<Target> ParseTarget(absl::string_view target) {
  if (!absl::StartsWith(target, "/")) {
    return absl::InvalidArgumentError(
        absl::StrCat("the address ", Quoted(target), " is not /PATH or /PATH?QUERY"));
  }
  const std::vector<absl::string_view> parts = absl::StrSplit(target, absl::MaxSplits('?', 1));
  Target parsed;
  for (const absl::string_view segment : absl::StrSplit(parts[0], '/', absl::SkipEmpty())) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::string decoded, Decode(segment, /*plus_is_space=*/false));
    if (decoded == "." || decoded == "..") {
      return absl::InvalidArgumentError(
          absl::StrCat("the address ", Quoted(target), " has a segment '", decoded, "'"));
    }
    parsed.segments.push_back(std::move(decoded));
  }
  if (parts.size() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(parsed.query, ParseQuery(parts[1]));
  }
  return parsed;
}

std::string Quoted(absl::string_view text) { return base::Quoted(text, '\''); }

std::string EscapeQueryValue(absl::string_view text) {
  std::string escaped;
  for (const char c : text) {
    if (absl::ascii_isalnum(static_cast<unsigned char>(c)) ||
        absl::string_view("-_.~,:").find(c) != absl::string_view::npos) {
      escaped += c;
    } else {
      absl::StrAppendFormat(&escaped, "%%%02X", static_cast<unsigned char>(c));
    }
  }
  return escaped;
}

}  // namespace isoscope::gateway
