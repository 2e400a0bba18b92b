#include "server/dataset_service_impl.h"

#include "core/base/status_macros.h"
#include "core/rpc/unary_call.h"

namespace isoscope::server {

grpc::ServerUnaryReactor* DatasetServiceImpl::ListDatasets(
    grpc::CallbackServerContext* context, const isoscope::v1::ListDatasetsRequest* request,
    isoscope::v1::ListDatasetsResponse* response) {
  return rpc::AnswerUnary(context, *request, [&] {
    for (const auto& [name, state] : registry_->datasets()) {
      if (state.is_served) {
        *response->add_datasets() = state.dataset;
      }
    }
    return absl::OkStatus();
  });
}

grpc::ServerUnaryReactor* DatasetServiceImpl::GetDataset(
    grpc::CallbackServerContext* context, const isoscope::v1::GetDatasetRequest* request,
    isoscope::v1::GetDatasetResponse* response) {
  return rpc::AnswerUnary(context, *request, [&]() -> absl::Status {
    ISOSCOPE_ASSIGN_OR_RETURN(const DatasetState state, registry_->Find(request->name()));
    *response->mutable_dataset() = state.dataset;
    return absl::OkStatus();
  });
}

}  // namespace isoscope::server
