// A request passes these checks, in this order; access.h has the reason of each:
//
//   CheckDataSource   of data: CheckSource, and Sec-Fetch-Site of pages without an Origin
//   CheckSource       Origin: of this host, or allowed. Host: on the loopback address without a
//                     token, an address, localhost, or the host of an allowed origin
//   CheckToken        the gateway's token, as parameter or "Authorization: Bearer"; compared in
//                     constant time
//   UserToken         a gateway without a token passes the user's token on to the coordinator
//
// WebSockets of browsers can't set Authorization. They offer the protocol
// isoscope.bearer.BASE64URL, which TokenOfProtocols decodes.

#include "web-gateway/http/access.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdlib>

#include "absl/strings/ascii.h"
#include "absl/strings/escaping.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "absl/strings/strip.h"
#include <arpa/inet.h>
#include <openssl/crypto.h>
#include <openssl/rand.h>

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "rpc/peer.h"
#include "web-gateway/http/url.h"

namespace isoscope::gateway {
namespace {

constexpr std::size_t kTokenBytes = 16;
constexpr char kGatewayTokenVariable[] = "ISOSCOPE_GATEWAY_TOKEN";
constexpr absl::string_view kBearerProtocol = "isoscope.bearer.";

// "host:8080" or "[::1]:8080" without the port.
absl::string_view HostOf(absl::string_view host_and_port) {
  if (absl::StartsWith(host_and_port, "[")) {
    const std::size_t end = host_and_port.find(']');
    return end == absl::string_view::npos ? host_and_port : host_and_port.substr(0, end + 1);
  }
  return host_and_port.substr(0, host_and_port.find(':'));
}

// Returns the part behind "://"; empty if the text has no http or https scheme.
absl::string_view AuthorityOf(absl::string_view origin) {
  for (const absl::string_view scheme :
       {absl::string_view("http://"), absl::string_view("https://")}) {
    if (absl::StartsWithIgnoreCase(origin, scheme)) {
      return origin.substr(scheme.size());
    }
  }
  return {};
}

// Returns true if the whole `text` is an address of that family.
bool IsAddress(int family, absl::string_view text) {
  in6_addr address{};
  return !absl::StrContains(text, '\0') &&
         inet_pton(family, std::string(text).c_str(), &address) == 1;
}

bool IsIpv4(absl::string_view host) { return IsAddress(AF_INET, host); }

// In brackets.
bool IsIpv6(absl::string_view host) {
  return absl::ConsumePrefix(&host, "[") && absl::ConsumeSuffix(&host, "]") &&
         IsAddress(AF_INET6, host);
}

bool IsLocalhost(absl::string_view host) {
  return absl::EqualsIgnoreCase(host, "localhost") || absl::EndsWithIgnoreCase(host, ".localhost");
}

// Compares in constant time for texts of the token's length.
bool Equals(absl::string_view given, absl::string_view token) {
  return given.size() == token.size() &&
         CRYPTO_memcmp(given.data(), token.data(), token.size()) == 0;
}

// Returns the token of "Bearer TOKEN"; empty if the header has another form.
absl::string_view BearerOf(absl::string_view authorization) {
  constexpr absl::string_view kBearer = "Bearer ";
  return absl::StartsWithIgnoreCase(authorization, kBearer)
             ? absl::StripAsciiWhitespace(authorization.substr(kBearer.size()))
             : absl::string_view();
}

}  // namespace

absl::StatusOr<std::string> ParseOrigin(absl::string_view text) {
  const absl::string_view authority = AuthorityOf(text);
  // An origin may stand in a header, so nothing else than a host passes.
  const bool is_host = std::all_of(authority.begin(), authority.end(), [](unsigned char c) {
    return absl::ascii_isalnum(c) ||
           absl::string_view(".-_:[]").find(static_cast<char>(c)) != absl::string_view::npos;
  });
  if (authority.empty() || !is_host) {
    return absl::InvalidArgumentError(absl::StrCat(
        Quoted(text), " is not an origin: http://HOST[:PORT] or https://HOST[:PORT], no path"));
  }
  return absl::AsciiStrToLower(text);
}

bool IsLoopback(absl::string_view host_and_port) {
  const absl::string_view host = HostOf(host_and_port);
  return IsLocalhost(host) || host == "[::1]" || (IsIpv4(host) && absl::StartsWith(host, "127."));
}

std::string MakeToken() {
  std::array<unsigned char, kTokenBytes> bytes{};
  ISOSCOPE_CHECK(RAND_bytes(bytes.data(), static_cast<int>(bytes.size())) == 1);
  return absl::BytesToHexString(
      absl::string_view(reinterpret_cast<const char*>(bytes.data()), bytes.size()));
}

absl::StatusOr<std::string> ReadGatewayToken(const std::string& file) {
  if (!file.empty()) {
    return rpc::ReadTokenFile(file);
  }
  // NOLINTNEXTLINE(concurrency-mt-unsafe): nobody sets the environment
  const char* const variable = getenv(kGatewayTokenVariable);
  std::string token(absl::StripAsciiWhitespace(variable == nullptr ? "" : variable));
  const absl::Status checked = token.empty() ? absl::OkStatus() : rpc::CheckTokenText(token);
  if (!checked.ok()) {
    return absl::InvalidArgumentError(
        absl::StrCat("$", kGatewayTokenVariable, ": ", checked.message()));
  }
  return token;
}

bool OffersInteractProtocol(absl::string_view protocols) {
  const std::vector<absl::string_view> offered = absl::StrSplit(protocols, ',');
  return std::any_of(offered.begin(), offered.end(), [](absl::string_view name) {
    return absl::StripAsciiWhitespace(name) == kInteractProtocol;
  });
}

std::string TokenOfProtocols(absl::string_view protocols) {
  for (const absl::string_view part : absl::StrSplit(protocols, ',')) {
    absl::string_view name = absl::StripAsciiWhitespace(part);
    std::string token;
    if (absl::ConsumePrefix(&name, kBearerProtocol) && absl::WebSafeBase64Unescape(name, &token)) {
      return token;
    }
  }
  return "";
}

absl::StatusOr<std::string> AccessRules::UserToken(absl::string_view parameter,
                                                   absl::string_view authorization) const {
  if (has_token()) {
    return std::string();
  }
  const absl::string_view token = parameter.empty() ? BearerOf(authorization) : parameter;
  if (token.empty()) {
    return std::string();
  }
  const absl::Status checked = rpc::CheckTokenText(token);
  if (!checked.ok()) {
    return absl::UnauthenticatedError(checked.message());
  }
  return std::string(token);
}

bool AccessRules::IsAllowedOrigin(absl::string_view origin) const {
  const std::string lower = absl::AsciiStrToLower(origin);
  return std::find(options_.allowed_origins.begin(), options_.allowed_origins.end(), lower) !=
         options_.allowed_origins.end();
}

bool AccessRules::IsAllowedReferer(absl::string_view referer) const {
  const absl::string_view authority = AuthorityOf(referer);
  const std::size_t scheme_bytes = referer.size() - authority.size();
  return !authority.empty() &&
         IsAllowedOrigin(
             referer.substr(0, scheme_bytes + authority.substr(0, authority.find('/')).size()));
}

absl::Status AccessRules::CheckDataSource(const RequestSource& source) const {
  ISOSCOPE_RETURN_IF_ERROR(CheckSource(source.origin, source.host));
  // Pages of another port of this machine are "same-site", but may belong to another user.
  if (source.origin.empty() &&
      (source.fetch_site == "cross-site" || source.fetch_site == "same-site") &&
      !IsAllowedReferer(source.referer)) {
    return absl::PermissionDeniedError(absl::StrCat(
        "the request comes from a page of another origin (Sec-Fetch-Site: ",
        Quoted(source.fetch_site), ", Referer: ", Quoted(source.referer),
        "): start the gateway with --allow-origin ORIGIN if that page may see its datasets"));
  }
  return absl::OkStatus();
}

absl::Status AccessRules::CheckSource(absl::string_view origin, absl::string_view host) const {
  if (!origin.empty() && !IsAllowedOrigin(origin) &&
      (host.empty() || !absl::EqualsIgnoreCase(AuthorityOf(origin), host))) {
    return absl::PermissionDeniedError(absl::StrCat(
        "the request comes from a page of ", Quoted(origin), ", and this is ", Quoted(host),
        ": start the gateway with --allow-origin ORIGIN if that page may see its datasets"));
  }
  if (!options_.listens_on_loopback || asks_token()) {
    return absl::OkStatus();
  }
  const absl::string_view name = HostOf(host);
  const bool is_allowed =
      IsIpv4(name) || IsIpv6(name) || IsLocalhost(name) ||
      std::any_of(options_.allowed_origins.begin(), options_.allowed_origins.end(),
                  [&](const std::string& allowed) {
                    return absl::EqualsIgnoreCase(HostOf(AuthorityOf(allowed)), name);
                  });
  if (!is_allowed) {
    return absl::PermissionDeniedError(
        absl::StrCat("the request was sent to the name ", Quoted(name),
                     ", which this gateway does not know to be its own: use localhost or "
                     "127.0.0.1, or start it with --allow-origin http://HOST:PORT or with a "
                     "token"));
  }
  return absl::OkStatus();
}

absl::Status AccessRules::CheckToken(absl::string_view parameter,
                                     absl::string_view authorization) const {
  if (!has_token() || Equals(parameter, options_.token)) {
    return absl::OkStatus();
  }
  if (Equals(BearerOf(authorization), options_.token)) {
    return absl::OkStatus();
  }
  return absl::UnauthenticatedError(
      parameter.empty() && authorization.empty()
          ? "a token is asked for here: open the address that was printed at the start, with "
            "token=..., or send 'Authorization: Bearer TOKEN'"
          : "the token is wrong: open the address that was printed at the last start");
}

}  // namespace isoscope::gateway
