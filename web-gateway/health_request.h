// Asks a gateway for /healthz: its --probe.

#ifndef ISOSCOPE_WEB_GATEWAY_HEALTH_REQUEST_H_
#define ISOSCOPE_WEB_GATEWAY_HEALTH_REQUEST_H_

#include <string>

#include "absl/status/status.h"
#include "absl/time/time.h"

namespace isoscope::gateway {

struct HealthRequest {
  std::string address;  // HOST:PORT
  bool has_tls = false;
  // Who must have signed the certificate, which must be of the address. Empty: any certificate will
  // do, as for a gateway that asks itself.
  std::string ca_file = {};
  absl::Duration timeout = absl::Seconds(4);
};

// OK if the gateway and its coordinator are well. UNAVAILABLE says what the gateway answers, or
// that nobody does. Blocks.
absl::Status AskHealth(const HealthRequest& request);

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_HEALTH_REQUEST_H_
