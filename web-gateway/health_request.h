// Requests /healthz of a gateway: its --probe.

#ifndef ISOSCOPE_WEB_GATEWAY_HEALTH_REQUEST_H_
#define ISOSCOPE_WEB_GATEWAY_HEALTH_REQUEST_H_

#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace isoscope::gateway {

struct HealthRequest {
  std::string address;  // HOST:PORT
  bool has_tls = false;
  // The authority of the certificate, which must be for the address. Empty: any certificate is
  // accepted, as for a gateway that probes itself.
  std::string ca_file = {};
  absl::Duration timeout = absl::Seconds(4);
};

// OK if the gateway and its coordinator are healthy. UNAVAILABLE has the gateway's answer, or says
// that there was none. Blocks.
absl::Status AskHealth(const HealthRequest& request);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_HEALTH_REQUEST_H_
