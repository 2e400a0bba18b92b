#include "server/dataset_service_impl.h"

#include <memory>
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
#include "server/page.h"

namespace isoscope::server {
namespace {

// Of a call without a deadline.
constexpr absl::Duration kMaxHistogramDuration = absl::Minutes(1);

}  // namespace

grpc::ServerUnaryReactor* DatasetServiceImpl::ListDatasets(
    grpc::CallbackServerContext* context, const isoscope::v1::ListDatasetsRequest* request,
    isoscope::v1::ListDatasetsResponse* response) {
  const auto record =
      std::make_shared<AuditRecord>(RecordOf(rpc::PeerOf(*context), context->peer()));
  return rpc::AnswerUnary(
      context, *request,
      [&]() -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(const Caller caller, access_->Identify(rpc::PeerOf(*context)));
        record->caller = caller.name();
        ISOSCOPE_ASSIGN_OR_RETURN(
            Page page, Page::Make("datasets", request->page_size(), request->page_token()));
        for (const auto& [name, state] : registry_->datasets(caller)) {
          if (state.is_served && page.Offer(name)) {
            *response->add_datasets() = state.dataset;
          }
        }
        response->set_next_page_token(page.next_token());
        return absl::OkStatus();
      },
      Counter(RequestMethod::kListDatasets, record));
}

grpc::ServerUnaryReactor* DatasetServiceImpl::GetDataset(
    grpc::CallbackServerContext* context, const isoscope::v1::GetDatasetRequest* request,
    isoscope::v1::GetDatasetResponse* response) {
  const auto record =
      std::make_shared<AuditRecord>(RecordOf(rpc::PeerOf(*context), context->peer()));
  record->dataset = request->name();
  return rpc::AnswerUnary(
      context, *request,
      [&]() -> absl::Status {
        ISOSCOPE_ASSIGN_OR_RETURN(const Caller caller, access_->Identify(rpc::PeerOf(*context)));
        record->caller = caller.name();
        ISOSCOPE_ASSIGN_OR_RETURN(const DatasetState state,
                                  registry_->Find(request->name(), caller));
        record->dataset = state.dataset.name();
        record->dataset_id = state.dataset.dataset_id();
        *response->mutable_dataset() = state.dataset;
        return absl::OkStatus();
      },
      Counter(RequestMethod::kGetDataset, record));
}

grpc::ServerUnaryReactor* DatasetServiceImpl::GetHistogram(
    grpc::CallbackServerContext* context, const isoscope::v1::GetHistogramRequest* request,
    isoscope::v1::GetHistogramResponse* response) {
  const auto record =
      std::make_shared<AuditRecord>(RecordOf(rpc::PeerOf(*context), context->peer()));
  record->dataset = request->dataset();
  absl::StatusOr<Caller> caller = access_->Identify(rpc::PeerOf(*context));
  if (!caller.ok()) {
    return rpc::AnswerUnary(
        context, *request, [&] { return caller.status(); },
        Counter(RequestMethod::kGetHistogram, record));
  }
  record->caller = caller->name();
  return rpc::UnaryTask::Start(
      context, *request, &executor_, kMaxHistogramDuration,
      [this, request, response, record, caller = *std::move(caller)](
          const base::Cancellation& cancellation, const base::TraceContext& identity) {
        return AnswerHistogram(*request, caller, identity, cancellation, record.get(), response);
      },
      Counter(RequestMethod::kGetHistogram, record));
}

rpc::OnCallEnd DatasetServiceImpl::Counter(RequestMethod method,
                                           std::shared_ptr<AuditRecord> record) const {
  return
      [runner = runner_, method, record = std::move(record)](
          const absl::Status& status, absl::Duration duration, const base::TraceContext& identity) {
        runner->EndRequest(method, *record, identity, status, duration);
      };
}

absl::Status DatasetServiceImpl::AnswerHistogram(const isoscope::v1::GetHistogramRequest& request,
                                                 const Caller& caller,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation,
                                                 AuditRecord* record,
                                                 isoscope::v1::GetHistogramResponse* response) {
  ISOSCOPE_ASSIGN_OR_RETURN(const rpc::HistogramQuery query, rpc::HistogramQueryFromProto(request));
  ISOSCOPE_ASSIGN_OR_RETURN(const DatasetState dataset,
                            registry_->FindComplete(request.dataset(), cancellation, caller));
  record->dataset = dataset.dataset.name();
  record->dataset_id = dataset.dataset.dataset_id();
  ISOSCOPE_RETURN_IF_ERROR(CheckDatasetId(dataset.dataset, request.dataset_id()));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::ScalarType type,
      rpc::ScalarTypeFromProto(dataset.dataset.sample_type(), "dataset.sample_type"));
  const std::vector<FramePart> parts = runner_->PartsOf(dataset);
  const QueryOutcome<volume::HistogramPart> outcome =
      AskHistogram({dataset.dataset.dataset_id(), parts}, query, identity, cancellation);
  runner_->ReportFailures(identity, /*frame_number=*/0, outcome.failures);
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
