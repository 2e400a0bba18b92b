// InteractService over gRPC's callback API. What is drawn and when is decided by
// interactive_schedule, how finely by rate_control; frames are FrameCalls, as those of
// IsosurfaceService.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_

#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"

#include "core/base/mutex.h"
#include "isoscope/v1/interact_service.grpc.pb.h"
#include "server/access/access_control.h"
#include "server/frame/frame_runner.h"

namespace isoscope::server {

struct InteractServiceOptions {
  FrameRunner* runner = nullptr;    // outlives the service
  AccessControl* access = nullptr;  // outlives the service, too
  absl::Duration max_frame_duration = absl::Minutes(5);
};

// Thread-safe. Destroy it only after its server has shut down. An idle stream holds no thread.
class InteractServiceImpl final : public isoscope::v1::InteractService::CallbackService {
 public:
  static constexpr std::size_t kMaxStreams = 256;

  explicit InteractServiceImpl(const InteractServiceOptions& options);
  ~InteractServiceImpl() override;

  grpc::ServerBidiReactor<isoscope::v1::InteractRequest, isoscope::v1::InteractResponse>* Interact(
      grpc::CallbackServerContext* context) override;

  // A caller (Caller::HostKey) may have all streams while nobody else wants one. Then its newest
  // ends for a caller that has at least two fewer.

  // Ends all streams with UNAVAILABLE, now and later. For a server that stops: its clients would
  // keep the streams open.
  void EndStreams() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  class InteractCall;

  // RESOURCE_EXHAUSTED if there are too many streams, UNAVAILABLE if the server stops. Ends
  // another's stream if that makes room.
  absl::Status Add(const std::string& key, const std::shared_ptr<InteractCall>& call)
      ABSL_LOCKS_EXCLUDED(mutex_);
  void Remove(const std::string& key, const std::shared_ptr<InteractCall>& call)
      ABSL_LOCKS_EXCLUDED(mutex_);

  const InteractServiceOptions options_;
  base::Mutex mutex_;
  // By caller, in the order of their arrival. No list is empty.
  std::map<std::string, std::vector<std::shared_ptr<InteractCall>>> calls_ ABSL_GUARDED_BY(mutex_);
  std::size_t call_count_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_SERVICE_IMPL_H_
