#include "core/render/pass_resources.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <new>
#include <utility>

#include "core/math/elementary.h"

namespace isoscope::render {
namespace {

// Enough tables, of 16 KiB each, for two frames with as many surfaces as a frame can have.
constexpr std::size_t kMaxShadeTables = 2 * frame::kMaxSurfaces;

}  // namespace

std::vector<image::Rgba8> MakeShadeTable(const frame::Appearance& appearance) {
  std::vector<image::Rgba8> table(kShadeSteps + 1);
  const auto ambient = static_cast<double>(appearance.ambient);
  const double share = appearance.diffuse ? static_cast<double>(*appearance.diffuse) : 1 - ambient;
  for (std::size_t i = 0; i <= kShadeSteps; ++i) {
    const double c = static_cast<double>(i) / kShadeSteps;
    const double diffuse = ambient + share * c;
    const double specular = static_cast<double>(appearance.specular) *
                            math::Pow(c, static_cast<double>(appearance.shininess));
    const auto channel = [&](std::uint8_t base) {
      const double value = std::clamp(base / 255.0 * diffuse + specular, 0.0, 1.0);
      return static_cast<std::uint8_t>(std::lround(value * 255));
    };
    table[i] = {channel(appearance.base_color.r), channel(appearance.base_color.g),
                channel(appearance.base_color.b), 255};
  }
  return table;
}

std::unique_ptr<PassBuffers> PassResources::TakeBuffers(int width, int height) {
  {
    const base::MutexLock lock(&mutex_);
    const auto found = std::find_if(unused_.rbegin(), unused_.rend(), [&](const auto& unused) {
      return unused->plane.width() == width && unused->plane.height() == height;
    });
    if (found != unused_.rend()) {
      std::unique_ptr<PassBuffers> buffers = std::move(*found);
      unused_.erase(std::next(found).base());
      unused_bytes_ -= buffers->size_bytes();
      return buffers;
    }
  }
  return std::make_unique<PassBuffers>(width, height);
}

void PassResources::GiveBack(std::unique_ptr<PassBuffers> buffers) {
  const std::size_t size = buffers->size_bytes();
  if (size > max_unused_buffer_bytes_) {
    return;
  }
  std::vector<std::unique_ptr<PassBuffers>> dropped;  // freed after the lock
  const base::MutexLock lock(&mutex_);
  try {
    unused_.reserve(unused_.size() + 1);
    dropped.reserve(unused_.size());
  } catch (const std::bad_alloc&) {
    return;  // destructors call this; without memory nothing is kept
  }
  while (unused_bytes_ + size > max_unused_buffer_bytes_) {
    unused_bytes_ -= unused_.front()->size_bytes();
    dropped.push_back(std::move(unused_.front()));
    unused_.erase(unused_.begin());
  }
  unused_bytes_ += size;
  unused_.push_back(std::move(buffers));
}

void PassResources::PrepareBuffers(int width, int height) {
  const std::size_t fragment_bytes =
      static_cast<std::size_t>(width) * static_cast<std::size_t>(height) * sizeof(DepthPrimitive);
  {
    const base::MutexLock lock(&mutex_);
    if (unused_bytes_ + fragment_bytes > max_unused_buffer_bytes_) {
      return;
    }
  }
  GiveBack(std::make_unique<PassBuffers>(width, height));
}

std::shared_ptr<const std::vector<image::Rgba8>> PassResources::ShadeTableOf(
    const frame::Appearance& appearance) {
  const base::MutexLock lock(&mutex_);
  const auto found =
      std::find_if(shade_tables_.begin(), shade_tables_.end(),
                   [&](const ShadeTable& table) { return table.appearance == appearance; });
  if (found != shade_tables_.end()) {
    return found->colors;
  }
  if (shade_tables_.size() == kMaxShadeTables) {
    shade_tables_.erase(shade_tables_.begin());
  }
  shade_tables_.push_back(
      {appearance, std::make_shared<const std::vector<image::Rgba8>>(MakeShadeTable(appearance))});
  return shade_tables_.back().colors;
}

}  // namespace isoscope::render
