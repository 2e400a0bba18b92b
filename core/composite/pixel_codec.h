// Sparse pixels on the wire: only covered ones, as what differs from what their neighbours let one
// expect, in bands of rows of tiles that are sent and composited as they are made. Fast before
// small: numbers are packed to bits, only coverage, block ids and palettes are compressed. The byte
// layout is in docs/format/wire.md.

#ifndef ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_
#define ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/base/mutex.h"
#include "core/image/frame_image.h"

namespace isoscope::composite {

// Encodes the pixels of `image` that are not background, as bands of whole rows of tiles, at most
// kMaxBandBytes long: as many as keep some cores busy, fewer if there are few pixels. No such
// pixel: no band. In parallel, inside the caller's TBB arena. O(pixels of touched tiles).
// Thread-safe.
std::vector<std::string> EncodePixels(const image::FrameImage& image);
inline constexpr std::int64_t kMaxBandBytes = std::int64_t{4} << 20;

// Lets threads composite into one image at the same time: a lock for each row of tiles.
class RowLocks {
 public:
  explicit RowLocks(int height_px);
  base::Mutex& OfTileRow(int tile_row) { return mutexes_[static_cast<std::size_t>(tile_row)]; }

 private:
  std::unique_ptr<base::Mutex[]> mutexes_;
};

// Composites the pixels of one band into `into` (CompositeInto's rule) and inserts their tiles into
// `into->touched`. DATA_LOSS if the bytes are damaged or don't fit the image; then `into` is
// unchanged. Thread-safe if all callers pass the same locks, of that image's height; with none,
// thread-compatible.
absl::Status DecodePixelsInto(absl::string_view band, const image::FragmentOrder& order,
                              image::FrameImage* into, RowLocks* locks = nullptr);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_
