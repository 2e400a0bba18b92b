// One request of a browser while it is answered: its cancellation, and its identity, which is
// passed to the coordinator and to log lines.

#ifndef ISOSCOPE_WEB_GATEWAY_API_REQUEST_SCOPE_H_
#define ISOSCOPE_WEB_GATEWAY_API_REQUEST_SCOPE_H_

#include <utility>

#include "core/base/cancellation.h"
#include "core/base/trace_context.h"

namespace isoscope::gateway {

// Thread-safe.
class RequestScope final : public base::Cancellation {
 public:
  RequestScope() : RequestScope(base::TraceContext::Random()) {}
  explicit RequestScope(base::TraceContext identity) : identity_(std::move(identity)) {}

  [[nodiscard]] const base::TraceContext& identity() const { return identity_; }

 private:
  const base::TraceContext identity_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_REQUEST_SCOPE_H_
