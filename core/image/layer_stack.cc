#include "core/image/layer_stack.h"

#include <utility>

#include "core/base/check.h"

namespace isoscope::image {

LayerStack::LayerStack(int width, int height, int max_levels, const FragmentOrder& order,
                       FrameImagePool* images)
    : width_(width),
      height_(height),
      order_(order),
      images_(images),
      state_(std::make_unique<State>(static_cast<std::size_t>(max_levels))) {
  ISOSCOPE_CHECK_GE(max_levels, 1);
  ISOSCOPE_CHECK(order.ties == TieRule::kColor);
}

FrameImage* LayerStack::MakeLevel(std::size_t i) {
  const base::MutexLock lock(&state_->mutex);
  if (FrameImage* made = LevelAt(i); made != nullptr) {
    return made;  // another thread was faster
  }
  state_->owned[i] = std::make_unique<FrameImage>(images_->Take(width_, height_));
  state_->levels[i].store(state_->owned[i].get(), std::memory_order_release);
  return state_->owned[i].get();
}

void LayerStack::Insert(int x, int y, std::uint64_t key, Rgba8 color) {
  const std::size_t pixel =
      static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) + static_cast<std::size_t>(x);
  for (std::size_t i = 0; i < state_->levels.size(); ++i) {
    FrameImage* level = LevelAt(i);
    if (level == nullptr) [[unlikely]] {
      level = MakeLevel(i);
    }
    std::uint64_t& kept = level->keys[pixel];
    if (kept == kBackgroundKey) {
      level->Set(x, y, key, color);
      return;
    }
    if (!HaveEqualDepth(key, kept)) [[likely]] {
      if (key < kept) {
        std::swap(key, kept);
        std::swap(color, level->colors[pixel]);
      }
      continue;
    }
    const bool is_same_surface =
        order_.SurfaceOf(image::OwnerOf(key)) == order_.SurfaceOf(image::OwnerOf(kept));
    if (order_.IsBefore(key, color, kept, level->colors[pixel])) {
      std::swap(key, kept);
      std::swap(color, level->colors[pixel]);
    }
    if (is_same_surface) {
      return;  // one of the two stays
    }
  }
}

std::vector<const FrameImage*> LayerStack::Levels() const {
  std::vector<const FrameImage*> levels;
  if (state_ != nullptr) {
    for (std::size_t i = 0; i < state_->levels.size() && LevelAt(i) != nullptr; ++i) {
      levels.push_back(LevelAt(i));
    }
  }
  return levels;
}

std::vector<FrameImage*> LayerStack::MutableLevels() {
  std::vector<FrameImage*> levels;
  for (std::size_t i = 0; i < Levels().size(); ++i) {
    levels.push_back(LevelAt(i));
  }
  return levels;
}

bool operator==(const LayerStack& a, const LayerStack& b) {
  const std::vector<const FrameImage*> of_a = a.Levels();
  const std::vector<const FrameImage*> of_b = b.Levels();
  if (of_a.size() != of_b.size()) {
    return false;
  }
  for (std::size_t i = 0; i < of_a.size(); ++i) {
    if (!(*of_a[i] == *of_b[i])) {
      return false;
    }
  }
  return true;
}

}  // namespace isoscope::image
