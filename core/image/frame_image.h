// The image of a frame on its way from the agents to the coordinator: colour, depth and the block
// that owns each pixel. Row 0 is the top.

#ifndef ISOSCOPE_CORE_IMAGE_FRAME_IMAGE_H_
#define ISOSCOPE_CORE_IMAGE_FRAME_IMAGE_H_

#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

namespace isoscope::image {

// 8-bit sRGB with straight alpha.
struct Rgba8 {
  std::uint8_t r = 0;
  std::uint8_t g = 0;
  std::uint8_t b = 0;
  std::uint8_t a = 0;

  friend constexpr bool operator==(const Rgba8&, const Rgba8&) = default;
};

// What owns a pixel that nothing is drawn on.
inline constexpr std::uint32_t kNoBlock = std::numeric_limits<std::uint32_t>::max();
// The depth of such a pixel.
inline constexpr float kFarDepth = 1.0F;

// What decides which of two fragments a pixel shows: the smaller key. Depth first, then the block
// id: a total order over blocks that depends neither on drawing order nor on who draws
// (docs/numerics.md). REQUIRES: 0 <= depth <= 1, where IEEE bits order as the values do.
constexpr std::uint64_t FragmentKey(float depth, std::uint32_t block_id) {
  // + 0.0F turns -0 into +0, whose bits are the smallest.
  return std::uint64_t{std::bit_cast<std::uint32_t>(depth + 0.0F)} << 32 | block_id;
}

// Three planes of width * height elements each, row by row from the top. Thread-compatible.
struct FrameImage {
  FrameImage() = default;
  // All background: transparent black, kFarDepth, kNoBlock.
  FrameImage(int image_width, int image_height);

  [[nodiscard]] std::size_t pixel_count() const {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
  friend bool operator==(const FrameImage&, const FrameImage&) = default;

  int width = 0;
  int height = 0;
  std::vector<float> depth;  // window depth: 0 near, 1 far
  std::vector<std::uint32_t> block_id;
  std::vector<Rgba8> color;
};

}  // namespace isoscope::image

#endif  // ISOSCOPE_CORE_IMAGE_FRAME_IMAGE_H_
