#include "core/composite/depth_composite.h"

#include <cstddef>

#include "core/base/check.h"

namespace isoscope::composite {
namespace {

// Runs this long are looked at first and copied only where something wins: most of an agent's
// image is background.
constexpr std::size_t kRunPixels = 64;

// FragmentKey(depth a, id a) < FragmentKey(depth b, id b) in 32-bit lanes: floats in [0, 1] order
// as their bits do, and -0 equals +0.
int Wins(float depth_a, std::uint32_t id_a, float depth_b, std::uint32_t id_b) {
  const int nearer = depth_a < depth_b ? 1 : 0;
  const int tied = depth_a == depth_b ? 1 : 0;
  const int first = id_a < id_b ? 1 : 0;
  return nearer | (tied & first);
}

}  // namespace

void CompositeInto(const image::FrameImage& from, image::FrameImage* into) {
  ISOSCOPE_CHECK_EQ(from.width, into->width);
  ISOSCOPE_CHECK_EQ(from.height, into->height);
  const std::size_t count = into->pixel_count();
  for (std::size_t begin = 0; begin < count; begin += kRunPixels) {
    const std::size_t end = count - begin < kRunPixels ? count : begin + kRunPixels;
    int any = 0;
    for (std::size_t i = begin; i < end; ++i) {
      any |= Wins(from.depth[i], from.block_id[i], into->depth[i], into->block_id[i]);
    }
    if (any == 0) {
      continue;
    }
    for (std::size_t i = begin; i < end; ++i) {
      const bool wins =
          Wins(from.depth[i], from.block_id[i], into->depth[i], into->block_id[i]) != 0;
      into->depth[i] = wins ? from.depth[i] : into->depth[i];
      into->block_id[i] = wins ? from.block_id[i] : into->block_id[i];
      into->color[i] = wins ? from.color[i] : into->color[i];
    }
  }
}

std::vector<image::Rgba8> FlattenOver(const image::FrameImage& image, image::Rgba8 background) {
  std::vector<image::Rgba8> flat(image.color);
  for (std::size_t i = 0; i < flat.size(); ++i) {
    flat[i] = image.block_id[i] == image::kNoBlock ? background : flat[i];
  }
  return flat;
}

}  // namespace isoscope::composite
