// One stream of InteractService.Interact, for one viewer.

#ifndef ISOSCOPE_WEB_GATEWAY_API_INTERACT_STREAM_H_
#define ISOSCOPE_WEB_GATEWAY_API_INTERACT_STREAM_H_

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"

#include "core/base/trace_context.h"
#include "web-gateway/api/coordinator_client.h"

namespace isoscope::v1 {
class InteractRequest;
class InteractResponse;
}  // namespace isoscope::v1

namespace isoscope::gateway {

// Thread-safe. A newer state replaces one that was not sent yet. All acknowledged frames are
// reported, before the state.
class InteractStream {
 public:
  // Called by threads of gRPC, one at a time and in order; it must not block.
  using OnResponse = std::function<void(isoscope::v1::InteractResponse)>;
  // Called once, after the last response; OK if the coordinator ended the stream.
  using OnEnd = std::function<void(const absl::Status&)>;

  // The most reports that wait to be sent; more end the stream with INVALID_ARGUMENT.
  static constexpr std::size_t kMaxWaitingReports = 256;

  // Opens the stream at once, with the identity of the viewer's request. `client` outlives it and
  // all of its calls. `token`: the user's, or empty.
  static std::shared_ptr<InteractStream> Open(CoordinatorClient* client, const std::string& token,
                                              const base::TraceContext& identity,
                                              OnResponse on_response, OnEnd on_end);

  // Queues a message. Does nothing once the stream has ended.
  virtual void Send(isoscope::v1::InteractRequest request) = 0;
  // Ends the stream soon; OnEnd is still called.
  virtual void Cancel() = 0;

 protected:
  virtual ~InteractStream() = default;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_INTERACT_STREAM_H_
