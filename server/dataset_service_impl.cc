// ListDatasets and GetDataset answer at once, from the registry. GetHistogram is work
// (HistogramCall), with a queue of its own; requests for label values read all samples, and have
// another queue. A histogram takes these steps:
//
// 1. Admit: identify the caller, check the request, take a place in the queue.
// 2. When its turn comes, AnswerHistogram finds the dataset and the selected volume.
// 3. AskHistogram asks one agent for each part, and adds up the bins.
// 4. SuggestIsovalues looks for isovalues in the sum, if groups were asked for, and SuggestLabels
//    for labels.
//
// The place is given back before the answer, so that the client's next request finds it free.

#include "server/dataset_service_impl.h"

#include <algorithm>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/base/no_memory.h"
#include "core/base/status_macros.h"
#include "core/volume/isovalue_suggestions.h"
#include "core/volume/label.h"
#include "core/volume/label_suggestion.h"
#include "core/volume/sample_histogram.h"
#include "server/call/call_work.h"
#include "server/frame/agent_queries.h"
#include "server/page.h"
#include "wire/histogram_convert.h"
#include "wire/known_fields.h"
#include "wire/proto_convert.h"

namespace isoscope::server {
namespace {

// The limits of a call without a deadline; the second one is that of a call that reads samples.
constexpr absl::Duration kMaxHistogramDuration = absl::Minutes(1);
constexpr absl::Duration kMaxValuesDuration = absl::Hours(1);

// Names win: a dataset may be called as another one's id.
absl::StatusOr<std::shared_ptr<const DatasetState>> FindByNameOrId(const AgentRegistry& registry,
                                                                   const std::string& name,
                                                                   const Caller& caller) {
  absl::StatusOr<std::shared_ptr<const DatasetState>> found = registry.Find(name, caller);
  if (absl::IsNotFound(found.status())) {
    for (auto& [other, state] : registry.datasets(caller)) {
      if (state.is_served && state.dataset.dataset_id() == name) {
        found = std::make_shared<const DatasetState>(state);
      }
    }
  }
  return found;
}

}  // namespace

// A histogram call, which queues for its turn as frames do. It owns itself until gRPC is done with
// it.
class DatasetServiceImpl::HistogramCall final : public grpc::ServerUnaryReactor {
 public:
  static HistogramCall* Start(DatasetServiceImpl* service, grpc::CallbackServerContext* context,
                              const isoscope::v1::GetHistogramRequest* request,
                              isoscope::v1::GetHistogramResponse* response) {
    const bool reads_samples = request->max_label_value_count() > 0;
    const std::shared_ptr<HistogramCall> call(
        new HistogramCall(service, context, request->dataset(),
                          reads_samples ? &service->label_values_ : &service->histograms_,
                          reads_samples ? kMaxValuesDuration : kMaxHistogramDuration));
    call->self_ = call;
    const absl::Status admitted = call->Admit(*request);
    if (!admitted.ok()) {
      call->End(admitted);
      return call.get();
    }
    call->work_.Schedule([call, request, response](const absl::Status& turn) {
      call->Run(turn, *request, response);
    });
    return call.get();
  }

  void OnCancel() override { work_.Cancel(); }
  void OnDone() override {
    call_.timeout().Stop();
    const std::shared_ptr<HistogramCall> last_use = std::move(self_);
  }

 private:
  HistogramCall(DatasetServiceImpl* service, grpc::CallbackServerContext* context,
                const std::string& dataset, Admission* admission, absl::Duration max_duration)
      : service_(*service),
        call_(&service->state_.calls, RequestMethod::kGetHistogram, context, dataset),
        work_(admission, std::min(call_.deadline(), call_.arrival() + max_duration)) {}

  absl::Status Admit(const isoscope::v1::GetHistogramRequest& request) {
    ISOSCOPE_RETURN_IF_ERROR(call_.Identify());
    ISOSCOPE_RETURN_IF_ERROR(wire::CheckKnownFields(request));
    return work_.TakePlace(call_.caller().QueueKey(call_.origin().client));
  }

  // `turn`: the reason if the turn did not come.
  void Run(const absl::Status& turn, const isoscope::v1::GetHistogramRequest& request,
           isoscope::v1::GetHistogramResponse* response) {
    const absl::Status status = base::OrNoMemory("the answer", [&] {
      return turn.ok() ? service_.AnswerHistogram(request, work_.cancellation(), &call_, response)
                       : turn;
    });
    work_.GiveBackPlace();  // before the answer, so that the next request finds the place free
    End(status);
  }

  void End(const absl::Status& status) { Finish(call_.End(status)); }

  DatasetServiceImpl& service_;
  PublicCall call_;
  CallWork work_;
  std::shared_ptr<HistogramCall> self_;  // reset by OnDone
};

grpc::ServerUnaryReactor* DatasetServiceImpl::ListDatasets(
    grpc::CallbackServerContext* context, const isoscope::v1::ListDatasetsRequest* request,
    isoscope::v1::ListDatasetsResponse* response) {
  const auto answer = [&](PublicCall* call) -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(call->Identify());
    ISOSCOPE_ASSIGN_OR_RETURN(Page page,
                              Page::Make("datasets", request->page_size(), request->page_token()));
    for (const auto& [name, state] : state_.registry->datasets(call->caller())) {
      if (state.is_served && page.Offer(name)) {
        *response->add_datasets() = state.dataset;
      }
    }
    response->set_next_page_token(page.next_token());
    return absl::OkStatus();
  };
  return AnswerAtOnce(&state_.calls, RequestMethod::kListDatasets, context, *request, "", answer);
}

grpc::ServerUnaryReactor* DatasetServiceImpl::GetDataset(
    grpc::CallbackServerContext* context, const isoscope::v1::GetDatasetRequest* request,
    isoscope::v1::GetDatasetResponse* response) {
  const auto answer = [&](PublicCall* call) -> absl::Status {
    ISOSCOPE_RETURN_IF_ERROR(call->Identify());
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const DatasetState> state,
                              FindByNameOrId(*state_.registry, request->name(), call->caller()));
    call->NoteDataset({.name = state->dataset.name(), .id = state->dataset.dataset_id()});
    *response->mutable_dataset() = state->dataset;
    if (!state->replica_sets.empty()) {
      response->set_picture_revision(frame::ToString(state->picture_revision));
    }
    return absl::OkStatus();
  };
  return AnswerAtOnce(&state_.calls, RequestMethod::kGetDataset, context, *request, request->name(),
                      answer);
}

grpc::ServerUnaryReactor* DatasetServiceImpl::GetHistogram(
    grpc::CallbackServerContext* context, const isoscope::v1::GetHistogramRequest* request,
    isoscope::v1::GetHistogramResponse* response) {
  return HistogramCall::Start(this, context, request, response);
}

absl::Status DatasetServiceImpl::AnswerHistogram(const isoscope::v1::GetHistogramRequest& request,
                                                 const base::Cancellation& cancellation,
                                                 PublicCall* call,
                                                 isoscope::v1::GetHistogramResponse* response) {
  // 2. Dataset and volume.
  ISOSCOPE_ASSIGN_OR_RETURN(const wire::HistogramQuery query,
                            wire::HistogramQueryFromProto(request));
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::shared_ptr<const DatasetState> found,
      state_.registry->FindComplete(request.dataset(), cancellation, call->caller()));
  call->NoteDataset({.name = found->dataset.name(), .id = found->dataset.dataset_id()});
  ISOSCOPE_RETURN_IF_ERROR(CheckDatasetId(found->dataset, request.dataset_id()));
  std::vector<frame::Surface> no_surfaces;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const SelectedVolume selected,
      SelectVolume(found, request.has_selection() ? &request.selection() : nullptr, &no_surfaces));
  const DatasetState& dataset = *selected.dataset;
  ISOSCOPE_ASSIGN_OR_RETURN(
      const volume::ScalarType type,
      wire::ScalarTypeFromProto(dataset.dataset.sample_type(), "dataset.sample_type"));
  // 3. The sum of the agents' histograms.
  const std::vector<FramePart> parts = state_.PartsOf(dataset);
  const QueryOutcome<volume::HistogramPart> outcome =
      AskHistogram({dataset.dataset.dataset_id(), parts}, query, call->request(), cancellation);
  state_.ReportQuery(call->request(), outcome.report);
  ISOSCOPE_RETURN_IF_ERROR(outcome.result.status());
  const volume::HistogramPart& whole = *outcome.result;
  // 4. Suggestions.
  std::vector<volume::IsovalueSuggestion> suggestions;
  if (whole.samples.has_value() && whole.groups.count > 0) {
    suggestions = volume::SuggestIsovalues(type, *whole.samples, whole.groups.begin,
                                           whole.groups.EndOf(whole.groups.count - 1));
  }
  std::vector<double> labels;
  if (whole.samples.has_value()) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::vector<volume::Label> named,
                              wire::LabelsFromProto(dataset.dataset.labels(), "dataset.labels"));
    labels = volume::SuggestLabels(type, *whole.samples, named);
  }
  *response = wire::ToProto(whole, suggestions, labels);
  if (selected.selection.has_value()) {
    *response->mutable_selection() = *selected.selection;
  }
  return absl::OkStatus();
}

}  // namespace isoscope::server
