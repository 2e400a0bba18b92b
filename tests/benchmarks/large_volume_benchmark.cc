// Steps 0 and 1 of a frame and the coordinator's culling in volumes of up to 2.4 x 10^8 blocks, which
// have no samples: the table is a function of the block. A wavy shell fills the middle of the volume,
// and the picture is 1024 x 1024. On one core.
//
//   build/release/benchmarks/large_volume_benchmark --benchmark_filter='side:(160|625)'
//
// A side of 160 blocks is 4.1 x 10^6 of them, one of 625 is 2.4 x 10^8. Each benchmark by trees says
// whether its result equals that of the walk from block to block, and of a test of each block.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include "benchmark/benchmark.h"

#include "core/visibility/occluder_selection.h"
#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_blocks.h"
#include "core/volume/block_tree.h"
#include "core/volume/range_table.h"
#include "core/volume/span_octree.h"

namespace isoscope::visibility {
namespace {

constexpr int kPicturePx = 1024;
constexpr std::int64_t kBlockCells = 8;
constexpr double kIsovalue = 30000;
constexpr double kCenterDepth = 0.4;  // of the shell's radius, in sides of the volume

// Pages of a table whose spans are a function of the block: the distance from the centre, with
// waves, in 60000ths of the side.
class ShellPages final : public volume::SpanPages {
 public:
  explicit ShellPages(std::int64_t side)
      : layout_({side, side, side}), waves_(static_cast<std::size_t>(side) + 1) {
    for (std::int64_t i = 0; i <= side; ++i) {
      waves_[static_cast<std::size_t>(i)] =
          0.01 * std::sin(40 * static_cast<double>(i) / static_cast<double>(side));
    }
  }

  absl::StatusOr<std::shared_ptr<const std::string>> Load(std::int64_t page) override {
    const math::Index3 begin = layout_.BeginOf(page);
    const math::Index3& dims = layout_.block_dims;
    volume::RangeTable spans(volume::ScalarType::kUint16, volume::SpanPageLayout::kPageSpans);
    constexpr std::int64_t kSide = volume::SpanPageLayout::kPageSide;
    for (std::int64_t z = begin.z; z < std::min(begin.z + kSide, dims.z); ++z) {
      for (std::int64_t y = begin.y; y < std::min(begin.y + kSide, dims.y); ++y) {
        for (std::int64_t x = begin.x; x < std::min(begin.x + kSide, dims.x); ++x) {
          spans.Set(static_cast<volume::BlockId>(layout_.PlaceOf({x, y, z}).span),
                    SpanOf({x, y, z}));
        }
      }
    }
    return std::make_shared<const std::string>(spans.bytes());
  }
  [[nodiscard]] std::size_t size_bytes() const override {
    return waves_.size() * sizeof(waves_[0]);
  }

  // Returns the span of a page without a look at each block: the field changes by at most the
  // distance and the waves.
  [[nodiscard]] volume::ScalarSpan PageSpanOf(std::int64_t page) const {
    const math::Index3 begin = layout_.BeginOf(page);
    const double side = static_cast<double>(layout_.block_dims.x);
    const double half = 0.5 * static_cast<double>(volume::SpanPageLayout::kPageSide);
    const math::Vec3d center{static_cast<double>(begin.x) + half - side / 2,
                             static_cast<double>(begin.y) + half - side / 2,
                             static_cast<double>(begin.z) + half - side / 2};
    const double distance = math::Length(center) / side;
    const double reach = std::sqrt(3.0) * (half + 1) / side + 0.03;
    return {std::floor(ValueOf(distance - reach)), std::ceil(ValueOf(distance + reach))};
  }

 private:
  static double ValueOf(double distance) {
    return std::clamp(60000 * distance + kIsovalue - 60000 * kCenterDepth, 0.0, 65535.0);
  }
  [[nodiscard]] volume::ScalarSpan SpanOf(const math::Index3& block) const {
    const double side = static_cast<double>(layout_.block_dims.x);
    const math::Vec3d p{static_cast<double>(block.x) + 0.5 - side / 2,
                        static_cast<double>(block.y) + 0.5 - side / 2,
                        static_cast<double>(block.z) + 0.5 - side / 2};
    const double distance = math::Length(p) / side + waves_[static_cast<std::size_t>(block.x)] +
                            waves_[static_cast<std::size_t>(block.y)] +
                            waves_[static_cast<std::size_t>(block.z)];
    const double half = 0.9 / side;  // half a block's diagonal
    return {std::floor(ValueOf(distance - half)), std::ceil(ValueOf(distance + half))};
  }

  const volume::SpanPageLayout layout_;
  std::vector<double> waves_;
};

struct Scene {
  Scene(std::int64_t side, std::int64_t max_face_rays)
      : layout(*volume::BlockLayout::Make(
            {side * kBlockCells + 1, side * kBlockCells + 1, side * kBlockCells + 1},
            {kBlockCells, kBlockCells, kBlockCells})),
        view(MakeView(layout.sample_dims())),
        octree(MakeOctree(side)),
        active(*octree.ActiveBlocks(volume::InsideRule::OfIsovalue(kIsovalue))),
        cubes(active),
        rays(view, layout, 1, max_face_rays),
        map(OcclusionMap::FromImage(MakeImage(), MapKind::kDepth)) {}

  static view::View MakeView(const math::Index3& samples) {
    volume::GridGeometry geometry;
    geometry.sample_dims = samples;
    view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
    view::Azimuth(0.5, &camera);
    view::Elevation(0.35, &camera);
    view::OrthogonalizeUp(&camera);
    return *view::View::Make(camera, {kPicturePx, kPicturePx}, geometry);
  }

  static volume::SpanOctree MakeOctree(std::int64_t side) {
    auto pages = std::make_shared<ShellPages>(side);
    const math::Index3 dims{side, side, side};
    const std::int64_t page_count = volume::SpanPageLayout(dims).page_count();
    volume::RangeTable spans(volume::ScalarType::kUint16, page_count);
    for (std::int64_t page = 0; page < page_count; ++page) {
      spans.Set(static_cast<volume::BlockId>(page), pages->PageSpanOf(page));
    }
    return volume::SpanOctree(dims, std::move(spans), std::move(pages));
  }

  std::vector<std::uint64_t> Hits() const {
    std::vector<std::uint64_t> marks(active.words().size());
    rays.Cast(0, rays.count(), active, absl::MakeSpan(marks));
    return marks;
  }

  // A picture as step 2 leaves it: each occluding block covers the pixels in the middle of its
  // rectangle.
  image::FrameImage MakeImage() const {
    image::FrameImage image(kPicturePx, kPicturePx);
    const std::vector<volume::BlockId> ids = active.IdsOf(active.WithNeighbours(Hits()));
    for (const volume::BlockId id : ids) {
      const view::Footprint footprint = view.FootprintOf(layout, id);
      const view::PixelRect& rect = footprint.rect;
      const float depth = std::min(1.0F, footprint.nearest_depth + 0.001F);  // about a block behind
      for (int y = rect.begin_y; y < rect.end_y; ++y) {
        for (int x = rect.begin_x; x < rect.end_x; ++x) {
          const std::uint64_t key = image::FragmentKey(depth, 1);
          if (key < image.keys[image.IndexOf(x, y)]) {
            image.Set(x, y, key, {});
          }
        }
      }
    }
    return image;
  }

  const volume::BlockLayout layout;
  const view::View view;
  const volume::SpanOctree octree;
  const volume::BlockTree active;
  const BlockCubes cubes;
  const RaySet rays;
  const OcclusionMap map;
};

// Made once: the larger one takes some seconds.
const Scene& SceneOf(benchmark::State& state, std::int64_t max_face_rays = RaySet::kMaxFaceRays) {
  static auto& scenes =
      *new std::map<std::pair<std::int64_t, std::int64_t>, std::unique_ptr<Scene>>;
  std::unique_ptr<Scene>& scene = scenes[{state.range(0), max_face_rays}];
  if (scene == nullptr) {
    scene = std::make_unique<Scene>(state.range(0), max_face_rays);
  }
  state.counters["blocks"] = static_cast<double>(scene->layout.block_count());
  state.counters["active"] = static_cast<double>(scene->active.count());
  return *scene;
}

void Sides(benchmark::internal::Benchmark* bench) {
  bench->ArgName("side")->Arg(40)->Arg(160)->Arg(625)->Unit(benchmark::kMillisecond);
}

// Step 0 of a rule that is new: the pages of the table are made by their function.
void BM_FirstActiveBlocks(benchmark::State& state) {
  const Scene& scene = SceneOf(state);
  for (auto _ : state) {
    benchmark::DoNotOptimize(scene.octree.ActiveBlocks(volume::InsideRule::OfIsovalue(kIsovalue)));
  }
  state.counters["octree_bytes"] = static_cast<double>(scene.octree.size_bytes());
  state.counters["active_tree_bytes"] = static_cast<double>(scene.active.size_bytes());
  state.counters["table_bytes"] = 4.0 * static_cast<double>(scene.layout.block_count());
}
BENCHMARK(BM_FirstActiveBlocks)->Apply(Sides);

// Step 1, and the blocks that occlude.
void BM_RaysThroughTree(benchmark::State& state) {
  const Scene& scene = SceneOf(state);
  std::vector<volume::BlockId> hits;
  for (auto _ : state) {
    hits = scene.active.IdsOf(scene.Hits());
  }
  state.counters["rays"] = static_cast<double>(scene.rays.count());
  state.counters["hits"] = static_cast<double>(hits.size());
  const volume::BlockSet set = scene.active.ToSet();
  volume::BlockSet expected(scene.layout.block_count());
  scene.rays.Cast(0, scene.rays.count(), set, &expected);
  state.counters["equal"] = hits == expected.Ids() ? 1 : 0;
}
BENCHMARK(BM_RaysThroughTree)->Apply(Sides);

void BM_RaysFromBlockToBlock(benchmark::State& state) {
  const Scene& scene = SceneOf(state);
  const volume::BlockSet set = scene.active.ToSet();
  volume::BlockSet hits(scene.layout.block_count());
  for (auto _ : state) {
    scene.rays.Cast(0, scene.rays.count(), set, &hits);
  }
}
BENCHMARK(BM_RaysFromBlockToBlock)->Apply(Sides);

void BM_OccludersOfTree(benchmark::State& state) {
  const Scene& scene = SceneOf(state);
  const std::vector<std::uint64_t> hits = scene.Hits();
  std::vector<volume::BlockId> occluders;
  for (auto _ : state) {
    occluders = scene.active.IdsOf(scene.active.WithNeighbours(hits));
  }
  state.counters["occluders"] = static_cast<double>(occluders.size());
  const volume::BlockSet expected =
      OccludingBlocks(volume::BlockSet(scene.layout.block_count(), scene.active.IdsOf(hits)),
                      scene.layout, scene.active.ToSet());
  state.counters["equal"] = occluders == expected.Ids() ? 1 : 0;
}
BENCHMARK(BM_OccludersOfTree)->Apply(Sides);

// The coordinator's culling: the active blocks that are neither drawn nor hidden.
void BM_CullByCubes(benchmark::State& state) {
  const Scene& scene = SceneOf(state);
  const std::vector<std::uint64_t> drawn = scene.active.WithNeighbours(scene.Hits());
  std::vector<std::uint64_t> open;
  for (auto _ : state) {
    open = scene.cubes.OpenBlocks(scene.view, scene.layout, {}, scene.map, drawn);
  }
  const std::vector<volume::BlockId> ids = scene.active.IdsOf(open);
  state.counters["open"] = static_cast<double>(ids.size());
  std::vector<volume::BlockId> expected;
  std::vector<std::uint64_t> others(drawn.size());
  std::transform(drawn.begin(), drawn.end(), scene.active.words().begin(), others.begin(),
                 [](std::uint64_t skipped, std::uint64_t word) { return word & ~skipped; });
  for (const volume::BlockId id : scene.active.IdsOf(others)) {
    const view::Footprint footprint = scene.view.FootprintOf(scene.layout, id);
    if (!footprint.rect.empty() && !scene.map.Hides(footprint)) {
      expected.push_back(id);
    }
  }
  state.counters["equal"] = ids == expected ? 1 : 0;
}
BENCHMARK(BM_CullByCubes)->Apply(Sides);

// What rays through all boundary faces would find: blocks that occlude, and blocks that are open
// behind them, beside those of the rays that are cast.
void BM_RaysThroughAllFaces(benchmark::State& state) {
  constexpr std::int64_t kAll = std::int64_t{1} << 40;
  const Scene& all = SceneOf(state, kAll);
  const Scene& cast = SceneOf(state);
  for (auto _ : state) {
    benchmark::DoNotOptimize(all.Hits());
  }
  const auto count = [&](const char* of, const Scene& scene) {
    const std::vector<std::uint64_t> drawn = scene.active.WithNeighbours(scene.Hits());
    const auto open = scene.cubes.OpenBlocks(scene.view, scene.layout, {}, scene.map, drawn);
    state.counters[std::string(of) + "_rays"] = static_cast<double>(scene.rays.count());
    state.counters[std::string(of) + "_occluders"] =
        static_cast<double>(scene.active.IdsOf(drawn).size());
    state.counters[std::string(of) + "_open"] =
        static_cast<double>(scene.active.IdsOf(open).size());
  };
  count("all", all);
  count("cast", cast);
}
BENCHMARK(BM_RaysThroughAllFaces)->Apply(Sides);

void BM_CullBlockByBlock(benchmark::State& state) {
  const Scene& scene = SceneOf(state);
  const std::vector<volume::BlockId> ids = scene.active.Ids();
  std::vector<view::Footprint> footprints(ids.size());
  for (auto _ : state) {
    scene.view.FootprintsOf(scene.layout, ids, absl::MakeSpan(footprints));
    std::int64_t open = 0;
    for (const view::Footprint& footprint : footprints) {
      open += footprint.rect.empty() || scene.map.Hides(footprint) ? 0 : 1;
    }
    benchmark::DoNotOptimize(open);
  }
}
BENCHMARK(BM_CullBlockByBlock)->Apply(Sides);

}  // namespace
}  // namespace isoscope::visibility
