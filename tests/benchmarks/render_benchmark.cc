// Drawing of isosurface blocks that are in memory, 1024 x 1024:
//
//   BM_Frame/<back end>/<block edge>/<pixels a cell>    all blocks of a volume of 256^3 cells
//   BM_Target/<instruction set>/...                     the same, CPU back end
//   BM_Share/<back end>                                 every 16th block
//   BM_EmptyPass/<back end>                             no block at all
//
// add_ns_per_triangle is the CPU time of Add (EGL only queues there); finish_ns_per_pixel that of
// Finish over the pixels that are drawn on. Both are the least of all rounds, of the whole process.

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <ctime>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "benchmark/benchmark.h"

#include "core/base/check.h"
#include "core/render/cpu_renderer.h"
#include "core/render/egl_renderer.h"
#include "core/render/renderer.h"
#include "hwy/targets.h"
#include "tests/support/block_cutter.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::render {
namespace {

constexpr std::int64_t kSamples = 257;
constexpr int kViewportPx = 1024;
// Drawn between two looks at the clock.
constexpr std::size_t kWarmBlocks = 64;

using MeshPtr = std::shared_ptr<const mesh::CompactMesh>;

struct Blocks {
  volume::BlockLayout layout;
  std::vector<MeshPtr> meshes;
  std::int64_t triangle_count = 0;
};

const Blocks& BlocksOf(std::int64_t block_edge) {
  static std::map<std::int64_t, Blocks> cache;
  static const std::string bytes =
      testing::SampleField(testing::RandomField(3, 6, 10), {kSamples, kSamples, kSamples},
                           volume::ScalarType::kUint8, 50, 100);
  const auto [entry, is_new] = cache.try_emplace(block_edge);
  Blocks& blocks = entry->second;
  if (is_new) {
    volume::GridGeometry geometry;
    geometry.sample_dims = {kSamples, kSamples, kSamples};
    blocks.layout =
        volume::BlockLayout::Make(geometry.sample_dims, {block_edge, block_edge, block_edge})
            .value();
    extract::BlockExtractor extractor(geometry, blocks.layout);
    for (std::int64_t id = 0; id < blocks.layout.block_count(); ++id) {
      const auto block_id = static_cast<volume::BlockId>(id);
      const std::string block =
          testing::CutBlock(blocks.layout, volume::ScalarType::kUint8, bytes, block_id);
      const mesh::BlockMeshView mesh =
          extractor.Extract({block_id, volume::ScalarType::kUint8, block.data()}, 100.5);
      if (mesh.triangle_count() > 0) {
        blocks.triangle_count += mesh.triangle_count();
        blocks.meshes.push_back(mesh::Compact(mesh));
      }
    }
  }
  return blocks;
}

// Width in pixels of a cell in the middle of the volume.
view::View MakeView(double cell_px) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {kSamples, kSamples, kSamples};
  view::Camera camera = view::MakeDefaultCamera(geometry.Bounds());
  view::Azimuth(0.4, &camera);
  view::Elevation(0.3, &camera);
  view::OrthogonalizeUp(&camera);
  const double distance = math::Length(camera.target - camera.eye);
  const double shown_cells = 2 * distance * std::tan(camera.fov_y_radians / 2);
  view::Zoom(cell_px * shown_cells / kViewportPx, &camera);
  return view::View::Make(camera, {kViewportPx, kViewportPx}, geometry).value();
}

double CpuSeconds() {
  std::timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

Renderer& RendererOf(const std::string& name) {
  static std::map<std::string, std::unique_ptr<Renderer>> renderers;
  std::unique_ptr<Renderer>& renderer = renderers[name];
  if (renderer == nullptr) {
    if (name == "egl") {
      renderer = EglRenderer::Make({}).value();
    } else {
      renderer = MakeCpuRenderer(CpuRendererOptions{});
    }
  }
  return *renderer;
}

// Reads the mesh.
std::uint32_t TouchAll(const mesh::CompactMesh& mesh) {
  std::uint32_t sum = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); i += 8) {
    sum += mesh.triangles[i][0];
  }
  for (std::size_t i = 0; i < mesh.positions.size(); i += 4) {
    sum += std::bit_cast<std::uint32_t>(mesh.positions[i].x);
  }
  return sum;
}

void Draw(benchmark::State& state, Renderer* renderer, std::int64_t block_edge, double cell_px,
          std::size_t stride) {
  const Blocks& blocks = BlocksOf(block_edge);
  const view::View view = MakeView(cell_px);
  frame::FrameSpec spec;
  spec.surfaces.resize(1);
  double add = std::numeric_limits<double>::infinity();
  double finish = add;
  std::int64_t covered = 0;
  double triangles = 0;
  double drawn = 0;
  for (auto unused : state) {
    auto pass = renderer->BeginPass(view, blocks.layout, spec).value();
    triangles = 0;
    drawn = 0;
    double add_round = 0;
    for (std::size_t begin = 0; begin < blocks.meshes.size(); begin += kWarmBlocks * stride) {
      // Meshes come from extraction, so they are in the cache.
      const std::size_t end = std::min(begin + kWarmBlocks * stride, blocks.meshes.size());
      std::uint32_t sum = 0;
      for (std::size_t i = begin; i < end; i += stride) {
        sum += TouchAll(*blocks.meshes[i]);
      }
      benchmark::DoNotOptimize(sum);
      const double start = CpuSeconds();
      for (std::size_t i = begin; i < end; i += stride) {
        ISOSCOPE_CHECK(pass->Add(blocks.meshes[i]).ok());
        triangles += static_cast<double>(blocks.meshes[i]->triangle_count());
        ++drawn;
      }
      add_round += CpuSeconds() - start;
    }
    const double middle = CpuSeconds();
    const image::FrameImage image = pass->Finish(base::Cancellation()).value();
    const double end = CpuSeconds();
    add = std::min(add, add_round);
    finish = std::min(finish, end - middle);
    if (covered == 0) {
      covered = std::count_if(image.keys.begin(), image.keys.end(), [](std::uint64_t key) {
        return image::OwnerOf(key) != image::kNoOwner;
      });
    }
  }
  state.counters["add_ns_per_triangle"] = add * 1e9 / triangles;
  state.counters["add_ns_per_block"] = add * 1e9 / drawn;
  state.counters["finish_ns_per_pixel"] = finish * 1e9 / static_cast<double>(covered);
  state.counters["blocks"] = drawn;
  state.counters["triangles"] = triangles;
  state.counters["pixels"] = static_cast<double>(covered);
}

void EmptyPass(benchmark::State& state, Renderer* renderer) {
  const Blocks& blocks = BlocksOf(8);
  const view::View view = MakeView(2);
  frame::FrameSpec spec;
  spec.surfaces.resize(1);
  for (auto unused : state) {
    auto pass = renderer->BeginPass(view, blocks.layout, spec).value();
    benchmark::DoNotOptimize(pass->Finish(base::Cancellation()));
  }
}

void RegisterBackEnd(const std::string& name) {
  struct Case {
    std::int64_t block_edge;
    double cell_px;
  };
  for (const Case& c :
       {Case{8, 1}, Case{8, 2}, Case{8, 4}, Case{8, 16}, Case{16, 1}, Case{16, 2}, Case{16, 8}}) {
    const std::string title = "BM_Frame/" + name + "/" + std::to_string(c.block_edge) + "/" +
                              std::to_string(static_cast<int>(c.cell_px));
    benchmark::RegisterBenchmark(title.c_str(), [name, c](benchmark::State& state) {
      Draw(state, &RendererOf(name), c.block_edge, c.cell_px, 1);
    })->Unit(benchmark::kMillisecond);
  }
  benchmark::RegisterBenchmark(("BM_Share/" + name).c_str(), [name](benchmark::State& state) {
    Draw(state, &RendererOf(name), 8, 2, 16);
  })->Unit(benchmark::kMillisecond);
  benchmark::RegisterBenchmark(("BM_EmptyPass/" + name).c_str(), [name](benchmark::State& state) {
    EmptyPass(state, &RendererOf(name));
  })->Unit(benchmark::kMicrosecond);
}

const bool kRegistered = [] {
  RegisterBackEnd("cpu");
  RegisterBackEnd("egl");
  for (std::int64_t rest = hwy::SupportedTargets() & HWY_TARGETS; rest != 0; rest &= rest - 1) {
    const std::int64_t target = rest & -rest;
    for (const double cell_px : {1.0, 4.0}) {
      const std::string title = std::string("BM_Target/") + hwy::TargetName(target) + "/8/" +
                                std::to_string(static_cast<int>(cell_px));
      benchmark::RegisterBenchmark(title.c_str(), [target, cell_px](benchmark::State& state) {
        hwy::SetSupportedTargetsForTest(target);
        Draw(state, &RendererOf("cpu"), 8, cell_px, 1);
        hwy::SetSupportedTargetsForTest(0);
      })->Unit(benchmark::kMillisecond);
    }
  }
  return true;
}();

}  // namespace
}  // namespace isoscope::render
