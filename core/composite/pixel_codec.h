// Sparse pixels on the wire. A band holds the covered pixels of some rows of tiles, each as its
// difference from a prediction. Bands are sent and composited as they are made. Speed comes before
// size: numbers are packed to bits, and only coverage, owners and palettes are compressed.
// docs/format/wire.md has the layout.

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
#include "core/composite/band_format.h"
#include "core/image/frame_image.h"
#include "core/image/layer_stack.h"

namespace isoscope::composite {

// Encodes the covered pixels of `image` as bands of whole rows of tiles, each at most kMaxBandBytes
// long: enough bands to keep some cores busy, fewer if there are few pixels, none if there is no
// pixel. Works in parallel, inside the caller's TBB arena. O(pixels of touched tiles).
// Thread-safe.
std::vector<std::string> EncodePixels(const image::FrameImage& image);
// Encodes the images of a stack in the same way. Thread-safe.
std::vector<std::string> EncodeLayers(const image::LayerStack& layers);
inline constexpr std::int64_t kMaxBandBytes = std::int64_t{4} << 20;

// A lock for each row of tiles, so that threads can composite into one image at the same time.
class RowLocks {
 public:
  explicit RowLocks(int height_px);
  base::Mutex& OfTileRow(int tile_row) { return mutexes_[static_cast<std::size_t>(tile_row)]; }

 private:
  std::unique_ptr<base::Mutex[]> mutexes_;
};

// Composites the pixels of one band into `into`, by the rule of CompositeInto, and inserts their
// tiles into `into->touched`; those of a band of EncodeLayers go into `layers`, of the same size.
// DATA_LOSS if the bytes are damaged, don't fit the image, name owners beyond `surfaces`, or have
// layers and `layers` is null; nothing is changed then. Thread-safe if all callers pass the same
// locks, made for that image's height. Without locks it is thread-compatible.
absl::Status DecodePixelsInto(absl::string_view band, const image::FragmentOrder& order,
                              const SurfaceCounts& surfaces, image::FrameImage* into,
                              RowLocks* locks = nullptr, image::LayerStack* layers = nullptr);

}  // namespace isoscope::composite

#endif  // ISOSCOPE_CORE_COMPOSITE_PIXEL_CODEC_H_
