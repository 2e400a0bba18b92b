#include "server/dataset_service_impl.h"

#include <utility>
#include <vector>

#include "absl/time/time.h"

#include "core/base/status_macros.h"
#include "core/rpc/histogram_convert.h"
#include "core/rpc/peer.h"
#include "core/rpc/proto_convert.h"
#include "core/volume/isovalue_suggestions.h"
#include "core/volume/sample_histogram.h"
#include "server/frame/agent_queries.h"

namespace isoscope::server {
namespace {

// Of a call without a deadline.
constexpr absl::Duration kMaxHistogramDuration = absl::Minutes(1);

}  // namespace

grpc::ServerUnaryReactor* DatasetServiceImpl::ListDatasets(
    grpc::CallbackServerContext* context, const isoscope::v1::ListDatasetsRequest* request,
    isoscope::v1::ListDatasetsResponse* response) {
  return rpc::AnswerUnary(
      context, *request,
      [&]() -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(const Caller caller, access_->Identify(rpc::PeerOf(*context)));
        for (const auto& [name, state] : registry_->datasets(caller)) {
          if (state.is_served) {
            *response->add_datasets() = state.dataset;
          }
        }
        return absl::OkStatus();
      },
      Counter(RequestMethod::kListDatasets));
}

grpc::ServerUnaryReactor* DatasetServiceImpl::GetDataset(
    grpc::CallbackServerContext* context, const isoscope::v1::GetDatasetRequest* request,
    isoscope::v1::GetDatasetResponse* response) {
  return rpc::AnswerUnary(
      context, *request,
      [&]() -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(const Caller caller, access_->Identify(rpc::PeerOf(*context)));
        ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const DatasetState> state,
                                  registry_->Find(request->name(), caller));
        *response->mutable_dataset() = state->dataset;
        return absl::OkStatus();
      },
      Counter(RequestMethod::kGetDataset));
}

grpc::ServerUnaryReactor* DatasetServiceImpl::GetHistogram(
    grpc::CallbackServerContext* context, const isoscope::v1::GetHistogramRequest* request,
    isoscope::v1::GetHistogramResponse* response) {
  absl::StatusOr<Caller> caller = access_->Identify(rpc::PeerOf(*context));
  if (!caller.ok()) {
    return rpc::AnswerUnary(
        context, *request, [&] { return caller.status(); }, Counter(RequestMethod::kGetHistogram));
  }
  return rpc::UnaryTask::Start(
      context, *request, &executor_, kMaxHistogramDuration,
      [this, request, response, caller = *std::move(caller)](const base::Cancellation& cancellation,
                                                             const base::TraceContext& identity) {
        return AnswerHistogram(*request, caller, identity, cancellation, response);
      },
      Counter(RequestMethod::kGetHistogram));
}

rpc::OnCallEnd DatasetServiceImpl::Counter(RequestMethod method) const {
  return
      [metrics = runner_->metrics(), method](const absl::Status& status, absl::Duration duration) {
        metrics->CountRequest(method, status, duration);
      };
}

absl::Status DatasetServiceImpl::AnswerHistogram(const isoscope::v1::GetHistogramRequest& request,
                                                 const Caller& caller,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation,
                                                 isoscope::v1::GetHistogramResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(const rpc::HistogramQuery query, rpc::HistogramQueryFromProto(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const DatasetState> found,
                            registry_->FindComplete(request.dataset(), cancellation, caller));
  const DatasetState& dataset = *found;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::ScalarType type,
      rpc::ScalarTypeFromProto(dataset.dataset.sample_type(), "dataset.sample_type"));
  const std::vector<FramePart> parts = runner_->PartsOf(dataset);
  const QueryOutcome<volume::HistogramPart> outcome =
      AskHistogram({dataset.dataset.dataset_id(), parts}, query, identity, cancellation);
  runner_->ReportQuery(identity, outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  const volume::HistogramPart& whole = *outcome.result;
  std::vector<volume::IsovalueSuggestion> suggestions;
  if (whole.samples.has_value() && whole.groups.count > 0) {
    suggestions = volume::SuggestIsovalues(type, *whole.samples, whole.groups.begin,
                                           whole.groups.EndOf(whole.groups.count - 1));
  }
  *response = rpc::ToProto(whole, suggestions);
  return absl::OkStatus();
}

}  // namespace isoscope::server
