// Masks of open pixels: accepted masks have the shapes of their rectangles, and come back from
// their encoding.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_pixels.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

constexpr int kMaxSidePx = 4096;

std::string Bytes(const view::PixelRect& rect) {
  std::string bytes;
  for (const int value : {rect.begin_x, rect.begin_y, rect.end_x, rect.end_y}) {
    bytes.append({static_cast<char>(value % 256), static_cast<char>(value / 256)});
  }
  return bytes;
}

void Run(Input input) {
  std::vector<view::PixelRect> rects(input.Byte() % 9);
  for (view::PixelRect& rect : rects) {
    rect.begin_x = input.Short() % kMaxSidePx;
    rect.begin_y = input.Short() % kMaxSidePx;
    rect.end_x = input.Short() % kMaxSidePx;
    rect.end_y = input.Short() % kMaxSidePx;
  }
  const auto masks = visibility::DecodeOpenPixels(input.Rest(), rects);
  if (!masks.ok()) {
    RequireError(masks.status(), {absl::StatusCode::kDataLoss});
    return;
  }
  Require(masks->size() == rects.size(), "there is a mask for each rectangle");
  for (std::size_t i = 0; i < rects.size(); ++i) {
    image::PixelMask shape = (*masks)[i];
    shape.words.assign(shape.words.size(), 0);
    Require(shape == visibility::ClosedMaskOf(rects[i]), "a mask has the shape of its rectangle");
    const auto bits = static_cast<std::size_t>(shape.columns * shape.rows);
    Require(bits % 64 == 0 || (*masks)[i].words.back() >> (bits % 64) == 0,
            "the spare bits of a mask are 0");
  }
  const auto again = visibility::DecodeOpenPixels(visibility::EncodeOpenPixels(*masks), rects);
  Require(again.ok() && *again == *masks, "masks come back from their encoding");
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  const std::vector<view::PixelRect> rects{
      {0, 0, 5, 7}, {3, 9, 200, 61}, {8, 8, 8, 8}, {100, 1000, 1900, 1100}};
  for (std::size_t count = 0; count <= rects.size(); ++count) {
    for (const std::uint64_t pattern :
         {std::uint64_t{0}, ~std::uint64_t{0}, std::uint64_t{0x1357}}) {
      std::string input(1, static_cast<char>(count));
      std::vector<image::PixelMask> masks;
      for (std::size_t i = 0; i < count; ++i) {
        input += Bytes(rects[i]);
        image::PixelMask mask = visibility::ClosedMaskOf(rects[i]);
        for (std::uint64_t& word : mask.words) {
          word = pattern;
        }
        if (const auto bits = static_cast<std::size_t>(mask.columns * mask.rows); bits % 64 != 0) {
          mask.words.back() &= (std::uint64_t{1} << (bits % 64)) - 1;
        }
        masks.push_back(mask);
      }
      seeds.push_back(input + visibility::EncodeOpenPixels(masks));
    }
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
