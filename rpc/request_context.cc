#include "rpc/request_context.h"

#include <iterator>

#include "absl/strings/string_view.h"

namespace isoscope::rpc {

base::TraceContext TraceContextOf(const grpc::ServerContextBase& context) {
  const auto [begin, end] = context.client_metadata().equal_range(kTraceparentKey);
  if (begin == end || std::next(begin) != end) {
    return base::TraceContext::Random();
  }
  return base::TraceContext::ParseOrRandom(
      absl::string_view(begin->second.data(), begin->second.size()));
}

base::TraceContext AnswerTraceContext(grpc::ServerContextBase* context) {
  base::TraceContext identity = TraceContextOf(*context);
  context->AddTrailingMetadata(kRequestIdKey, identity.request_id());
  return identity;
}

void SetTraceparent(const base::TraceContext& identity, grpc::ClientContext* context) {
  context->AddMetadata(kTraceparentKey, identity.MakeTraceparent());
}

std::string RequestIdOf(const grpc::ClientContext& context) {
  const auto& trailing = context.GetServerTrailingMetadata();
  const auto found = trailing.find(kRequestIdKey);
  return found == trailing.end() ? std::string()
                                 : std::string(found->second.data(), found->second.size());
}

}  // namespace isoscope::rpc
