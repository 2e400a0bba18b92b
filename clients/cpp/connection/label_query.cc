#include "clients/cpp/connection/label_query.h"

#include <algorithm>
#include <optional>
#include <vector>

#include "absl/strings/str_cat.h"

#include "clients/cpp/connection/service_client.h"
#include "clients/cpp/request/dataset_fields.h"
#include "core/base/status_macros.h"
#include "isoscope/v1/cluster_service.pb.h"
#include "isoscope/v1/dataset_service.pb.h"

namespace isoscope::client {
namespace {

constexpr const char* kFeature = "labels";
constexpr int kMaxBins = 4096;  // as many as there are exact ones

}  // namespace

absl::Status ResolveLabels(const isoscope::v1::Dataset& dataset, const SelectionFlags& selection,
                           absl::Duration timeout, ServiceClient* client, LabelFlags* flags) {
  if (flags->empty()) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetCapabilitiesResponse capabilities,
                            client->GetCapabilities(timeout));
  const auto& features = capabilities.features();
  if (std::find(features.begin(), features.end(), kFeature) == features.end()) {
    return absl::FailedPreconditionError(
        absl::StrCat("the server, version ", capabilities.version(),
                     ", does not know surfaces of labels: it is older than this program"));
  }
  std::optional<std::vector<double>> present;
  if (flags->wants_all) {
    isoscope::v1::GetHistogramRequest request;
    request.set_dataset(dataset.name());
    request.set_max_bin_count(kMaxBins);
    if (const auto proto = ToProto(selection)) {
      *request.mutable_selection() = *proto;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetHistogramResponse histogram,
                              client->GetHistogram(request, timeout));
    present = PresentValues(DatasetOfField(dataset, selection), histogram);
  }
  return ResolveLabels(dataset, present, flags);
}

}  // namespace isoscope::client
