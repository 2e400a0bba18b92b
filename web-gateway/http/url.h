// The target of an HTTP request: its path in segments, and its query.

#ifndef ISOSCOPE_WEB_GATEWAY_HTTP_URL_H_
#define ISOSCOPE_WEB_GATEWAY_HTTP_URL_H_

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::gateway {

inline constexpr std::size_t kMaxQueryParameters = 128;

// Names and values in their order, decoded. A name may come several times.
using QueryParameters = std::vector<std::pair<std::string, std::string>>;

struct Target {
  std::vector<std::string> segments = {};  // "/v1/datasets/a%2Fb": v1, datasets, a/b; none for "/"
  QueryParameters query = {};

  friend bool operator==(const Target&, const Target&) = default;

  // Removes the parameters of this name, and returns the value of the first; "" without one.
  std::string TakeParameter(absl::string_view name);
};

// Parses "/path?query". INVALID_ARGUMENT, with the target quoted, for another form, a broken
// percent escape, a control character, bytes that are no UTF-8, a segment that is "." or "..", or
// more than kMaxQueryParameters parameters.
absl::StatusOr<Target> ParseTarget(absl::string_view target);

// Returns a client's text between ', bounded and escaped: base::Quoted.
std::string Quoted(absl::string_view text);

// Escapes all bytes but letters, digits, '-', '_', '.', '~', ',' and ':', for a value in a query.
std::string EscapeQueryValue(absl::string_view text);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_HTTP_URL_H_
