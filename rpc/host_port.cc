#include "rpc/host_port.h"

#include <cstddef>
#include <cstdint>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace isoscope::rpc {
namespace {

absl::Status Malformed(absl::string_view text) {
  return absl::InvalidArgumentError(
      absl::StrCat("'", text,
                   "' is not HOST:PORT with a port from 0 to 65535 (an IPv6 address in "
                   "brackets: [::1]:50051)"));
}

}  // namespace

absl::StatusOr<std::string> ParseHostPort(absl::string_view text) {
  const std::size_t colon = text.rfind(':');
  if (colon == absl::string_view::npos || colon == 0) {
    return Malformed(text);
  }
  const absl::string_view host = text.substr(0, colon);
  const absl::string_view port = text.substr(colon + 1);
  const bool is_bracketed = host.size() > 2 && host.front() == '[' && host.back() == ']';
  std::int64_t port_value = 0;
  if ((absl::StrContains(host, ':') && !is_bracketed) || absl::StrContains(text, ' ') ||
      !absl::SimpleAtoi(port, &port_value) || port_value < 0 || port_value > 65535) {
    return Malformed(text);
  }
  return absl::StrCat(text);
}

std::string WithDefaultPort(absl::string_view text, int port) {
  const bool is_bracketed = text.size() > 2 && text.front() == '[' && text.back() == ']';
  const bool is_number = text.find_first_not_of("0123456789") == absl::string_view::npos;
  const bool is_host = !is_number && (is_bracketed || !absl::StrContains(text, ':'));
  return is_host ? absl::StrCat(text, ":", port) : std::string(text);
}

absl::StatusOr<std::string> ParseAddress(absl::string_view text, int default_port) {
  return ParseHostPort(WithDefaultPort(text, default_port));
}

absl::StatusOr<std::string> ParseCoordinatorAddress(absl::string_view text) {
  return ParseAddress(text, kCoordinatorPort);
}

}  // namespace isoscope::rpc
