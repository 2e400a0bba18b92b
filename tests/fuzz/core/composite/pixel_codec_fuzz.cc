// Bands of pixels: what is refused changes nothing, what is accepted comes back from its encoding,
// and every picture does.

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "core/composite/band_format.h"
#include "core/composite/pixel_codec.h"
#include "tests/fuzz/fuzz_input.h"

namespace isoscope::fuzz {
namespace {

constexpr image::FragmentOrder kOrder{.block_count = 1000, .ties = image::TieRule::kColor};
constexpr int kMaxSidePx = 80;  // five tiles
// All possible owners, and few.
constexpr composite::SurfaceCounts kAllSurfaces{.opaque = 1 << 23, .layers = 1 << 23};
constexpr composite::SurfaceCounts kFewSurfaces{.opaque = 3, .layers = 2};

struct Picture {
  explicit Picture(int width, int height, const composite::SurfaceCounts& of = kAllSurfaces)
      : surfaces(of),
        opaque(width, height),
        pool(image::FrameImagePool::Make(std::size_t{1} << 20)),
        layers(width, height, 3, kOrder, pool.get()) {}

  absl::Status Decode(absl::string_view band) {
    return composite::DecodePixelsInto(band, kOrder, surfaces, &opaque, nullptr, &layers);
  }

  composite::SurfaceCounts surfaces;
  image::FrameImage opaque;
  std::shared_ptr<image::FrameImagePool> pool;
  image::LayerStack layers;
};

// The bands of a picture make the same picture.
void RequireRoundTrip(const Picture& picture) {
  Picture again(picture.opaque.width, picture.opaque.height);
  for (const std::string& band : composite::EncodePixels(picture.opaque)) {
    Require(again.Decode(band).ok(), "an encoded band can be decoded");
  }
  for (const std::string& band : composite::EncodeLayers(picture.layers)) {
    Require(again.Decode(band).ok(), "an encoded band of layers can be decoded");
  }
  Require(again.opaque == picture.opaque, "a picture comes back from its bands");
  Require(again.layers == picture.layers, "layers come back from their bands");
}

// Returns true if all owners are those of existing surfaces.
bool HasKnownOwners(const image::FrameImage& image, std::size_t surface_count) {
  return std::all_of(image.keys.begin(), image.keys.end(), [&](std::uint64_t key) {
    return key == image::kBackgroundKey || kOrder.SurfaceOf(image::OwnerOf(key)) < surface_count;
  });
}

void DecodeBand(int width, int height, const composite::SurfaceCounts& surfaces,
                const std::string& band) {
  Picture picture(width, height, surfaces);
  picture.opaque.Set(0, 0, image::FragmentKey(0.5F, 7), {1, 2, 3, 255});
  const image::FrameImage before = picture.opaque;
  const absl::Status status = picture.Decode(band);
  if (!status.ok()) {
    RequireError(status, {absl::StatusCode::kDataLoss});
    Require(picture.opaque == before && picture.layers.empty(),
            "a band that is refused changes nothing");
    return;
  }
  Require(HasKnownOwners(picture.opaque, surfaces.opaque), "opaque pixels have known surfaces");
  for (const image::FrameImage* layer_image : picture.layers.LayerImages()) {
    Require(HasKnownOwners(*layer_image, surfaces.layers), "layers have known surfaces");
  }
  RequireRoundTrip(picture);
  Picture twice(width, height);
  twice.opaque = picture.opaque;
  Require(twice.Decode(band).ok() && twice.opaque == picture.opaque,
          "a band that comes twice changes nothing");
}

// Pixels of 12 bytes: place, depth, owner, colour.
void EncodePicture(int width, int height, Input input) {
  Picture picture(width, height);
  while (!input.empty()) {
    const int x = input.Byte() % width;
    const int y = input.Byte() % height;
    const std::uint8_t depth = input.Byte();
    const std::uint8_t kind = input.Byte();
    const std::uint32_t owner = input.Short();
    const image::Rgba8 color{input.Byte(), input.Byte(), depth,
                             static_cast<std::uint8_t>(kind | 1)};
    const std::uint64_t key =
        image::FragmentKey(static_cast<float>(depth) / 256.0F, owner * (kind % 3 == 0 ? 65536 : 1));
    if (kind % 2 == 0) {
      picture.opaque.Set(x, y, key, color);
    } else {
      picture.layers.Insert(x, y, key, color);
    }
  }
  RequireRoundTrip(picture);
}

void Run(Input input) {
  const std::uint8_t mode = input.Byte();
  const int width = 1 + input.Byte() % kMaxSidePx;
  const int height = 1 + input.Byte() % kMaxSidePx;
  if (mode % 4 == 3) {
    EncodePicture(width, height, input);
    return;
  }
  std::string band(input.Rest());
  if (mode % 4 > 0 && band.size() >= composite::kBandHeaderSize) {
    composite::SealBand(&band);
  }
  DecodeBand(width, height, (mode & 4) != 0 ? kFewSurfaces : kAllSurfaces, band);
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  for (const int width : {16, 33, 70}) {
    const int height = width - 3;
    Picture picture(width, height);
    for (int i = 0; i < 400; ++i) {
      const int x = i * 7 % width;
      const int y = i / 9 % height;
      const auto owner = static_cast<std::uint32_t>(i / 60);
      const std::uint64_t key = image::FragmentKey(0.25F + 0.001F * static_cast<float>(i), owner);
      picture.opaque.Set(x, y, key, {static_cast<std::uint8_t>(i), 20, 30, 255});
      picture.layers.Insert(x, y, key, {10, static_cast<std::uint8_t>(i), 30, 100});
    }
    const std::string size{static_cast<char>(width - 1), static_cast<char>(height - 1)};
    for (const std::string& band : composite::EncodePixels(picture.opaque)) {
      seeds.push_back("\1" + size + band);
    }
    for (const std::string& band : composite::EncodeLayers(picture.layers)) {
      seeds.push_back("\1" + size + band);
    }
    seeds.push_back("\3" + size + seeds.back().substr(0, 600));
  }
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
