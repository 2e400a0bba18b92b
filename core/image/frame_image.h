// The image of a frame on its way from the agents to the coordinator: colour, depth and owner of
// each pixel. Row 0 is the top.

#ifndef ISOSCOPE_CORE_IMAGE_FRAME_IMAGE_H_
#define ISOSCOPE_CORE_IMAGE_FRAME_IMAGE_H_

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/large_pages.h"
#include "core/base/mutex.h"
#include "core/image/fragment.h"
#include "core/image/tile_set.h"

namespace isoscope::image {

class FrameImagePool;

// Two planes of width * height elements each, row by row from the top. Thread-compatible.
//
// Every pixel outside the tiles of `touched`, and in them outside `covered`, is background in both
// planes. Code that draws a pixel marks it in both. So the cost of clearing, scanning and encoding
// grows with the drawn pixels, not with the viewport.
class FrameImage {
 public:
  FrameImage() = default;
  // Makes an image that is all background (transparent black, kBackgroundKey) and touched nowhere.
  FrameImage(int image_width, int image_height);
  ~FrameImage();
  FrameImage(FrameImage&&) noexcept;
  FrameImage& operator=(FrameImage&&) noexcept;
  FrameImage(const FrameImage&);
  FrameImage& operator=(const FrameImage&);

  [[nodiscard]] std::size_t pixel_count() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
  [[nodiscard]] std::size_t IndexOf(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(x);
  }
  [[nodiscard]] const TileMask& CoveredOf(int column, int row) const {
    return covered[TileIndex(column, row)];
  }
  [[nodiscard]] TileMask& CoveredOf(int column, int row) { return covered[TileIndex(column, row)]; }
  // Writes one fragment and marks its pixel as covered. For tests and sparse writers.
  void Set(int x, int y, std::uint64_t key, Rgba8 color);
  // Marks all pixels as covered, for writers that write all of them.
  void CoverAll();

  // Returns true if both are the same picture. Touched tiles and covered pixels do not count.
  friend bool operator==(const FrameImage& a, const FrameImage& b) {
    return a.width == b.width && a.height == b.height && a.keys == b.keys && a.colors == b.colors;
  }

  int width = 0;
  int height = 0;
  base::LargePageVector<std::uint64_t> keys;  // FragmentKey
  base::LargePageVector<Rgba8> colors;
  TileSet touched;
  std::vector<TileMask> covered;  // of each tile, row by row; 0 where it is not touched

 private:
  friend class FrameImagePool;
  [[nodiscard]] std::size_t TileIndex(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(touched.columns()) +
           static_cast<std::size_t>(column);
  }
  std::shared_ptr<FrameImagePool> pool_;  // takes the planes back; null: they are freed
};

// Clears and keeps the planes of images that are no longer used, so that a frame neither allocates
// nor touches fresh pages. Thread-safe.
class FrameImagePool : public std::enable_shared_from_this<FrameImagePool> {
 public:
  // Keeps at most this many bytes of unused images.
  static std::shared_ptr<FrameImagePool> Make(std::size_t max_bytes);

  // Returns an image that is all background. It goes back to the pool when it is destroyed.
  FrameImage Take(int width, int height);
  // Adds an unused image for a later Take, and touches its pages. Does nothing if the image is too
  // large to keep.
  void Prepare(int width, int height);

 private:
  friend class FrameImage;
  explicit FrameImagePool(std::size_t max_bytes) : max_bytes_(max_bytes) {}
  // Keeps the image if there is room and memory for it. Destructors call it.
  void TakeBack(FrameImage image) noexcept;

  const std::size_t max_bytes_;
  base::Mutex mutex_;
  std::vector<FrameImage> unused_ ABSL_GUARDED_BY(mutex_);  // the most recently used is the last
  std::size_t unused_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_FRAME_IMAGE_H_
