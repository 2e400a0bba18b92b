// Steps 1 to 3 without a sample: rays, footprints, the occlusion map and its tests; bounds of depth.
// For a volume of 512^3 cells in blocks of 8^3 (262144 blocks) and a picture of 1024 x 1024, on one
// core.

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "benchmark/benchmark.h"

#include "core/base/check.h"
#include "core/base/random.h"
#include "core/view/clip_region.h"
#include "core/visibility/depth_bounds.h"
#include "core/visibility/occluder_selection.h"
#include "core/visibility/occlusion_map.h"
#include "core/volume/range_table.h"
#include "core/volume/scalar_span.h"
#include "core/volume/scalar_type.h"

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

// Returns active blocks: a shell around a sphere that fills the volume's middle, or one block
// in a given number at random places.
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
  volume::BlockSet hits(layout.block_count());
  for (auto _ : *state) {
    rays.Cast(0, rays.count(), active, &hits);
  }
  state->counters["rays"] = static_cast<double>(rays.count());
  state->counters["hits"] = static_cast<double>(hits.Count());
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
  volume::BlockSet hits(layout.block_count());
  rays.Cast(0, rays.count(), active, &hits);
  for (auto _ : state) {
    benchmark::DoNotOptimize(OccludingBlocks(hits, layout, active));
  }
}
BENCHMARK(BM_OccludingBlocks)->Unit(benchmark::kMillisecond);

// The plane of bounds of depth.
void BoundAll(const volume::BlockSet& active, benchmark::State* state) {
  const view::View view = MakeView();
  const volume::BlockLayout layout = MakeLayout();
  const view::Clipper clipper;
  const std::vector<volume::BlockId> ids = active.Ids();
  for (auto _ : *state) {
    DepthBounds bounds(kSize, kSize);
    AddSurfaceBlocks({.view = &view, .layout = &layout, .clipper = &clipper, .ids = ids}, &bounds);
    benchmark::DoNotOptimize(bounds);
  }
  state->counters["active"] = static_cast<double>(active.Count());
}
void BM_DepthBoundsOfShell(benchmark::State& state) { BoundAll(MakeShell(MakeLayout()), &state); }
BENCHMARK(BM_DepthBoundsOfShell)->Unit(benchmark::kMillisecond);
void BM_DepthBoundsOfScattered(benchmark::State& state) {
  BoundAll(MakeScattered(MakeLayout(), 0.3), &state);
}
BENCHMARK(BM_DepthBoundsOfScattered)->Unit(benchmark::kMillisecond);

// An agent's work for a frame besides walking its rays: the active blocks of the whole table, the
// set-up of the rays, the listing of the hits.
void BM_SelectWithoutRays(benchmark::State& state) {
  const view::View view = MakeView();
  const volume::BlockLayout layout = MakeLayout();
  const volume::BlockSet shell = MakeShell(layout);
  const auto type = static_cast<volume::ScalarType>(state.range(0));
  volume::RangeTable table(type, layout.block_count());
  for (std::int64_t id = 0; id < layout.block_count(); ++id) {
    const auto block = static_cast<volume::BlockId>(id);
    table.Set(block, shell.Contains(block) ? volume::ScalarSpan{20, 70} : volume::ScalarSpan{3, 9});
  }
  for (auto _ : state) {
    const volume::BlockSet active = table.ActiveBlocks(50);
    const RaySet rays(view, layout, 1);
    volume::BlockSet hits(layout.block_count());
    rays.Cast(0, 16, active, &hits);
    benchmark::DoNotOptimize(hits.Ids());
  }
  state.SetLabel(std::string(volume::NameOf(type)));
}
BENCHMARK(BM_SelectWithoutRays)
    ->ArgName("type")
    ->Arg(static_cast<int>(volume::ScalarType::kUint8))
    ->Arg(static_cast<int>(volume::ScalarType::kUint16))
    ->Arg(static_cast<int>(volume::ScalarType::kFloat32))
    ->Arg(static_cast<int>(volume::ScalarType::kFloat64))
    ->Unit(benchmark::kMillisecond);

// Footprints of all blocks of the volume, one by one or many at a time.
void BM_Footprints(benchmark::State& state) {
  const view::View view = MakeView();
  const volume::BlockLayout layout = MakeLayout();
  std::vector<volume::BlockId> ids(static_cast<std::size_t>(layout.block_count()));
  std::iota(ids.begin(), ids.end(), 0U);
  std::vector<view::Footprint> footprints(ids.size());
  const auto batch = static_cast<std::size_t>(state.range(0));
  for (auto _ : state) {
    if (batch == 1) {
      for (std::size_t i = 0; i < ids.size(); ++i) {
        footprints[i] = view.FootprintOf(layout, ids[i]);
      }
      continue;
    }
    for (std::size_t i = 0; i < ids.size(); i += batch) {
      view.FootprintsOf(layout, absl::MakeSpan(ids).subspan(i, batch),
                        absl::MakeSpan(footprints).subspan(i, batch));
    }
  }
  state.SetItemsProcessed(state.iterations() * static_cast<std::int64_t>(ids.size()));
}
BENCHMARK(BM_Footprints)
    ->ArgName("at_a_time")
    ->Arg(1)
    ->Arg(16)
    ->Arg(512)
    ->Unit(benchmark::kMillisecond);

// A wall half-way, with holes.
image::FrameImage MakeWall() {
  image::FrameImage image(kSize, kSize);
  for (int y = 0; y < kSize; ++y) {
    for (int x = 0; x < kSize; ++x) {
      const std::size_t i = image.IndexOf(x, y);
      if (base::RandomUnit(5, i / 16) < 0.01) {
        continue;
      }
      const auto depth = static_cast<float>(0.6 + 0.02 * std::sin(static_cast<double>(i) * 0.01));
      image.Set(x, y, image::FragmentKey(depth, 1), {});
    }
  }
  return image;
}

void BM_MapFromImage(benchmark::State& state) {
  const image::FrameImage image = MakeWall();
  for (auto _ : state) {
    benchmark::DoNotOptimize(OcclusionMap::FromImage(image, MapKind::kDepth));
  }
}
BENCHMARK(BM_MapFromImage)->Unit(benchmark::kMillisecond);

// Projects and tests every block of the volume, as if all were active.
void BM_TestAllBlocks(benchmark::State& state) {
  const view::View view = MakeView();
  const volume::BlockLayout layout = MakeLayout();
  const OcclusionMap map = OcclusionMap::FromImage(MakeWall(), MapKind::kDepth);
  std::int64_t hidden = 0;
  for (auto _ : state) {
    hidden = 0;
    for (std::int64_t id = 0; id < layout.block_count(); ++id) {
      hidden += map.Hides(view.FootprintOf(layout, static_cast<volume::BlockId>(id))) ? 1 : 0;
    }
  }
  state.counters["blocks"] = static_cast<double>(layout.block_count());
  state.counters["hidden"] = static_cast<double>(hidden);
}
BENCHMARK(BM_TestAllBlocks)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace isoscope::visibility
