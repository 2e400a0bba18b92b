// DatasetService. It answers with the last state of the registry.

#ifndef ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_
#define ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_

#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "server/agent_registry.h"

namespace isoscope::server {

// Thread-safe. `registry` outlives it.
class DatasetServiceImpl final : public isoscope::v1::DatasetService::CallbackService {
 public:
  explicit DatasetServiceImpl(const AgentRegistry* registry) : registry_(registry) {}

  grpc::ServerUnaryReactor* ListDatasets(grpc::CallbackServerContext* context,
                                         const isoscope::v1::ListDatasetsRequest* request,
                                         isoscope::v1::ListDatasetsResponse* response) override;
  grpc::ServerUnaryReactor* GetDataset(grpc::CallbackServerContext* context,
                                       const isoscope::v1::GetDatasetRequest* request,
                                       isoscope::v1::GetDatasetResponse* response) override;

 private:
  const AgentRegistry* const registry_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_
