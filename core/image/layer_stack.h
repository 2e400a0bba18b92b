// The translucent fragments of a picture: the first few of each pixel, nearest first.
//
// Layer image 0 holds the first fragment of each pixel, layer image 1 the second, and so on. Each
// is encoded, pooled and cleared like any other image. Fragments of one pixel are ordered by depth,
// then surface; of those equal in both, only the first in the frame's order stays. So the fragments
// of a pixel are a set. A stack keeps the smallest of a union of sets, which depends neither on the
// order of insertion nor on repetition (docs/numerics.md, "Translucent layers").

#ifndef ISOSCOPE_CORE_IMAGE_LAYER_STACK_H_
#define ISOSCOPE_CORE_IMAGE_LAYER_STACK_H_

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "core/base/mutex.h"
#include "core/image/fragment.h"
#include "core/image/frame_image.h"

namespace isoscope::image {

// Images are made when a pixel first needs them. Thread-compatible; several threads may insert into
// different rows of tiles at a time.
class LayerStack {
 public:
  // Makes a stack without a picture and without layers.
  LayerStack() = default;
  // At most `max_layers` fragments for each pixel. Images come from `images`, which outlives every
  // Insert. `order` says how fragments are ordered; it must have TieRule::kColor.
  LayerStack(int width, int height, int max_layers, const FragmentOrder& order,
             FrameImagePool* images);
  LayerStack(LayerStack&&) noexcept = default;
  LayerStack& operator=(LayerStack&&) noexcept = default;

  // Inserts a fragment. If the pixel then has more than max_layers, the last one is dropped.
  // O(max_layers). May throw std::bad_alloc when it makes an image.
  void Insert(int x, int y, std::uint64_t key, Rgba8 color);

  // The images that were made, nearest layers first. A pixel without a fragment in one is
  // background there, and in all images after it.
  [[nodiscard]] std::vector<const FrameImage*> LayerImages() const;
  // The same, to change the colours. No Insert after that.
  [[nodiscard]] std::vector<FrameImage*> MutableLayerImages();
  [[nodiscard]] bool empty() const { return state_ == nullptr || LayerImageAt(0) == nullptr; }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] const FragmentOrder& order() const { return order_; }

  // Whether a fragment of the stack shows before the opaque fragment `opaque`.
  [[nodiscard]] bool IsBefore(std::uint64_t layer, std::uint64_t opaque) const {
    if (!HaveEqualDepth(layer, opaque)) {
      return layer < opaque;
    }
    return opaque == kBackgroundKey ||
           order_.SurfaceOf(OwnerOf(layer)) < order_.SurfaceOf(OwnerOf(opaque));
  }

  // Returns true if both hold the same fragments.
  friend bool operator==(const LayerStack& a, const LayerStack& b);

 private:
  // Apart from the stack, so that the stack can move.
  struct State {
    explicit State(std::size_t image_count) : owned(image_count), images(image_count) {}
    base::Mutex mutex;  // held while an image is made
    std::vector<std::unique_ptr<FrameImage>> owned;
    std::vector<std::atomic<FrameImage*>> images;  // null: not made yet
  };

  [[nodiscard]] FrameImage* LayerImageAt(std::size_t i) const {
    return state_->images[i].load(std::memory_order_acquire);
  }
  FrameImage* MakeLayerImage(std::size_t i);

  int width_ = 0;
  int height_ = 0;
  FragmentOrder order_;
  FrameImagePool* images_ = nullptr;
  std::unique_ptr<State> state_;
};

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_LAYER_STACK_H_
