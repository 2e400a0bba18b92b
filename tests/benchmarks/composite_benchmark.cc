// The reduce of steps 2 and 3 at 1024 x 1024: depth compositing and the pixel codec, on one core.
//
// The picture is a bumpy sphere with holes, its blocks 12 pixels wide: smooth depth and shading, as
// isosurfaces have. `agents` is among how many its blocks are dealt at random.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "benchmark/benchmark.h"

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/composite/depth_composite.h"
#include "core/composite/pixel_codec.h"

namespace isoscope::composite {
namespace {

constexpr int kSize = 1024;

// The pixels that agent 0 of `agents` draws. `radius` in pixels: 800 covers the whole picture.
image::FrameImage MakePicture(int radius, int agents) {
  image::FrameImage image(kSize, kSize);
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const double u = (x - kSize / 2) / static_cast<double>(radius);
      const double v = (y - kSize / 2) / static_cast<double>(radius);
      const auto block = static_cast<std::uint32_t>(x / 12 + 100 * (y / 12));
      if (u * u + v * v >= 1 || base::RandomBits(1, block) % static_cast<std::uint64_t>(agents)) {
        continue;
      }
      const double bump = 0.01 * std::sin(40 * u) * std::cos(37 * v);
      const double z = std::sqrt(1 - u * u - v * v) + bump;
      const auto i = static_cast<std::size_t>(y * kSize + x);
      image.depth[i] = static_cast<float>(0.9 - 0.3 * z);
      image.block_id[i] = block;
      const double light = 0.2 + 0.7 * std::abs(z + 0.4 * std::cos(40 * u) * std::cos(37 * v));
      const auto shade = [&](double base) {
        return static_cast<std::uint8_t>(std::min(255.0, base * light));
      };
      image.color[i] = {shade(230), shade(200), shade(170), 255};
    }
  }
  return image;
}

void BM_CompositeInto(benchmark::State& state) {
  const image::FrameImage from = MakePicture(500, static_cast<int>(state.range(0)));
  image::FrameImage into(kSize, kSize);
  for (auto _ : state) {
    CompositeInto(from, &into);
    benchmark::ClobberMemory();
  }
}
BENCHMARK(BM_CompositeInto)->ArgName("agents")->Arg(1)->Arg(8)->Unit(benchmark::kMillisecond);

void SetSizes(const std::vector<std::string>& bands, benchmark::State* state) {
  std::size_t size = 0;
  for (const std::string& band : bands) {
    size += band.size();
  }
  state->counters["bytes"] = static_cast<double>(size);
}

void BM_EncodePixels(benchmark::State& state) {
  const image::FrameImage image =
      MakePicture(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  std::vector<std::string> bands;
  for (auto _ : state) {
    bands = EncodePixels(image, nullptr);
  }
  SetSizes(bands, &state);
}
BENCHMARK(BM_EncodePixels)
    ->ArgNames({"radius", "agents"})
    ->Args({800, 1})
    ->Args({500, 1})
    ->Args({500, 8})
    ->Unit(benchmark::kMillisecond);

void BM_DecodePixelsInto(benchmark::State& state) {
  const std::vector<std::string> bands = EncodePixels(
      MakePicture(static_cast<int>(state.range(0)), static_cast<int>(state.range(1))), nullptr);
  image::FrameImage into(kSize, kSize);
  for (auto _ : state) {
    state.PauseTiming();
    into = image::FrameImage(kSize, kSize);
    state.ResumeTiming();
    for (const std::string& band : bands) {
      ISOSCOPE_CHECK(DecodePixelsInto(band, &into).ok());
    }
  }
  SetSizes(bands, &state);
}
BENCHMARK(BM_DecodePixelsInto)
    ->ArgNames({"radius", "agents"})
    ->Args({800, 1})
    ->Args({500, 1})
    ->Args({500, 8})
    ->Unit(benchmark::kMillisecond);

void BM_FlattenOver(benchmark::State& state) {
  const image::FrameImage image = MakePicture(500, 1);
  for (auto _ : state) {
    benchmark::DoNotOptimize(FlattenOver(image, {0, 0, 0, 255}));
  }
}
BENCHMARK(BM_FlattenOver)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isoscope::composite
