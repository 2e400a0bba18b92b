// Access checks of a request: its token, the page that it comes from, and the host that it was sent
// to.
//
// A browser sends requests to this machine for any page that it shows, and every user of a shared
// machine can reach its loopback address. Four checks protect a user's volumes from them:
//
//   token    each request to /v1/ shows it. It is the gateway's own, or one that the coordinator
//            knows: then the gateway passes it on.
//   Origin   names the page's own host. It must be the host of the request, or an allowed origin.
//   Sec-Fetch-Site
//            is the only hint for an <img> in another page, whose request has no Origin.
//   Host     a page can resolve a name of its own to 127.0.0.1, and then has the same origin. So a
//            gateway on a loopback address without tokens accepts only numeric addresses,
//            localhost, and the hosts of allowed origins.

#ifndef ISOSCOPE_WEB_GATEWAY_HTTP_ACCESS_H_
#define ISOSCOPE_WEB_GATEWAY_HTTP_ACCESS_H_

#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::gateway {

// Returns "https://hub.example.org", in lower case, without a path. INVALID_ARGUMENT otherwise, also
// for a wildcard.
absl::StatusOr<std::string> ParseOrigin(absl::string_view text);

// Returns true if "HOST:PORT" names this machine's loopback device: 127.x.y.z, [::1] or localhost.
bool IsLoopback(absl::string_view host_and_port);

// 128 random bits as 32 hexadecimal digits.
std::string MakeToken();

// Returns the token that users must show: that in `file`, else that of $ISOSCOPE_GATEWAY_TOKEN;
// empty if neither is given. Errors as rpc::ReadTokenFile.
absl::StatusOr<std::string> ReadGatewayToken(const std::string& file);

// The protocol of the WebSocket. A page can't set headers of a WebSocket. So it offers a second
// protocol, "isoscope.bearer." and the token in base64 for addresses (RFC 4648, section 5).
inline constexpr absl::string_view kInteractProtocol = "isoscope";
// Returns true if the header Sec-WebSocket-Protocol offers kInteractProtocol.
bool OffersInteractProtocol(absl::string_view protocols);
// Returns the token of that header; empty without one.
std::string TokenOfProtocols(absl::string_view protocols);

struct AccessOptions {
  std::string token = {};  // the gateway's own; empty: none is required
  // True if each user has a token of the coordinator. Such tokens are passed on in any case if the
  // gateway has none of its own.
  bool has_user_tokens = false;
  std::vector<std::string> allowed_origins = {};  // as ParseOrigin returns them
  bool listens_on_loopback = true;
};

// The headers of a request that identify its page; empty: not sent.
struct RequestSource {
  absl::string_view origin = {};
  absl::string_view host = {};
  absl::string_view fetch_site = {};  // Sec-Fetch-Site
  absl::string_view referer = {};
};

// Immutable, so thread-safe.
class AccessRules {
 public:
  explicit AccessRules(AccessOptions options) : options_(std::move(options)) {}

  // PERMISSION_DENIED if the request comes from another page, or was sent to a host name that may
  // belong to another page. The message names the option that allows it. `origin`: the header,
  // empty if there is none.
  [[nodiscard]] absl::Status CheckSource(absl::string_view origin, absl::string_view host) const;
  // CheckSource for requests that cost work or reveal data. PERMISSION_DENIED also for a request
  // without an Origin from a page of another origin, as by <img>, unless its Referer is allowed.
  [[nodiscard]] absl::Status CheckDataSource(const RequestSource& source) const;
  // UNAUTHENTICATED unless one of the two is the token, or none is required. `authorization`: the
  // header, "Bearer TOKEN".
  [[nodiscard]] absl::Status CheckToken(absl::string_view parameter,
                                        absl::string_view authorization) const;
  // Returns the token to pass on to the coordinator: empty if the gateway requires its own, or none
  // is given. UNAUTHENTICATED if a header can't carry it.
  [[nodiscard]] absl::StatusOr<std::string> UserToken(absl::string_view parameter,
                                                      absl::string_view authorization) const;
  // Returns true if answers may carry "Access-Control-Allow-Origin: origin".
  [[nodiscard]] bool IsAllowedOrigin(absl::string_view origin) const;
  // Returns true if a page at this address has an allowed origin.
  [[nodiscard]] bool IsAllowedReferer(absl::string_view referer) const;
  // Returns true if the gateway has its own token.
  [[nodiscard]] bool has_token() const { return !options_.token.empty(); }
  // Returns true if users must show a token, the gateway's or the coordinator's.
  [[nodiscard]] bool asks_token() const { return has_token() || options_.has_user_tokens; }

 private:
  const AccessOptions options_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_HTTP_ACCESS_H_
