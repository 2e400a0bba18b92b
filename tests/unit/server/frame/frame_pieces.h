// Blocks and images of a small frame, for tests of what the coordinator does with them.

#ifndef ISOSCOPE_TESTS_UNIT_SERVER_FRAME_FRAME_PIECES_H_
#define ISOSCOPE_TESTS_UNIT_SERVER_FRAME_FRAME_PIECES_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "core/base/random.h"
#include "core/composite/pixel_codec.h"
#include "core/image/frame_image.h"
#include "core/view/view.h"
#include "core/volume/block_layout.h"

namespace isoscope::server {

using Blocks = std::vector<volume::BlockId>;

inline constexpr int kWidth = 37;
inline constexpr int kHeight = 29;
inline constexpr math::Index3 kDims{17, 17, 17};
inline constexpr volume::BlockId kBlockCount = 64;  // of 4^3 cells

inline view::View MakeView() {
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  // Close enough that some blocks are beside the picture.
  view::Camera camera = view::MakeDefaultCamera({{0, 0, 0}, {16, 16, 16}});
  view::Zoom(5.0, &camera);
  return *view::View::Make(camera, {kWidth, kHeight}, geometry);
}

// Blocks in {0 .. kBlockCount - 1} with id % divisor == rest.
inline Blocks Every(volume::BlockId divisor, volume::BlockId rest) {
  Blocks blocks;
  for (volume::BlockId id = rest; id < kBlockCount; id += divisor) {
    blocks.push_back(id);
  }
  return blocks;
}

// An image where each pixel is covered with the given chance; depths repeat, so that owners decide.
inline image::FrameImage RandomImage(std::uint64_t seed, double coverage) {
  image::FrameImage image(kWidth, kHeight);
  std::uint64_t i = 0;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x, ++i) {
      if (base::RandomUnit(seed, 4 * i) >= coverage) {
        continue;
      }
      const float depth =
          static_cast<float>(static_cast<int>(8 * base::RandomUnit(seed, 4 * i + 1))) / 8;
      const auto owner =
          static_cast<std::uint32_t>(kBlockCount * base::RandomUnit(seed, 4 * i + 2));
      // A block has one fragment in a pixel: owner and depth decide the colour.
      const auto shade = static_cast<std::uint8_t>(owner % 251);
      image.Set(x, y, image::FragmentKey(depth, owner),
                {shade, static_cast<std::uint8_t>(255 * depth), shade, 255});
    }
  }
  return image;
}

// A picture of depth 0.01 but for a strip: hides what is behind it.
inline image::FrameImage Wall() {
  image::FrameImage image(kWidth, kHeight);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      if (x / 6 != 3) {
        image.Set(x, y, image::FragmentKey(0.01F, 0), {9, 9, 9, 255});
      }
    }
  }
  return image;
}

// The bands of `image`, in pieces of a few rows, in random order.
inline std::vector<std::string> ShuffledBands(const image::FrameImage& image, std::uint64_t seed) {
  std::vector<std::string> bands;
  for (int first_row = 0; first_row < kHeight; first_row += 5) {
    image::FrameImage piece(kWidth, kHeight);
    for (int y = first_row; y < std::min(first_row + 5, kHeight); ++y) {
      for (int x = 0; x < kWidth; ++x) {
        if (const std::size_t i = image.IndexOf(x, y); image.keys[i] != image::kBackgroundKey) {
          piece.Set(x, y, image.keys[i], image.colors[i]);
        }
      }
    }
    for (std::string& band : composite::EncodePixels(piece)) {
      bands.push_back(std::move(band));
    }
  }
  for (std::size_t i = bands.size(); i > 1; --i) {
    std::swap(bands[i - 1],
              bands[static_cast<std::size_t>(base::RandomUnit(seed, i) * static_cast<double>(i))]);
  }
  return bands;
}

}  // namespace isoscope::server

#endif  // ISOSCOPE_TESTS_UNIT_SERVER_FRAME_FRAME_PIECES_H_
