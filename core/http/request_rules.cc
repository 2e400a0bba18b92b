// CheckRequest returns the first refusal of:
//
// 1. CheckFields: a field that is no list occurs once; Host names a host (RFC 9110, section 5.3;
//    RFC 9112, section 3.2).
// 2. CheckTarget: /PATH, http://HOST/PATH, or * for OPTIONS (RFC 9112, section 3.2).
// 3. CheckBody: Transfer-Encoding is "chunked" or absent (RFC 9112, section 6.1); no body before a
//    WebSocket.
// 4. CheckExpectations: only 100-continue (RFC 9110, section 10.1.1).
//
// An address with a host goes before the field Host: http://a:80/x?y has the host a:80 and the rest
// /x?y.

#include "core/http/request_rules.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"

#include "core/base/printable.h"

namespace isoscope::http {
namespace {

// Fields that are no lists: of two, programs on the way and this one could believe different ones.
constexpr std::array<absl::string_view, 9> kSingleFields = {
    "Host",    "Content-Length", "Content-Type",      "Authorization",        "Origin",
    "Referer", "Sec-Fetch-Site", "Sec-WebSocket-Key", "Sec-WebSocket-Version"};
constexpr absl::string_view kContinue = "100-continue";

std::vector<absl::string_view> PartsOf(absl::string_view list) {
  std::vector<absl::string_view> parts;
  for (const absl::string_view part : absl::StrSplit(list, ',')) {
    const absl::string_view text = absl::StripAsciiWhitespace(part);
    if (!text.empty()) {
      parts.push_back(text);
    }
  }
  return parts;
}

// The part of an address between "//" and the path; empty if it has none.
absl::string_view AuthorityOf(absl::string_view target) {
  const std::size_t begin = target.find("://");
  if (begin == absl::string_view::npos || absl::StartsWith(target, "/")) {
    return {};
  }
  const absl::string_view rest = target.substr(begin + 3);
  return rest.substr(0, rest.find_first_of("/?#"));
}

// RFC 3986: a name, an address, or an address of IPv6 in brackets; perhaps a port.
bool IsHost(absl::string_view text) {
  const std::size_t close = text.rfind(']');
  const std::size_t colon = text.rfind(':');
  const bool has_port =
      colon != absl::string_view::npos && (close == absl::string_view::npos || colon > close);
  const absl::string_view host = has_port ? text.substr(0, colon) : text;
  const absl::string_view port = has_port ? text.substr(colon + 1) : "";
  const bool is_bracketed = absl::StartsWith(host, "[") && absl::EndsWith(host, "]");
  const auto is_of_host = [is_bracketed](char c) {
    return absl::ascii_isalnum(static_cast<unsigned char>(c)) ||
           absl::string_view("-._~%!$&'()*+;=").find(c) != absl::string_view::npos ||
           (is_bracketed && (c == ':' || c == '[' || c == ']'));
  };
  return !host.empty() && std::all_of(host.begin(), host.end(), is_of_host) &&
         std::all_of(port.begin(), port.end(),
                     [](char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); });
}

std::optional<Refusal> CheckFields(const PeerRequest& request) {
  for (const absl::string_view name : kSingleFields) {
    if (const int count = request.CountFields(name); count > 1) {
      return Refusal{.reason = absl::StrCat("the header has ", count, " fields ", name,
                                            ": a request may have one")};
    }
  }
  if (request.CountFields("Host") == 0) {
    return request.is_http_1_0 ? std::nullopt
                               : std::optional(Refusal{.reason = "the header has no field Host"});
  }
  const absl::string_view host = request.Field("Host");
  if (!IsHost(host)) {
    return Refusal{.reason = absl::StrCat("the field Host is ", base::Quoted(host, '\''),
                                          ": must be HOST or HOST:PORT")};
  }
  return std::nullopt;
}

std::optional<Refusal> CheckTarget(const PeerRequest& request) {
  const absl::string_view target = request.target;
  if (absl::StartsWith(target, "/") || (target == "*" && request.method == "OPTIONS")) {
    return std::nullopt;
  }
  const bool is_absolute = absl::StartsWithIgnoreCase(target, "http://") ||
                           absl::StartsWithIgnoreCase(target, "https://");
  if (is_absolute && IsHost(AuthorityOf(target))) {
    return std::nullopt;
  }
  return Refusal{.reason = absl::StrCat("the address ", base::Quoted(target, '\''),
                                        " is not /PATH or /PATH?QUERY")};
}

std::optional<Refusal> CheckBody(const PeerRequest& request) {
  if (request.CountFields("Transfer-Encoding") > 0) {
    const std::string codings = request.List("Transfer-Encoding");
    if (request.is_http_1_0) {
      return Refusal{.reason = "HTTP/1.0 has no Transfer-Encoding"};
    }
    if (!absl::EqualsIgnoreCase(codings, "chunked")) {
      return Refusal{.status = 501,
                     .reason = absl::StrCat("Transfer-Encoding is ", base::Quoted(codings, '\''),
                                            ": only chunked is read here")};
    }
  }
  if (request.asks_websocket && request.has_body) {
    return Refusal{.reason = "a request for a WebSocket has no body"};
  }
  return std::nullopt;
}

std::optional<Refusal> CheckExpectations(const PeerRequest& request) {
  const std::string expectations = request.List("Expect");
  for (const absl::string_view part : PartsOf(expectations)) {
    if (!absl::EqualsIgnoreCase(part, kContinue)) {
      return Refusal{.status = 417,
                     .reason = absl::StrCat("the request expects ", base::Quoted(part, '\''),
                                            ": only 100-continue is met here")};
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<Refusal> CheckRequest(const PeerRequest& request) {
  for (const auto check : {CheckFields, CheckTarget, CheckBody, CheckExpectations}) {
    if (std::optional<Refusal> refusal = check(request); refusal.has_value()) {
      return refusal;
    }
  }
  return std::nullopt;
}

std::string HostOf(const PeerRequest& request) {
  const absl::string_view authority = AuthorityOf(request.target);
  return std::string(authority.empty() ? request.Field("Host") : authority);
}

bool WaitsToContinue(const PeerRequest& request) {
  if (request.is_http_1_0 || !request.has_body) {
    return false;
  }
  const std::string expectations = request.List("Expect");
  const std::vector<absl::string_view> parts = PartsOf(expectations);
  return std::any_of(parts.begin(), parts.end(), [](absl::string_view part) {
    return absl::EqualsIgnoreCase(part, kContinue);
  });
}

std::string WithoutHost(absl::string_view target) {
  const absl::string_view authority = AuthorityOf(target);
  if (authority.empty()) {
    return std::string(target);
  }
  const auto begin = static_cast<std::size_t>(authority.data() - target.data());
  const absl::string_view rest = target.substr(begin + authority.size());
  return absl::StartsWith(rest, "/") ? std::string(rest) : absl::StrCat("/", rest);
}

}  // namespace isoscope::http
