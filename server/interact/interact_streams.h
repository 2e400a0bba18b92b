// The interactive streams that are open. A caller (Caller::HostKey) may have all of them while
// nobody else wants one. Then its newest ends for a caller that has at least two fewer. No gRPC.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_STREAMS_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_STREAMS_H_

#include <cstddef>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"

#include "core/base/mutex.h"
#include "server/metrics/coordinator_metrics.h"

namespace isoscope::server {

// A stream, as others see it. Thread-safe.
class OpenStream {
 public:
  virtual ~OpenStream() = default;
  // Ends the stream although its client wants it, and waits little for what is on its way.
  virtual void CutOff(CutReason reason, const absl::Status& status) = 0;
  // Lets the frames in work stop, and ends the stream once they have.
  virtual void End(const absl::Status& status) = 0;
};

// Thread-safe. Ends streams without a lock of its own.
class InteractStreams {
 public:
  static constexpr std::size_t kMaxStreams = 256;

  // RESOURCE_EXHAUSTED if there are too many streams, UNAVAILABLE if the server stops. Ends
  // another's stream if that makes room.
  absl::Status Add(const std::string& caller, const std::shared_ptr<OpenStream>& stream)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Does nothing to a stream that made room, or was not added.
  void Remove(const std::string& caller, const std::shared_ptr<OpenStream>& stream)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Ends all streams with UNAVAILABLE, now and later.
  void EndAll() ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  using Streams = std::vector<std::shared_ptr<OpenStream>>;

  base::Mutex mutex_;
  // By caller, in the order of their arrival. No list is empty.
  std::map<std::string, Streams> streams_ ABSL_GUARDED_BY(mutex_);
  std::size_t count_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_STREAMS_H_
