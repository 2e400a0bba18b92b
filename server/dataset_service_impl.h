// DatasetService: returns the last state of the registry, and asks the agents for histograms.

#ifndef ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_
#define ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_

#include <memory>

#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/base/trace_context.h"
#include "isoscope/v1/dataset_service.grpc.pb.h"
#include "server/access/access_control.h"
#include "server/access/audit_log.h"
#include "server/admission/admission.h"
#include "server/cluster/agent_registry.h"
#include "server/frame/frame_runner.h"

namespace isoscope::server {

// Thread-safe. `registry` and `access` outlive it. Destroy it only after its server has shut down.
class DatasetServiceImpl final : public isoscope::v1::DatasetService::CallbackService {
 public:
  static constexpr int kMaxConcurrentHistograms = 2;
  static constexpr int kMaxQueuedHistograms = 32;
  // Of calls that ask for the values of labels, for which agents read all samples.
  static constexpr int kMaxConcurrentLabelValues = 2;
  static constexpr int kMaxQueuedLabelValues = 32;

  // All of them outlive the service.
  DatasetServiceImpl(AgentRegistry* registry, AccessControl* access, FrameRunner* runner)
      : registry_(registry),
        access_(access),
        runner_(runner),
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
                               const Caller& caller, const base::TraceContext& identity,
                               const base::Cancellation& cancellation, AuditRecord* record,
                               isoscope::v1::GetHistogramResponse* response);

  AgentRegistry* const registry_;
  AccessControl* const access_;
  FrameRunner* const runner_;
  // These come last: their threads use the members above. No histogram waits for labels.
  Admission histograms_;
  Admission label_values_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_DATASET_SERVICE_IMPL_H_
