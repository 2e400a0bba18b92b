// Extraction of all active blocks of a volume, one thread, samples in memory:
//
//   BM_Extract/<field>/<type>/<block edge>
//   BM_Extract/<field>/<type>/<block edge>/<instruction set>
//     the same, held to that instruction set instead of the best
//   BM_Labels/<field>/<type>/<block edge>/<labels>
//     the same vertices, as the surface of labels. The samples are labels: inside ones have one of
//     that many, which lie apart, others the one label 0
//
// sphere: one smooth sheet; gyroid: a periodic sheet through everything; random: a smooth random
// field with many sheets; ct: flat regions with sharp sheets and noise between them, as in a scan.
// Counters: triangles/s; samples/s of the stored samples of active blocks; active blocks.

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "absl/cleanup/cleanup.h"
#include "benchmark/benchmark.h"

// As in block_kernels.cc, so that all of its targets are known here.
#define HWY_WANT_AVX3_DL
#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/extract/block_extractor.h"
#include "core/volume/inside_rule.h"
#include "hwy/targets.h"
#include "tests/support/block_cutter.h"
#include "tests/support/synthetic_fields.h"

namespace isoscope::extract {
namespace {

constexpr std::int64_t kEdge = 128;

struct Scene {
  const char* name;
  double isovalue;
};
constexpr std::array<Scene, 4> kScenes{
    {{"sphere", 100.5}, {"gyroid", 100.5}, {"random", 100.5}, {"ct", 60.5}}};

testing::Field FieldOf(const std::string& name) {
  if (name == "sphere") {
    return testing::SphereField(0.8);
  }
  if (name == "gyroid") {
    return testing::GyroidField(4);
  }
  if (name == "random") {
    return testing::RandomField(1, 24, 12);
  }
  // Tissue at 1.4 with noise, air at 0: steep walls, speckle that crosses the isovalue.
  return [smooth = testing::RandomField(2, 16, 5)](const math::Vec3d& p) {
    const auto cell =
        static_cast<std::uint64_t>((p.x + 1) * 1e3 + (p.y + 1) * 1e7 + (p.z + 1) * 1e11);
    const double noise = base::RandomUnit(3, cell) - 0.5;
    const double wall = smooth(p) > 0 ? 0.1 : -0.9;
    return wall + 0.6 * noise;
  };
}

const std::string& SamplesOf(const std::string& scene, volume::ScalarType type) {
  static std::map<std::pair<std::string, volume::ScalarType>, std::string> cache;
  std::string& bytes = cache[{scene, type}];
  if (bytes.empty()) {
    bytes = testing::SampleField(FieldOf(scene), {kEdge, kEdge, kEdge}, type, 50, 100);
  }
  return bytes;
}

// `targets`: the instruction sets to choose from, as for hwy::SetSupportedTargetsForTest.
void BM_Extract(benchmark::State& state, const Scene& scene, volume::ScalarType type,
                std::int64_t block_edge, std::int64_t targets) {
  hwy::SetSupportedTargetsForTest(targets);
  const absl::Cleanup restore = [] { hwy::SetSupportedTargetsForTest(0); };
  volume::GridGeometry geometry;
  geometry.sample_dims = {kEdge, kEdge, kEdge};
  const volume::BlockLayout layout =
      volume::BlockLayout::Make(geometry.sample_dims, {block_edge, block_edge, block_edge}).value();
  const std::string& bytes = SamplesOf(scene.name, type);
  BlockExtractor extractor(geometry, layout);
  std::vector<std::pair<volume::BlockId, std::string>> active;
  std::int64_t samples = 0;
  std::int64_t triangles = 0;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    std::string block = testing::CutBlock(layout, type, bytes, id);
    const std::int64_t block_triangles =
        extractor.Extract({id, type, block.data()}, scene.isovalue).triangle_count();
    if (block_triangles > 0) {
      triangles += block_triangles;
      samples += math::Volume(layout.StoredSamplesOf(id).dims());
      active.emplace_back(id, std::move(block));
    }
  }
  for (auto unused : state) {
    for (const auto& [id, block] : active) {
      benchmark::DoNotOptimize(
          extractor.Extract({id, type, block.data()}, scene.isovalue).indices.data());
    }
  }
  const auto rounds = static_cast<double>(state.iterations());
  state.counters["triangles"] =
      benchmark::Counter(rounds * static_cast<double>(triangles), benchmark::Counter::kIsRate);
  state.counters["samples"] =
      benchmark::Counter(rounds * static_cast<double>(samples), benchmark::Counter::kIsRate);
  state.counters["active_blocks"] = static_cast<double>(active.size());
}

// The scene's samples as labels: inside ones are 2, 4, 6, ..., of which there are `label_count`.
std::string LabelsOf(const Scene& scene, volume::ScalarType type, int label_count) {
  std::string bytes = SamplesOf(scene.name, type);
  volume::VisitScalarType(type, [&]<typename T>() {
    for (std::size_t i = 0; i < bytes.size() / sizeof(T); ++i) {
      char* const at = bytes.data() + i * sizeof(T);
      const bool is_inside = static_cast<double>(base::LoadLittleEndian<T>(at)) >= scene.isovalue;
      const std::uint64_t number =
          1 + base::RandomBits(7, i) % static_cast<std::uint64_t>(label_count);
      base::StoreLittleEndian(is_inside ? static_cast<T>(2 * number) : T{0}, at);
    }
  });
  return bytes;
}

void BM_Labels(benchmark::State& state, const Scene& scene, volume::ScalarType type,
               std::int64_t block_edge, int label_count) {
  volume::GridGeometry geometry;
  geometry.sample_dims = {kEdge, kEdge, kEdge};
  const volume::BlockLayout layout =
      volume::BlockLayout::Make(geometry.sample_dims, {block_edge, block_edge, block_edge}).value();
  const std::string bytes = LabelsOf(scene, type, label_count);
  std::vector<double> labels;
  for (int i = 1; i <= label_count; ++i) {
    labels.push_back(2 * i);
  }
  const volume::InsideRule rule = volume::InsideRule::OfLabels(labels);
  BlockExtractor extractor(geometry, layout);
  std::vector<std::pair<volume::BlockId, std::string>> active;
  std::int64_t triangles = 0;
  for (std::int64_t i = 0; i < layout.block_count(); ++i) {
    const auto id = static_cast<volume::BlockId>(i);
    std::string block = testing::CutBlock(layout, type, bytes, id);
    const std::int64_t block_triangles =
        extractor.Extract({id, type, block.data()}, rule).triangle_count();
    if (block_triangles > 0) {
      triangles += block_triangles;
      active.emplace_back(id, std::move(block));
    }
  }
  for (auto unused : state) {
    for (const auto& [id, block] : active) {
      benchmark::DoNotOptimize(extractor.Extract({id, type, block.data()}, rule).indices.data());
    }
  }
  state.counters["triangles"] =
      benchmark::Counter(static_cast<double>(state.iterations()) * static_cast<double>(triangles),
                         benchmark::Counter::kIsRate);
  state.counters["active_blocks"] = static_cast<double>(active.size());
}

// Registers the cross product of scenes, types and block edges, and of instruction sets for one
// scene.
const bool kRegistered = [] {
  for (const Scene& scene : kScenes) {
    for (const volume::ScalarType type :
         {volume::ScalarType::kUint8, volume::ScalarType::kUint16, volume::ScalarType::kFloat32}) {
      for (const std::int64_t edge : {8, 16, 32}) {
        const std::string name = std::string("BM_Extract/") + scene.name + "/" +
                                 std::string(volume::NameOf(type)) + "/" + std::to_string(edge);
        benchmark::RegisterBenchmark(name.c_str(), [&scene, type, edge](benchmark::State& state) {
          BM_Extract(state, scene, type, edge, 0);
        })->Unit(benchmark::kMillisecond);
      }
    }
  }
  for (const Scene& scene : kScenes) {
    for (const volume::ScalarType type :
         {volume::ScalarType::kUint8, volume::ScalarType::kUint16, volume::ScalarType::kFloat32}) {
      for (const std::int64_t edge : {8, 16, 32}) {
        for (const int label_count : {1, 60}) {
          const std::string name = std::string("BM_Labels/") + scene.name + "/" +
                                   std::string(volume::NameOf(type)) + "/" + std::to_string(edge) +
                                   "/" + std::to_string(label_count);
          benchmark::RegisterBenchmark(name.c_str(), [&scene, type, edge,
                                                      label_count](benchmark::State& state) {
            BM_Labels(state, scene, type, edge, label_count);
          })->Unit(benchmark::kMillisecond);
        }
      }
    }
  }
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    for (const volume::ScalarType type :
         {volume::ScalarType::kUint8, volume::ScalarType::kUint16, volume::ScalarType::kFloat32}) {
      const std::string name = std::string("BM_Extract/random/") +
                               std::string(volume::NameOf(type)) + "/8/" + hwy::TargetName(target);
      benchmark::RegisterBenchmark(name.c_str(), [type, target](benchmark::State& state) {
        BM_Extract(state, kScenes[2], type, 8, target);
      })->Unit(benchmark::kMillisecond);
    }
  }
  return true;
}();

}  // namespace
}  // namespace isoscope::extract
