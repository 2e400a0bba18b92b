// The bytes that a frame takes in the coordinator (docs/operations.md, "Of a coordinator").

#ifndef ISOSCOPE_SERVER_ADMISSION_FRAME_BYTES_H_
#define ISOSCOPE_SERVER_ADMISSION_FRAME_BYTES_H_

#include <cstddef>

#include "core/frame/frame_spec.h"
#include "core/view/camera.h"

namespace isoscope::server {

// How a response leaves the coordinator.
enum class Delivery {
  kWhole,  // in one message, which gRPC copies to send it
  kParts,  // as a stream
};

// Returns the bytes that a frame takes in the coordinator until its response is sent, if it is
// drawn at once. They are those of the drawn image with its samples and its margin, occlusion map,
// pixel bands on their way, planes, picture and response.
std::size_t FrameBytes(const frame::FrameSpec& spec, Delivery delivery);

// Returns the part of FrameBytes for pixel bands that have arrived and are not composited yet.
std::size_t WaitingBandBytes(const frame::FrameSpec& spec);

// Whether the picture of a frame that is drawn in bands is encoded row of bands by row of bands.
// All others are held as pixels until the last band.
bool IsEncodedByRows(const frame::FrameSpec& spec);

// The bytes of a frame that is drawn in bands, by stage.
struct BandedBytes {
  std::size_t kept = 0;    // of the answer, while bands are drawn
  std::size_t band = 0;    // of the band that is drawn, besides
  std::size_t encode = 0;  // while the picture is made of all of them
  std::size_t send = 0;    // while the answer is sent

  [[nodiscard]] std::size_t most() const;
};

// band: the size of a band, in pixels of the picture; one that has margins on all sides is meant
BandedBytes BandedBytesOf(const frame::FrameSpec& spec, const view::Viewport& band,
                          Delivery delivery);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_FRAME_BYTES_H_
