#include "server/dataset_service_impl.h"

#include "core/rpc/grpc_status.h"

namespace isoscope::server {

grpc::ServerUnaryReactor* DatasetServiceImpl::ListDatasets(
    grpc::CallbackServerContext* context, const isoscope::v1::ListDatasetsRequest* /*request*/,
    isoscope::v1::ListDatasetsResponse* response) {
  for (const auto& [name, state] : registry_->datasets()) {
    if (state.is_served) {
      *response->add_datasets() = state.dataset;
    }
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(grpc::Status::OK);
  return reactor;
}

grpc::ServerUnaryReactor* DatasetServiceImpl::GetDataset(
    grpc::CallbackServerContext* context, const isoscope::v1::GetDatasetRequest* request,
    isoscope::v1::GetDatasetResponse* response) {
  const absl::StatusOr<DatasetState> state = registry_->Find(request->name());
  if (state.ok()) {
    *response->mutable_dataset() = state->dataset;
  }
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  reactor->Finish(rpc::ToGrpcStatus(state.status()));
  return reactor;
}

}  // namespace isoscope::server
