// The messages of the WebSocket. Clients send InteractRequest as JSON. The gateway sends one binary
// message for each InteractResponse:
//
//   u32 little-endian   length of the JSON
//   JSON                InteractResponse without its bytes, and with
//                       "image": {"type": "image/jpeg", "bytes": N}, "depthBytes": M
//   N bytes             the picture, or the tile
//   M bytes             the depth grid: u16 little-endian, row by row

#ifndef ISOSCOPE_WEB_GATEWAY_API_FRAME_MESSAGE_H_
#define ISOSCOPE_WEB_GATEWAY_API_FRAME_MESSAGE_H_

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "isoscope/v1/interact_service.pb.h"

namespace isoscope::gateway {

// The longest message of a client, in bytes.
inline constexpr std::size_t kMaxRequestBytes = std::size_t{1} << 18;

std::string EncodeFrame(isoscope::v1::InteractResponse response);

// INVALID_ARGUMENT: no JSON of an InteractRequest, or neither a state nor an acknowledged frame.
absl::StatusOr<isoscope::v1::InteractRequest> DecodeInteractRequest(absl::string_view json);

// Whether an answer leaves those before it as they are: a tile, a deferred frame, an error. A frame
// takes the place of whatever came before.
bool AddsToPicture(const isoscope::v1::InteractResponse& response);

// The queue of a viewer: a frame, and the tiles that came after it. Thread-compatible.
class FrameQueue {
 public:
  struct Frame {
    std::int64_t frame_number = 0;
    bool adds_to_picture = false;  // as AddsToPicture
    std::string bytes;
  };

  // The most that wait. The server sends fewer tiles ahead, unless its viewer is silent.
  static constexpr std::size_t kMaxFrames = 16;

  // Stores a frame behind those that it adds to, else in place of all. Returns the numbers of those
  // that are never sent: replaced ones, and the oldest beyond kMaxFrames.
  std::vector<std::int64_t> Offer(Frame frame);
  // Removes the oldest frame and returns it; nullopt if there is none.
  std::optional<Frame> Take();

 private:
  std::deque<Frame> frames_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_FRAME_MESSAGE_H_
