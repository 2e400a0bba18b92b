#include "web-gateway/health_request.h"

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"
#include "web-gateway/peer_stream.h"

namespace isoscope::gateway {

absl::Status AskHealth(const HealthRequest& request) {
  const std::size_t colon = request.address.rfind(':');
  if (colon == std::string::npos) {
    return absl::InvalidArgumentError(absl::StrCat("'", request.address, "' is not HOST:PORT"));
  }
  std::string host = request.address.substr(0, colon);
  if (host.size() > 2 && host.front() == '[') {
    host = host.substr(1, host.size() - 2);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const PeerReply reply,
                            AskPeer({.host = host,
                                     .port = request.address.substr(colon + 1),
                                     .target = "/healthz",
                                     .has_tls = request.has_tls,
                                     .ca_file = request.ca_file,
                                     .timeout = request.timeout}));
  return reply.status == 200
             ? absl::OkStatus()
             : absl::UnavailableError(absl::StrCat("the gateway answers ", reply.status, ": ",
                                                   absl::StripAsciiWhitespace(reply.body)));
}

}  // namespace isoscope::gateway
