// Tells agents that a frame has ended whose other calls they wait for (BeginFrame.others_follow): its
// client has left, an agent has failed, or nothing was left to draw. Only agents that stop wait. They
// give up by themselves, but later.

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_ENDS_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_ENDS_H_

#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"

#include "core/base/mutex.h"
#include "core/base/trace_context.h"
#include "server/cluster/frame_part.h"

namespace isoscope::server {

// The agents that wait for another call of one frame. Thread-compatible.
class FollowingCalls {
 public:
  // A call of the frame begins on an agent, and says whether others follow.
  void Note(const AgentAssignment& agent, bool others_follow);
  // Returns the agents whose last call said that others follow, by address, and forgets them.
  std::vector<AgentAssignment> TakeWaiting();

 private:
  std::map<std::string, AgentAssignment> waiting_;  // by address
};

// Thread-safe.
class FrameEnds {
 public:
  // An agent that has not answered by then is told no more.
  static constexpr absl::Duration kMaxDuration = absl::Seconds(1);
  // Beyond it agents are not told.
  static constexpr std::size_t kMaxCalls = 256;

  FrameEnds();
  // Waits until all were told.
  ~FrameEnds();
  FrameEnds(const FrameEnds&) = delete;
  FrameEnds& operator=(const FrameEnds&) = delete;

  // Tells the agents that wait, which are forgotten. Does not wait for them, and nobody learns of
  // errors.
  void Tell(FollowingCalls* calls, const base::TraceContext& request, std::int64_t frame_number)
      ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  class Call;
  using Calls = std::list<std::unique_ptr<Call>>;

  void Tell(const AgentAssignment& agent, const base::TraceContext& request,
            std::int64_t frame_number) ABSL_LOCKS_EXCLUDED(mutex_);

  base::Mutex mutex_;
  base::CondVar ended_;
  Calls calls_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_ENDS_H_
