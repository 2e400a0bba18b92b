#include "server/call/public_call.h"

#include <utility>

#include "core/base/status_macros.h"
#include "rpc/channel.h"
#include "rpc/grpc_status.h"
#include "rpc/request_context.h"
#include "wire/known_fields.h"

namespace isoscope::server {

PublicCall::PublicCall(CallDesk* desk, RequestMethod method, grpc::CallbackServerContext* context,
                       base::ForeignText dataset)
    : desk_(*desk),
      method_(method),
      deadline_(rpc::DeadlineOf(*context)),
      peer_(rpc::PeerOf(*context)),
      origin_{.request = rpc::AnswerTraceContext(context), .client = context->peer()},
      unsent_(&desk->metrics.unsent_bytes),
      timeout_(context),
      record_(RecordOf(peer_, origin_.client)) {
  record_.dataset = std::move(dataset);
}

absl::Status PublicCall::Identify() {
  ISOSCOPE_ASSIGN_OR_RETURN(origin_.caller, desk_.access->Identify(peer_));
  const base::MutexLock lock(&mutex_);
  record_.caller = origin_.caller.name();
  return absl::OkStatus();
}

void PublicCall::NoteDataset(CallDataset dataset) {
  const base::MutexLock lock(&mutex_);
  record_.dataset = std::move(dataset.name);
  record_.dataset_id = std::move(dataset.id);
}

void PublicCall::Audit(const absl::Status& status) const {
  if (desk_.audit == nullptr) {
    return;
  }
  AuditRecord record;
  {
    const base::MutexLock lock(&mutex_);
    record = record_;
  }
  desk_.audit->Write(NameOf(method_), record, origin_.request.request_id(), status);
}

grpc::Status PublicCall::End(const absl::Status& status) {
  desk_.metrics.CountRequest(method_, status, base::MonotonicNow() - arrival_);
  Audit(status);
  return rpc::ToGrpcStatus(status);
}

grpc::ServerUnaryReactor* AnswerAtOnce(CallDesk* desk, RequestMethod method,
                                       grpc::CallbackServerContext* context,
                                       const google::protobuf::Message& request,
                                       const std::string& dataset,
                                       absl::FunctionRef<absl::Status(PublicCall* call)> answer) {
  PublicCall call(desk, method, context, dataset);
  absl::Status status = wire::CheckKnownFields(request);
  if (status.ok()) {
    status = answer(&call);
  }
  grpc::ServerUnaryReactor* const reactor = context->DefaultReactor();
  reactor->Finish(call.End(status));
  return reactor;
}

}  // namespace isoscope::server
