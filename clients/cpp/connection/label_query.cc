#include "clients/cpp/connection/label_query.h"

#include <algorithm>
#include <optional>
#include <string>
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
constexpr const char* kValuesFeature = "label_values";
constexpr const char* kSmoothFeature = "smooth_labels";
constexpr int kMaxBins = 4096;     // as many as there are exact ones
constexpr int kMaxValues = 65536;  // as many labels as a dataset has names of

}  // namespace

absl::Status ResolveLabels(const isoscope::v1::Dataset& dataset, const SelectionFlags& selection,
                           absl::Duration timeout, ServiceClient* client, LabelFlags* flags,
                           std::size_t max_surfaces) {
  if (flags->empty()) {
    return absl::OkStatus();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetCapabilitiesResponse capabilities,
                            client->GetCapabilities(timeout));
  const auto& features = capabilities.features();
  const auto has = [&](const char* feature) {
    return std::find(features.begin(), features.end(), feature) != features.end();
  };
  if (!has(kFeature)) {
    return absl::FailedPreconditionError(
        absl::StrCat("the server, version ", capabilities.version(),
                     ", does not know surfaces of labels: it is older than this program"));
  }
  if (flags->smooths && !has(kSmoothFeature)) {
    return absl::FailedPreconditionError(
        absl::StrCat("--smooth-labels: the server, version ", capabilities.version(),
                     ", does not smooth labels: it is older than this program"));
  }
  std::optional<std::vector<double>> present;
  std::string why;
  if (flags->wants_all) {
    const isoscope::v1::Dataset field_dataset = DatasetOfField(dataset, selection);
    isoscope::v1::GetHistogramRequest request;
    request.set_dataset(dataset.name());
    request.set_max_bin_count(kMaxBins);
    if (!HasExactBins(field_dataset) && has(kValuesFeature)) {
      request.set_max_label_value_count(kMaxValues);
    }
    if (const auto proto = ToProto(selection)) {
      *request.mutable_selection() = *proto;
    }
    ISOSCOPE_ASSIGN_OR_RETURN(const isoscope::v1::GetHistogramResponse histogram,
                              client->GetHistogram(request, timeout));
    present = PresentValues(field_dataset, histogram);
    why = WhyNoLabels(histogram);
  }
  return ResolveLabels(dataset, present, flags, max_surfaces, why);
}

}  // namespace isoscope::client
