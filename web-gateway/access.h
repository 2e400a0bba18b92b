// Who may ask: the token, the page that a request comes from, and the name that it was sent to.
//
// A browser sends requests to this machine for any page that it shows, and every user of a shared
// machine reaches its loopback address. Four things keep them from a person's volumes:
//
//   token    each request to /v1/ shows it. It is the gateway's own, or one that the coordinator
//            knows: then the gateway passes it on.
//   Origin   names the page's own host. It must be the host of the request, or an allowed origin.
//   Sec-Fetch-Site
//            is all that a browser says of an <img> in another page: it has no Origin.
//   Host     a page can point a name of its own at 127.0.0.1, and is then its own host. A gateway
//            on a loopback address that asks for no token takes only addresses in digits,
//            localhost, and the hosts of allowed origins.

#ifndef ISOSCOPE_WEB_GATEWAY_ACCESS_H_
#define ISOSCOPE_WEB_GATEWAY_ACCESS_H_

#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

namespace isoscope::gateway {

// "https://hub.example.org", in lower case, without a path. INVALID_ARGUMENT otherwise.
absl::StatusOr<std::string> ParseOrigin(absl::string_view text);

// Whether "HOST:PORT" names this machine's loopback device: 127.x.y.z, [::1] or localhost.
bool IsLoopback(absl::string_view host_and_port);

// 128 random bits as 32 hexadecimal digits.
std::string MakeToken();

// The token that a gateway is to ask for: that in `file`, else that of $ISOSCOPE_GATEWAY_TOKEN;
// empty if neither is given. Errors as rpc::ReadTokenFile.
absl::StatusOr<std::string> ReadGatewayToken(const std::string& file);

// The protocol of the WebSocket. A browser gives it no header of the page's choosing, so a page
// offers a second protocol, "isoscope.bearer." and the token in base64 for addresses (RFC 4648,
// section 5).
inline constexpr absl::string_view kInteractProtocol = "isoscope";
// Whether the header Sec-WebSocket-Protocol offers kInteractProtocol.
bool OffersInteractProtocol(absl::string_view protocols);
// The token of that header; empty without one.
std::string TokenOfProtocols(absl::string_view protocols);

struct AccessOptions {
  std::string token = {};  // the gateway's own; empty: none is asked for
  // Users show tokens that the coordinator knows. Without an own token those are passed on anyway;
  // this says that each user has one.
  bool has_user_tokens = false;
  std::vector<std::string> allowed_origins = {};  // as ParseOrigin returns them
  bool listens_on_loopback = true;
};

// What a request says about the page that it comes from; empty: nothing.
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

  // PERMISSION_DENIED if the request comes from another page, or was sent to a name that may be
  // somebody else's; says which option allows it. `origin`: the header, empty if there is none.
  [[nodiscard]] absl::Status CheckSource(absl::string_view origin, absl::string_view host) const;
  // For what costs or tells something, CheckSource and: PERMISSION_DENIED for a request without an
  // Origin that a page of another origin makes, as by <img>, unless its Referer is allowed.
  [[nodiscard]] absl::Status CheckDataSource(const RequestSource& source) const;
  // UNAUTHENTICATED unless one of the two is the token, or none is asked for. `authorization`: the
  // header, "Bearer TOKEN".
  [[nodiscard]] absl::Status CheckToken(absl::string_view parameter,
                                        absl::string_view authorization) const;
  // The token to pass on to the coordinator: empty if the gateway asks for one of its own, or none
  // is given. UNAUTHENTICATED if it is none that a header may carry.
  [[nodiscard]] absl::StatusOr<std::string> UserToken(absl::string_view parameter,
                                                      absl::string_view authorization) const;
  // Whether answers may carry "Access-Control-Allow-Origin: origin".
  [[nodiscard]] bool IsAllowedOrigin(absl::string_view origin) const;
  // Whether a page at this address has an allowed origin.
  [[nodiscard]] bool IsAllowedReferer(absl::string_view referer) const;
  // Of its own.
  [[nodiscard]] bool has_token() const { return !options_.token.empty(); }
  // Whether users must show a token, the gateway's or the coordinator's.
  [[nodiscard]] bool asks_token() const { return has_token() || options_.has_user_tokens; }

 private:
  const AccessOptions options_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_ACCESS_H_
