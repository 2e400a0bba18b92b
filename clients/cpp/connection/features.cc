#include "clients/cpp/connection/features.h"

#include "clients/cpp/connection/service_client.h"
#include "core/base/status_macros.h"
#include "isoscope/v1/cluster_service.pb.h"

namespace isoscope::client {

absl::StatusOr<Features> FeaturesOf(absl::Duration timeout, ServiceClient* client) {
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetCapabilitiesResponse capabilities,
                            client->GetCapabilities(timeout));
  return Features(capabilities.features().begin(), capabilities.features().end());
}

absl::StatusOr<bool> HasFeature(absl::string_view feature, absl::Duration timeout,
                                ServiceClient* client) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Features features, FeaturesOf(timeout, client));
  return features.count(std::string(feature)) > 0;
}

}  // namespace isoscope::client
