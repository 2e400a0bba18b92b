// Joins the bands of a frame to its output: the bytes that it has if it is drawn at once. No gRPC
// types.

#ifndef ISOSCOPE_SERVER_PICTURE_BAND_JOINER_H_
#define ISOSCOPE_SERVER_PICTURE_BAND_JOINER_H_

#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/frame/frame_spec.h"
#include "core/image/frame_image.h"
#include "core/image/jpeg_codec.h"
#include "core/image/png_codec.h"
#include "core/view/camera.h"
#include "server/picture/frame_output.h"

namespace isoscope::server {

// Bands come in rows from the top, each row from the left; all of a row have the same height. If
// nothing is encoded by rows, they come in any order. All functions may throw std::bad_alloc, and
// work in the tbb::task_arena of the caller. Thread-compatible.
class BandJoiner {
 public:
  // spec:               of the whole; outlives the joiner
  // is_encoded_by_rows: a JPEG, or a PNG over an opaque background, is encoded as soon as bands are
  //                     there, which keeps its encoded bytes in place of its pixels; ignored for
  //                     other pictures
  BandJoiner(const frame::FrameSpec& spec, bool is_encoded_by_rows);

  // Adds the picture of a band, given in pixels of the whole, unless none is wanted. REQUIRES: the
  // image has its size.
  void AddPicture(const view::Region& band, const image::FrameImage& image);
  // Adds the planes of a band, without its picture.
  void AddPlanes(const view::Region& band, const FrameOutput& planes);
  // Encodes the rows that are complete. Call it when the images of the band are gone. INTERNAL if a
  // pixel of a PNG over an opaque background is translucent; RESOURCE_EXHAUSTED if memory runs out.
  absl::Status EncodeRows();

  // Returns a part of the picture as PNG: the bytes of a frame of that region. RESOURCE_EXHAUSTED if
  // memory runs out. REQUIRES: the picture is a PNG, is not encoded by rows, and has that part.
  [[nodiscard]] absl::StatusOr<std::string> EncodePart(const view::Region& part) const;

  // Returns the output of the whole. REQUIRES: all bands were added. RESOURCE_EXHAUSTED if memory
  // runs out.
  absl::StatusOr<FrameOutput> Finish();

 private:
  [[nodiscard]] bool is_by_rows() const { return png_rows_.has_value() || jpeg_rows_.has_value(); }
  void AddPlane(const view::Region& band, std::size_t pixel_bytes, const std::string& from,
                std::string* to) const;
  // Returns how many of the complete rows are encoded now.
  [[nodiscard]] int RowsToEncode() const;
  [[nodiscard]] std::string TakeEncodedRows();

  const frame::FrameSpec& spec_;
  const view::Viewport size_;
  // Neither is set: the picture is encoded at the end.
  std::optional<image::PngRowWriter> png_rows_;
  std::optional<image::JpegRowWriter> jpeg_rows_;
  // Pixels from row begin_row_ on: those that are not encoded. Pixels of raw pictures go to
  // output_.
  std::vector<image::Rgba8> pixels_;
  int begin_row_ = 0;
  int complete_row_count_ = 0;
  bool is_opaque_ = true;
  std::deque<std::string> encoded_rows_;
  FrameOutput output_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_PICTURE_BAND_JOINER_H_
