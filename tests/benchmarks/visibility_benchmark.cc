// Steps 1 to 3 without a sample: rays, footprints, the occlusion map and its tests, for a volume of
// 512^3 cells in blocks of 8^3 (262144 blocks) and a picture of 1024 x 1024, on one core.

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "benchmark/benchmark.h"

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/occlusion_map.h"

namespace isoscope::visibility {
namespace {

constexpr int kSize = 1024;

view::View MakeView() {
  volume::GridGeometry geometry;
  geometry.sample_dims = {513, 513, 513};
  view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
  view::Azimuth(0.5, &camera);
  view::Elevation(0.35, &camera);
  view::OrthogonalizeUp(&camera);
  auto view = view::View::Make(camera, {kSize, kSize}, geometry);
  ISOSCOPE_CHECK(view.ok());
  return *std::move(view);
}

volume::BlockLayout MakeLayout() {
  auto layout = volume::BlockLayout::Make({513, 513, 513}, {8, 8, 8});
  ISOSCOPE_CHECK(layout.ok());
  return *std::move(layout);
}

// Active blocks: a shell around a sphere that fills the volume's middle, or one in so many
// anywhere.
volume::BlockSet MakeShell(const volume::BlockLayout& layout) {
  volume::BlockSet active(layout.block_count());
  for (std::int64_t id = 0; id < layout.block_count(); ++id) {
    const math::Index3 index = layout.IndexOf(static_cast<volume::BlockId>(id));
    const math::Vec3d p{static_cast<double>(index.x) - 31.5, static_cast<double>(index.y) - 31.5,
                        static_cast<double>(index.z) - 31.5};
    if (std::abs(math::Length(p) - 25) < 1) {
      active.Insert(static_cast<volume::BlockId>(id));
    }
  }
  return active;
}
volume::BlockSet MakeScattered(const volume::BlockLayout& layout, double share) {
  volume::BlockSet active(layout.block_count());
  for (std::int64_t id = 0; id < layout.block_count(); ++id) {
    if (base::RandomUnit(3, static_cast<std::uint64_t>(id)) < share) {
      active.Insert(static_cast<volume::BlockId>(id));
    }
  }
  return active;
}

void CastAll(const volume::BlockSet& active, benchmark::State* state) {
  const view::View view = MakeView();
  const volume::BlockLayout layout = MakeLayout();
  const RaySet rays(view, layout, 1);
  std::size_t hits = 0;
  for (auto _ : *state) {
    hits = rays.Cast(0, rays.count(), active).size();
  }
  state->counters["rays"] = static_cast<double>(rays.count());
  state->counters["hits"] = static_cast<double>(hits);
  state->counters["active"] = static_cast<double>(active.Count());
}
void BM_CastShell(benchmark::State& state) { CastAll(MakeShell(MakeLayout()), &state); }
BENCHMARK(BM_CastShell)->Unit(benchmark::kMillisecond);
void BM_CastEmpty(benchmark::State& state) { CastAll(MakeScattered(MakeLayout(), 0), &state); }
BENCHMARK(BM_CastEmpty)->Unit(benchmark::kMillisecond);
void BM_CastScattered(benchmark::State& state) {
  CastAll(MakeScattered(MakeLayout(), 0.3), &state);
}
BENCHMARK(BM_CastScattered)->Unit(benchmark::kMillisecond);

void BM_OccludingBlocks(benchmark::State& state) {
  const view::View view = MakeView();
  const volume::BlockLayout layout = MakeLayout();
  const volume::BlockSet active = MakeScattered(layout, 0.3);
  const RaySet rays(view, layout, 1);
  const std::vector<volume::BlockId> hits = rays.Cast(0, rays.count(), active);
  for (auto _ : state) {
    benchmark::DoNotOptimize(OccludingBlocks(hits, layout, active));
  }
}
BENCHMARK(BM_OccludingBlocks)->Unit(benchmark::kMillisecond);

// A wall half-way, with holes.
image::FrameImage MakeWall() {
  image::FrameImage image(kSize, kSize);
  for (std::size_t i = 0; i < image.pixel_count(); ++i) {
    if (base::RandomUnit(5, i / 16) < 0.01) {
      continue;
    }
    image.depth[i] = static_cast<float>(0.6 + 0.02 * std::sin(static_cast<double>(i) * 0.01));
    image.block_id[i] = 1;
  }
  return image;
}

void BM_MapFromImage(benchmark::State& state) {
  const view::View view = MakeView();
  const DepthQuantizer quantizer(view);
  const image::FrameImage image = MakeWall();
  for (auto _ : state) {
    benchmark::DoNotOptimize(OcclusionMap::FromImage(image, quantizer, MapKind::kDepth,
                                                     static_cast<int>(state.range(0))));
  }
}
BENCHMARK(BM_MapFromImage)->ArgName("level")->DenseRange(0, 3)->Unit(benchmark::kMillisecond);

void BM_MapEncode(benchmark::State& state) {
  const DepthQuantizer quantizer(MakeView());
  const OcclusionMap map = OcclusionMap::FromImage(MakeWall(), quantizer, MapKind::kDepth,
                                                   static_cast<int>(state.range(0)));
  std::string bytes;
  for (auto _ : state) {
    bytes = map.Encode();
  }
  state.counters["bytes"] = static_cast<double>(bytes.size());
}
BENCHMARK(BM_MapEncode)->ArgName("level")->DenseRange(0, 3)->Unit(benchmark::kMillisecond);

void BM_MapDecode(benchmark::State& state) {
  const DepthQuantizer quantizer(MakeView());
  const std::string bytes = OcclusionMap::FromImage(MakeWall(), quantizer, MapKind::kDepth,
                                                    static_cast<int>(state.range(0)))
                                .Encode();
  for (auto _ : state) {
    benchmark::DoNotOptimize(OcclusionMap::Decode(bytes, {kSize, kSize}));
  }
}
BENCHMARK(BM_MapDecode)->ArgName("level")->DenseRange(0, 3)->Unit(benchmark::kMillisecond);

// Projects and tests every block of the volume, as if all were active and one agent had them.
void BM_TestAllBlocks(benchmark::State& state) {
  const view::View view = MakeView();
  const volume::BlockLayout layout = MakeLayout();
  const DepthQuantizer quantizer(view);
  const OcclusionMap map = OcclusionMap::FromImage(MakeWall(), quantizer, MapKind::kDepth,
                                                   static_cast<int>(state.range(0)));
  std::int64_t hidden = 0;
  for (auto _ : state) {
    hidden = 0;
    for (std::int64_t id = 0; id < layout.block_count(); ++id) {
      const view::Footprint footprint = view.FootprintOf(layout, static_cast<volume::BlockId>(id));
      hidden += map.Hides(footprint, quantizer) ? 1 : 0;
    }
  }
  state.counters["blocks"] = static_cast<double>(layout.block_count());
  state.counters["hidden"] = static_cast<double>(hidden);
}
BENCHMARK(BM_TestAllBlocks)->ArgName("level")->Arg(0)->Arg(2)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isoscope::visibility
