// Cuts a response into parts for RenderIsosurfaceStream, and puts the parts together again.

#ifndef ISOSCOPE_WIRE_RESPONSE_SPLITTER_H_
#define ISOSCOPE_WIRE_RESPONSE_SPLITTER_H_

#include <cstddef>
#include <string>
#include <vector>

#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::wire {

// The most bytes of picture or plane in a part: less than gRPC's default limit of 4 MiB.
inline constexpr std::size_t kMaxPartBytes = std::size_t{1} << 20;

// Frees the bytes that it has cut off: a response and its parts are never there twice.
// Thread-compatible.
class ResponseSplitter {
 public:
  explicit ResponseSplitter(isoscope::v1::RenderIsosurfaceResponse response);

  // Sets `part` to the next part; false if there is none. The first one has all fields that are not
  // `bytes`; each other one has a piece of one `bytes` field.
  bool Next(isoscope::v1::RenderIsosurfaceResponse* part);

 private:
  isoscope::v1::RenderIsosurfaceResponse first_;  // without `bytes`
  bool is_first_sent_ = false;
  std::vector<std::string> planes_;  // one for each `bytes` field
  std::size_t plane_ = 0;
  std::size_t offset_ = 0;  // in that plane
};

// Makes room for planes and raw pictures that are asked for and have not come, so that AppendPart
// does not move them. Does nothing if they take more than `max_bytes`. REQUIRES: the first part was
// added. May throw std::bad_alloc.
void ReserveRaw(const isoscope::v1::OutputOptions& output, std::size_t max_bytes,
                isoscope::v1::RenderIsosurfaceResponse* response);

// Adds a part to what has come before: appends `bytes` fields, takes all others.
void AppendPart(isoscope::v1::RenderIsosurfaceResponse part,
                isoscope::v1::RenderIsosurfaceResponse* response);

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_RESPONSE_SPLITTER_H_
