// The features of a server beyond its first version (GetCapabilities.features).

#ifndef ISOSCOPE_CLIENTS_CPP_CONNECTION_FEATURES_H_
#define ISOSCOPE_CLIENTS_CPP_CONNECTION_FEATURES_H_

#include <set>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

namespace isoscope::client {

class ServiceClient;

// What a server can do beyond its first version.
using Features = std::set<std::string>;
// Errors of ServiceClient::GetCapabilities.
absl::StatusOr<Features> FeaturesOf(absl::Duration timeout, ServiceClient* client);

// Returns false if the server is older than the feature; proto/README.md lists them. Errors of
// ServiceClient::GetCapabilities.
absl::StatusOr<bool> HasFeature(absl::string_view feature, absl::Duration timeout,
                                ServiceClient* client);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_CONNECTION_FEATURES_H_
