// The path of pixels from the agents to the picture, at 1024 x 1024: the pixel codec, depth
// compositing, the occlusion map and its tests. One thread unless a name says otherwise.
//
// The picture is a bumpy sphere with holes, its blocks 12 pixels wide: smooth depth and shading, as
// isosurfaces have. `agents`: the number of agents that own its blocks at random.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "benchmark/benchmark.h"

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/base/task_arena.h"
#include "core/composite/depth_composite.h"
#include "core/composite/pixel_codec.h"
#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_pixels.h"

namespace isoscope {
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
      const double light = 0.2 + 0.7 * std::abs(z + 0.4 * std::cos(40 * u) * std::cos(37 * v));
      const auto shade = [&](double base) {
        return static_cast<std::uint8_t>(std::min(255.0, base * light));
      };
      image.Set(x, y, image::FragmentKey(static_cast<float>(0.9 - 0.3 * z), block),
                {shade(230), shade(200), shade(170), 255});
    }
  }
  return image;
}

double CoveredPixels(const image::FrameImage& image) {
  return static_cast<double>(image.pixel_count()) -
         static_cast<double>(
             std::count(image.keys.begin(), image.keys.end(), image::kBackgroundKey));
}

void BM_CompositeInto(benchmark::State& state) {
  const image::FrameImage from = MakePicture(500, static_cast<int>(state.range(0)));
  image::FrameImage into(kSize, kSize);
  for (auto _ : state) {
    composite::CompositeInto(from, {.block_count = 1 << 20}, &into);
    benchmark::ClobberMemory();
  }
}
BENCHMARK(BM_CompositeInto)->ArgName("agents")->Arg(1)->Arg(8)->Unit(benchmark::kMillisecond);

void SetSizes(const std::vector<std::string>& bands, const image::FrameImage& image,
              benchmark::State* state) {
  std::size_t size = 0;
  for (const std::string& band : bands) {
    size += band.size();
  }
  state->counters["bytes"] = static_cast<double>(size);
  state->counters["pixels"] =
      benchmark::Counter(CoveredPixels(image), benchmark::Counter::kIsIterationInvariantRate);
}

void BM_EncodePixels(benchmark::State& state) {
  const image::FrameImage image =
      MakePicture(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  std::vector<std::string> bands;
  base::TaskArena arena(1);
  base::RunIn(&arena, [&] {
    for (auto _ : state) {
      bands = composite::EncodePixels(image);
    }
  });
  SetSizes(bands, image, &state);
}
BENCHMARK(BM_EncodePixels)
    ->ArgNames({"radius", "agents"})
    ->Args({800, 1})
    ->Args({500, 1})
    ->Args({500, 8})
    ->Unit(benchmark::kMillisecond);

void BM_DecodePixelsInto(benchmark::State& state) {
  const image::FrameImage image =
      MakePicture(static_cast<int>(state.range(0)), static_cast<int>(state.range(1)));
  const std::vector<std::string> bands = composite::EncodePixels(image);
  const auto pool = image::FrameImagePool::Make(std::size_t{1} << 26);
  for (auto _ : state) {
    image::FrameImage into = pool->Take(kSize, kSize);
    for (const std::string& band : bands) {
      ISOSCOPE_CHECK(
          composite::DecodePixelsInto(band, {.block_count = 1 << 20}, {1, 1}, &into).ok());
    }
    state.PauseTiming();  // clearing the image
    into = image::FrameImage();
    state.ResumeTiming();
  }
  SetSizes(bands, image, &state);
}
BENCHMARK(BM_DecodePixelsInto)
    ->ArgNames({"radius", "agents"})
    ->Args({800, 1})
    ->Args({500, 1})
    ->Args({500, 8})
    ->Unit(benchmark::kMillisecond);

void BM_FlattenOver(benchmark::State& state) {
  image::FrameImage image = MakePicture(500, 1);
  for (auto _ : state) {
    composite::FlattenOver({0, 0, 0, 255}, &image);
    benchmark::ClobberMemory();
  }
}
BENCHMARK(BM_FlattenOver)->Unit(benchmark::kMillisecond)->UseRealTime();

void BM_MapFromImage(benchmark::State& state) {
  const image::FrameImage image = MakePicture(static_cast<int>(state.range(0)), 1);
  base::TaskArena arena(static_cast<int>(state.range(1)));
  for (auto _ : state) {
    base::RunIn(&arena, [&] {
      benchmark::DoNotOptimize(
          visibility::OcclusionMap::FromImage(image, visibility::MapKind::kDepth));
    });
  }
}
BENCHMARK(BM_MapFromImage)
    ->ArgNames({"radius", "threads"})
    ->Args({800, 1})
    ->Args({500, 1})
    ->Args({500, 2})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

// Blocks as large on the screen as `size` pixels, behind and before the picture.
std::vector<view::Footprint> MakeFootprints(int size) {
  std::vector<view::Footprint> footprints;
  for (std::uint64_t i = 0; i < 4096; ++i) {
    const auto begin = [&](std::uint64_t axis) {
      return static_cast<int>(base::RandomUnit(7, 4 * i + axis) * (kSize - size));
    };
    const int x = begin(0);
    const int y = begin(1);
    footprints.push_back({{x, y, x + size, y + size},
                          static_cast<float>(0.6 + 0.3 * base::RandomUnit(7, 4 * i + 2))});
  }
  return footprints;
}

void BM_Hides(benchmark::State& state) {
  const auto map =
      visibility::OcclusionMap::FromImage(MakePicture(500, 1), visibility::MapKind::kDepth);
  const auto footprints = MakeFootprints(static_cast<int>(state.range(0)));
  std::int64_t hidden = 0;
  for (auto _ : state) {
    hidden = 0;
    for (const view::Footprint& footprint : footprints) {
      hidden += map.Hides(footprint) ? 1 : 0;
    }
  }
  state.counters["hidden"] = static_cast<double>(hidden);
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(footprints.size()));
}
BENCHMARK(BM_Hides)->ArgName("size")->Arg(10)->Arg(20)->Arg(60);

void BM_OpenPixels(benchmark::State& state) {
  const auto map =
      visibility::OcclusionMap::FromImage(MakePicture(500, 1), visibility::MapKind::kDepth);
  const auto footprints = MakeFootprints(static_cast<int>(state.range(0)));
  for (auto _ : state) {
    for (const view::Footprint& footprint : footprints) {
      benchmark::DoNotOptimize(map.OpenPixels(footprint));
    }
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(footprints.size()));
}
BENCHMARK(BM_OpenPixels)->ArgName("size")->Arg(10)->Arg(20)->Arg(60);

// The masks of 4096 blocks, there and back.
void BM_SendOpenPixels(benchmark::State& state) {
  const auto map =
      visibility::OcclusionMap::FromImage(MakePicture(500, 1), visibility::MapKind::kDepth);
  std::vector<image::PixelMask> masks;
  std::vector<view::PixelRect> rects;
  for (const view::Footprint& footprint : MakeFootprints(static_cast<int>(state.range(0)))) {
    masks.push_back(map.OpenPixels(footprint));
    rects.push_back(footprint.rect);
  }
  std::string bytes;
  for (auto _ : state) {
    bytes = visibility::EncodeOpenPixels(masks);
    ISOSCOPE_CHECK(visibility::DecodeOpenPixels(bytes, rects).ok());
  }
  state.counters["bytes"] = static_cast<double>(bytes.size());
}
BENCHMARK(BM_SendOpenPixels)
    ->ArgName("size")
    ->Arg(10)
    ->Arg(20)
    ->Arg(60)
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isoscope
