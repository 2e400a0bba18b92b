// The messages of the WebSocket. Clients send InteractRequest as JSON. The gateway sends one binary
// message for each InteractResponse:
//
//   u32 little-endian   length of the JSON
//   JSON                InteractResponse without its bytes, and with
//                       "image": {"type": "image/jpeg", "bytes": N}, "depthBytes": M
//   N bytes             the picture
//   M bytes             the depth grid: u16 little-endian, row by row

#ifndef ISOSCOPE_WEB_GATEWAY_API_FRAME_MESSAGE_H_
#define ISOSCOPE_WEB_GATEWAY_API_FRAME_MESSAGE_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "isoscope/v1/interact_service.pb.h"

namespace isoscope::gateway {

// The longest message of a client, in bytes.
inline constexpr std::size_t kMaxRequestBytes = std::size_t{1} << 18;

std::string EncodeFrame(isoscope::v1::InteractResponse response);

// INVALID_ARGUMENT: no JSON of an InteractRequest, or neither a state nor an acknowledged frame.
absl::StatusOr<isoscope::v1::InteractRequest> DecodeInteractRequest(absl::string_view json);

// The queue of a viewer, for one frame: the next to be sent. Thread-compatible.
class FrameSlot {
 public:
  struct Frame {
    std::int64_t frame_number = 0;
    std::string bytes;
  };

  // Stores a frame. Returns the number of the frame that it replaces, which is never sent.
  std::optional<std::int64_t> Offer(Frame frame);
  // Removes the frame and returns it; nullopt if there is none.
  std::optional<Frame> Take();

 private:
  std::optional<Frame> frame_;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_FRAME_MESSAGE_H_
