// The coordinator's work on composited pixels, for a picture of 1024 x 1024 with a bumpy sphere on
// three quarters of it: ambient occlusion, silhouettes, the mean of samples. One thread. `samples`
// is per side.

#include <cmath>
#include <cstdint>
#include <string>

#include "benchmark/benchmark.h"
#include <oneapi/tbb/task_arena.h>

#include "core/base/check.h"
#include "core/picture/ambient_occlusion.h"
#include "core/picture/downsample.h"
#include "core/picture/silhouette.h"
#include "core/view/unprojection.h"

namespace isoscope {
namespace {

constexpr int kSize = 1024;

view::View MakeView(int size) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {101, 101, 101};
  auto view = view::View::Make(view::MakeDefaultCamera(geometry.Bounds()), {size, size}, geometry);
  ISOSCOPE_CHECK(view.ok());
  return *view;
}

image::FrameImage MakePicture(const view::View& view) {
  const int size = view.viewport().width_px;
  image::FrameImage image(size, size);
  for (int y = 0; y < size; ++y) {
    for (int x = 0; x < size; ++x) {
      const double u = 2.05 * (x + 0.5) / size - 1.025;
      const double v = 2.05 * (y + 0.5) / size - 1.025;
      if (u * u + v * v >= 1) {
        continue;
      }
      const double bump = 0.02 * std::sin(40 * u) * std::cos(37 * v);
      const double z = 0.8 * std::sqrt(1 - u * u - v * v) + bump;
      const double light = 0.2 + 0.7 * z;
      const auto shade = [&](double base) { return static_cast<std::uint8_t>(base * light); };
      image.Set(x, y, image::FragmentKey(static_cast<float>(0.9 - 0.3 * z), 7),
                {shade(230), shade(200), shade(170), 255});
    }
  }
  return image;
}

void BM_AmbientOcclusion(benchmark::State& state) {
  const auto samples = static_cast<int>(state.range(0));
  const view::View view = MakeView(kSize * samples);
  image::FrameImage image = MakePicture(view);
  tbb::task_arena arena(1);
  for (auto _ : state) {
    arena.execute([&] { picture::ShadeAmbientOcclusion({}, view, samples, &image); });
  }
}
BENCHMARK(BM_AmbientOcclusion)->ArgName("samples")->Arg(1)->Arg(2)->Unit(benchmark::kMillisecond);

void BM_Silhouettes(benchmark::State& state) {
  const auto samples = static_cast<int>(state.range(0));
  const view::View view = MakeView(kSize * samples);
  image::FrameImage image = MakePicture(view);
  const image::FragmentOrder order{.block_count = 100};
  tbb::task_arena arena(1);
  for (auto _ : state) {
    arena.execute([&] {
      picture::DrawSilhouettes({.width_px = static_cast<int>(state.range(1)), .color = {}}, view,
                               order, samples, &image);
    });
  }
}
BENCHMARK(BM_Silhouettes)
    ->ArgNames({"samples", "width"})
    ->ArgsProduct({{1, 2}, {2, 16}})
    ->Unit(benchmark::kMillisecond);

void BM_Downsample(benchmark::State& state) {
  const auto samples = static_cast<int>(state.range(0));
  const image::FrameImage drawn = MakePicture(MakeView(kSize * samples));
  image::FrameImage picture(kSize, kSize);
  tbb::task_arena arena(1);
  for (auto _ : state) {
    arena.execute([&] {
      picture::Downsample(drawn, {.samples_per_side = samples}, {0, 0, 0, 255}, &picture);
    });
  }
}
BENCHMARK(BM_Downsample)->ArgName("samples")->Arg(2)->Arg(3)->Arg(4)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isoscope
