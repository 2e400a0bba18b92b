// DatasetService: returns the last state of the registry, and asks the agents for histograms.

#ifndef ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_
#define ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_

#include <memory>

#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "server/admission/admission.h"
#include "server/call/public_call.h"
#include "server/frame/coordinator_state.h"

namespace isoscope::server {

// Thread-safe. Destroy it only after its server has shut down.
class DatasetServiceImpl final : public isoscope::v1::DatasetService::CallbackService {
 public:
  static constexpr int kMaxConcurrentHistograms = 2;
  static constexpr int kMaxQueuedHistograms = 32;
  // The limits of calls that ask for the values of labels, for which agents read all samples.
  static constexpr int kMaxConcurrentLabelValues = 2;
  static constexpr int kMaxQueuedLabelValues = 32;

  // The state outlives the service.
  explicit DatasetServiceImpl(CoordinatorState* state)
      : state_(*state),
        histograms_({.limits = {.max_working = kMaxConcurrentHistograms,
                                .max_waiting = kMaxQueuedHistograms},
                     .noun = "histogram",
                     .flags = ""}),
        label_values_({.limits = {.max_working = kMaxConcurrentLabelValues,
                                  .max_waiting = kMaxQueuedLabelValues},
                       .noun = "query of label values",
                       .flags = ""}) {}

  grpc::ServerUnaryReactor* ListDatasets(grpc::CallbackServerContext* context,
                                         const isoscope::v1::ListDatasetsRequest* request,
                                         isoscope::v1::ListDatasetsResponse* response) override;
  grpc::ServerUnaryReactor* GetDataset(grpc::CallbackServerContext* context,
                                       const isoscope::v1::GetDatasetRequest* request,
                                       isoscope::v1::GetDatasetResponse* response) override;
  grpc::ServerUnaryReactor* GetHistogram(grpc::CallbackServerContext* context,
                                         const isoscope::v1::GetHistogramRequest* request,
                                         isoscope::v1::GetHistogramResponse* response) override;

 private:
  class HistogramCall;

  absl::Status AnswerHistogram(const isoscope::v1::GetHistogramRequest& request,
                               const base::Cancellation& cancellation, PublicCall* call,
                               isoscope::v1::GetHistogramResponse* response);

  CoordinatorState& state_;
  // These come last: their threads use the members above. No histogram waits for labels.
  Admission histograms_;
  Admission label_values_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_
