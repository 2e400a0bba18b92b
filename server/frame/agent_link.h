// One agent's part in one frame, as the coordinator sees it. No gRPC types. agent_client makes
// links from streams, tests make them from FramePipeline.

#ifndef ISOSCOPE_SERVER_FRAME_AGENT_LINK_H_
#define ISOSCOPE_SERVER_FRAME_AGENT_LINK_H_

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/frame/agent_statistics.h"
#include "core/image/pixel_mailboxes.h"
#include "core/volume/block_layout.h"
#include "server/cluster/agent_failure.h"

namespace isoscope::server {

// Receives the events of an agent during a frame, in order of arrival. Any thread may call it, but
// one at a time for an agent. Functions must be quick and must not call back into the link.
class AgentListener {
 public:
  virtual ~AgentListener() = default;
  // `active`: the agent's own active blocks, ascending; empty unless they were asked for.
  virtual void OnRayHits(std::vector<volume::BlockId> hits,
                         std::vector<volume::BlockId> active) = 0;
  virtual void OnPixels(std::vector<std::string> bands) = 0;  // docs/format/wire.md
  // The same pixels from an agent of this process: all pixels of a step, as large as the picture.
  virtual void OnDrawnPixels(image::DrawnPixels pixels) = 0;
  virtual void OnOccludersDone() = 0;
  virtual void OnFrameDone(frame::AgentStatistics statistics) = 0;
  // The last call. OK only after OnFrameDone. Errors are those of AgentFailure::status.
  virtual void OnEnd(absl::Status status) = 0;
  // Calls `read` once, as soon as there is room for the agent's next message: before it returns, or
  // later on any thread. Not called after the end of the agent.
  virtual void WhenRoom(std::function<void()> read) { read(); }  // NOLINT: others keep it
};

// Thread-safe. Making the link has begun the frame.
class AgentLink {
 public:
  // Cancels the frame if it has not ended, and waits until OnEnd has returned.
  virtual ~AgentLink() = default;

  // Sends the agent the occluders to draw in step 2: blocks of its own, ascending.
  virtual void SendOccluders(const std::vector<volume::BlockId>& blocks) = 0;
  // Sends the blocks to draw in step 3, ascending, and visibility::EncodeOpenPixels of their open
  // pixels. Empty: all pixels are open.
  virtual void SendVisibleBlocks(const std::vector<volume::BlockId>& blocks,
                                 std::string open_pixels) = 0;
  // Stops the agent's work. OnEnd follows soon.
  virtual void Cancel() = 0;

  [[nodiscard]] virtual const AgentIdentity& agent() const = 0;
  // Returns the bytes of all messages so far, both ways; 0 for an agent of this process.
  [[nodiscard]] virtual std::int64_t network_bytes() const = 0;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_AGENT_LINK_H_
