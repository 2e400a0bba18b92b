// Rules of HTTP for the header of a request, beyond its syntax: RFC 9110 (semantics), RFC 9112
// (HTTP/1.1) and RFC 6455 (WebSockets).

#ifndef ISOSCOPE_CORE_HTTP_REQUEST_RULES_H_
#define ISOSCOPE_CORE_HTTP_REQUEST_RULES_H_

#include <optional>
#include <string>

#include "absl/strings/string_view.h"

#include "core/http/peer_message.h"

namespace isoscope::http {

// The reason that a request is refused, and the status of the answer.
struct Refusal {
  int status = 400;
  std::string reason = {};
};

// Returns none for a request that may be answered. Refused are:
//
//   400  a field twice that a request has once, among them Host, Authorization, Content-Length; no
//        Host in HTTP/1.1, or one that names no host; "*" but for OPTIONS; an address with another
//        scheme than http and https, or without a host; a WebSocket with a body; a coding of the
//        body in HTTP/1.0
//   417  an expectation other than 100-continue
//   501  a coding of the body other than chunked
std::optional<Refusal> CheckRequest(const PeerRequest& request);

// Returns the host, and the port if there is one, that a request was sent to: of its address, if
// that names one ("GET http://HOST/PATH"), else of the field Host.
std::string HostOf(const PeerRequest& request);

// True if the client waits for 100 before it sends its body.
bool WaitsToContinue(const PeerRequest& request);

// "http://HOST/PATH?QUERY" without scheme and host; other addresses as they are.
std::string WithoutHost(absl::string_view target);

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_REQUEST_RULES_H_
