// PNG encoding of a 1024 x 1024 frame, by the number of threads.
//
// The pictures are shaded bumpy surfaces: a ball of radius 358 pixels, as a CT head stands in a
// frame, and waves all over the picture, as a field that fills it.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "benchmark/benchmark.h"
#include "oneapi/tbb/task_arena.h"

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/image/png_codec.h"

namespace isoscope::image {
namespace {

constexpr std::size_t kSize = 1024;
enum Content : std::int64_t { kBall, kWaves };

Rgba8 Shade(double light) {
  const auto channel = [light](double base) {
    return static_cast<std::uint8_t>(std::clamp(base * light, 0.0, 255.0));
  };
  return {channel(230), channel(200), channel(170), 255};
}

std::vector<Rgba8> MakePicture(std::int64_t content, bool opaque) {
  const Rgba8 background{0, 0, 0, opaque ? std::uint8_t{255} : std::uint8_t{0}};
  std::vector<Rgba8> pixels(kSize * kSize, background);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const std::size_t x = i % kSize;
    const std::size_t y = i / kSize;
    // Facets of a few pixels, as small triangles give: not as smooth as the formula.
    const std::uint64_t facet = x / 4 + kSize * (y / 4);
    const double rough = 0.003 * static_cast<double>(base::RandomBits(1, facet) % 4);
    const double u = static_cast<double>(x) / (0.5 * kSize) - 1;
    const double v = static_cast<double>(y) / (0.5 * kSize) - 1;
    if (content == kBall) {
      const double r2 = (u * u + v * v) / (0.7 * 0.7);
      if (r2 < 1) {
        const double bump = std::cos(50 * u) * std::cos(46 * v);
        pixels[i] = Shade(0.2 + 0.5 * std::sqrt(1 - r2) + 0.1 * bump + rough);
      }
    } else {
      const double height =
          std::sin(21 * u + 2 * std::sin(9 * v)) + std::sin(19 * v + 2 * std::sin(7 * u));
      if (height > -1.4) {
        pixels[i] = Shade(0.5 + 0.2 * height + rough);
      }
    }
  }
  return pixels;
}

void BM_EncodePng(benchmark::State& state) {
  const std::vector<Rgba8> pixels = MakePicture(state.range(0), state.range(1) != 0);
  tbb::task_arena arena(static_cast<int>(state.range(2)));
  std::string png;
  for (auto _ : state) {
    arena.execute([&] { png = EncodePng(kSize, kSize, pixels); });
  }
  state.counters["bytes"] = static_cast<double>(png.size());
}
BENCHMARK(BM_EncodePng)
    ->ArgNames({"waves", "opaque", "threads"})
    ->ArgsProduct({{kBall, kWaves}, {0, 1}, {1, 2}})
    ->MeasureProcessCPUTime()
    ->UseRealTime()
    ->Unit(benchmark::kMillisecond);

void BM_DecodePng(benchmark::State& state) {
  const std::string png = EncodePng(kSize, kSize, MakePicture(state.range(0), false));
  for (auto _ : state) {
    ISOSCOPE_CHECK(DecodePng(png).ok());
  }
}
BENCHMARK(BM_DecodePng)->ArgName("waves")->Arg(kBall)->Arg(kWaves)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isoscope::image
