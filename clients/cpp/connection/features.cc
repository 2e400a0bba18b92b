#include "clients/cpp/connection/features.h"

#include <algorithm>

#include "clients/cpp/connection/service_client.h"
#include "core/base/status_macros.h"
#include "isoscope/v1/cluster_service.pb.h"

namespace isoscope::client {

absl::StatusOr<bool> HasFeature(absl::string_view feature, absl::Duration timeout,
                                ServiceClient* client) {
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetCapabilitiesResponse capabilities,
                            client->GetCapabilities(timeout));
  const auto& features = capabilities.features();
  return std::find(features.begin(), features.end(), feature) != features.end();
}

}  // namespace isoscope::client
