// The translucent fragments of a picture: the first few of each pixel, nearest first.
//
// Level 0 holds the first fragment of each pixel, level 1 the second, and so on. A level is an
// image like any other, so that it is encoded, pooled and cleared as one. Fragments of one pixel
// are ordered by depth, then surface; of those equal in both, only the first in the frame's order
// stays. So the fragments of a pixel are a set. A stack keeps the smallest of a union of sets,
// which depends neither on the order of insertion nor on repetition (docs/numerics.md, "Translucent
// layers").

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

// Levels are made when a pixel first needs them. Thread-compatible; several threads may insert into
// different rows of tiles at a time.
class LayerStack {
 public:
  // Makes a stack without a picture and without layers.
  LayerStack() = default;
  // At most `max_levels` fragments for each pixel. Images come from `images`, which outlives every
  // Insert. `order` says how fragments are ordered; it must have TieRule::kColor.
  LayerStack(int width, int height, int max_levels, const FragmentOrder& order,
             FrameImagePool* images);
  LayerStack(LayerStack&&) noexcept = default;
  LayerStack& operator=(LayerStack&&) noexcept = default;

  // Inserts a fragment. If the pixel then has more than max_levels, the last one is dropped.
  // O(levels). May throw std::bad_alloc when it makes a level.
  void Insert(int x, int y, std::uint64_t key, Rgba8 color);

  // The levels that were made, level 0 first. A pixel without a fragment there is background, and
  // then is so in all levels after it.
  [[nodiscard]] std::vector<const FrameImage*> Levels() const;
  // The same, to change the colours. No Insert after that.
  [[nodiscard]] std::vector<FrameImage*> MutableLevels();
  [[nodiscard]] bool empty() const { return state_ == nullptr || LevelAt(0) == nullptr; }
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
    explicit State(std::size_t level_count) : owned(level_count), levels(level_count) {}
    base::Mutex mutex;  // held while a level is made
    std::vector<std::unique_ptr<FrameImage>> owned;
    std::vector<std::atomic<FrameImage*>> levels;  // null: not made yet
  };

  [[nodiscard]] FrameImage* LevelAt(std::size_t i) const {
    return state_->levels[i].load(std::memory_order_acquire);
  }
  FrameImage* MakeLevel(std::size_t i);

  int width_ = 0;
  int height_ = 0;
  FragmentOrder order_;
  FrameImagePool* images_ = nullptr;
  std::unique_ptr<State> state_;
};

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_LAYER_STACK_H_
