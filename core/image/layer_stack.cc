#include "core/image/layer_stack.h"

#include <utility>

#include "core/base/check.h"

namespace isoscope::image {

LayerStack::LayerStack(int width, int height, int max_layers, const FragmentOrder& order,
                       FrameImagePool* images)
    : width_(width),
      height_(height),
      order_(order),
      images_(images),
      state_(std::make_unique<State>(static_cast<std::size_t>(max_layers))) {
  ISOSCOPE_CHECK_GE(max_layers, 1);
  ISOSCOPE_CHECK(order.ties == TieRule::kColor);
}

FrameImage* LayerStack::MakeLayerImage(std::size_t i) {
  const base::MutexLock lock(&state_->mutex);
  if (FrameImage* made = LayerImageAt(i); made != nullptr) {
    return made;  // another thread was faster
  }
  state_->owned[i] = std::make_unique<FrameImage>(images_->Take(width_, height_));
  state_->images[i].store(state_->owned[i].get(), std::memory_order_release);
  return state_->owned[i].get();
}

void LayerStack::Insert(int x, int y, std::uint64_t key, Rgba8 color) {
  const std::size_t pixel =
      static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  for (std::size_t i = 0; i < state_->images.size(); ++i) {
    FrameImage* layer_image = LayerImageAt(i);
    if (layer_image == nullptr) [[unlikely]] {
      layer_image = MakeLayerImage(i);
    }
    std::uint64_t& kept = layer_image->keys[pixel];
    if (kept == kBackgroundKey) {
      layer_image->Set(x, y, key, color);
      return;
    }
    if (!HaveEqualDepth(key, kept)) [[likely]] {
      if (key < kept) {
        std::swap(key, kept);
        std::swap(color, layer_image->colors[pixel]);
      }
      continue;
    }
    const bool is_same_surface =
        order_.SurfaceOf(image::OwnerOf(key)) == order_.SurfaceOf(image::OwnerOf(kept));
    if (order_.IsBefore(key, color, kept, layer_image->colors[pixel])) {
      std::swap(key, kept);
      std::swap(color, layer_image->colors[pixel]);
    }
    if (is_same_surface) {
      return;  // one of the two stays
    }
  }
}

std::vector<const FrameImage*> LayerStack::LayerImages() const {
  std::vector<const FrameImage*> layer_images;
  if (state_ != nullptr) {
    for (std::size_t i = 0; i < state_->images.size() && LayerImageAt(i) != nullptr; ++i) {
      layer_images.push_back(LayerImageAt(i));
    }
  }
  return layer_images;
}

std::vector<FrameImage*> LayerStack::MutableLayerImages() {
  std::vector<FrameImage*> layer_images;
  for (std::size_t i = 0; i < LayerImages().size(); ++i) {
    layer_images.push_back(LayerImageAt(i));
  }
  return layer_images;
}

bool operator==(const LayerStack& a, const LayerStack& b) {
  const std::vector<const FrameImage*> a_images = a.LayerImages();
  const std::vector<const FrameImage*> b_images = b.LayerImages();
  if (a_images.size() != b_images.size()) {
    return false;
  }
  for (std::size_t i = 0; i < a_images.size(); ++i) {
    if (!(*a_images[i] == *b_images[i])) {
      return false;
    }
  }
  return true;
}

}  // namespace isoscope::image
