// A small generated dataset on disk, and requests for it.

#ifndef ISOSCOPE_TESTS_UNIT_PARTITION_AGENT_SMALL_DATASET_H_
#define ISOSCOPE_TESTS_UNIT_PARTITION_AGENT_SMALL_DATASET_H_

#include <algorithm>
#include <fstream>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/check.h"
#include "core/partition/partitioner.h"
#include "core/source/volume_source.h"
#include "core/store/shard_format.h"
#include "core/view/view.h"
#include "core/visibility/occlusion_map.h"
#include "core/visibility/open_pixels.h"
#include "partition-agent/frame/frame_task.h"
#include "partition-agent/shard/shard.h"
#include "tests/support/memory_source.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"

namespace isoscope::testing {

// A gyroid of uint8 around 128 in blocks of 8^3 cells.
class SmallDataset {
 public:
  static constexpr double kIsovalue = 128;

  explicit SmallDataset(int shard_count, const math::Index3& dims = {41, 37, 33})
      : shard_count_(shard_count) {
    geometry_.sample_dims = dims;
    samples_ =
        testing::SampleField(testing::GyroidField(2), dims, volume::ScalarType::kUint8, 80, 128);
    const auto source =
        testing::MakeMemorySource(geometry_, volume::ScalarType::kUint8, samples_, "gyroid");
    partition::PartitionOptions options;
    options.output_directory = directory();
    options.shard_count = shard_count;
    options.block_cells = {8, 8, 8};
    auto manifest = partition::Partition(*source, options, base::Cancellation());
    ISOSCOPE_CHECK(manifest.ok());
    manifest_ = *std::move(manifest);
  }

  [[nodiscard]] std::string directory() const { return temp_.Sub("gyroid"); }
  [[nodiscard]] std::string shard_directory(int shard) const {
    return directory() + "/" + store::ShardDirectoryName(shard, shard_count_);
  }
  [[nodiscard]] const store::Manifest& manifest() const { return manifest_; }
  [[nodiscard]] const volume::GridGeometry& geometry() const { return geometry_; }
  [[nodiscard]] volume::BlockLayout layout() const {
    return *volume::BlockLayout::Make(geometry_.sample_dims, {8, 8, 8});
  }
  [[nodiscard]] const std::string& samples() const { return samples_; }

  [[nodiscard]] agent::Shards OpenShards() const {
    agent::Shards shards;
    for (int i = 0; i < shard_count_; ++i) {
      auto shard = agent::OpenShard(shard_directory(i));
      ISOSCOPE_CHECK(shard.ok());
      shards.push_back(*std::move(shard));
    }
    return shards;
  }

  // From a corner, close enough that some blocks are beside the picture.
  [[nodiscard]] agent::FrameTask Request() const {
    agent::FrameTask request;
    request.spec.surfaces = {{.rule = {.isovalue = kIsovalue}, .appearance = {}}};
    request.spec.camera = view::MakeDefaultCamera(geometry_.Bounds());
    view::Azimuth(0.6, &*request.spec.camera);
    view::Elevation(0.4, &*request.spec.camera);
    view::Zoom(3.0, &*request.spec.camera);
    request.spec.viewport = {120, 90};
    request.spec.ray_seed = 5;
    return request;
  }

  [[nodiscard]] view::View ViewOf(const agent::FrameTask& task) const {
    return *view::View::Make(*task.spec.camera, task.spec.viewport, geometry_);
  }
  // Returns the message of a coordinator of one agent for step 3: the active blocks that step 2 did
  // not draw and its picture does not hide, and their open pixels.
  [[nodiscard]] std::pair<std::vector<volume::BlockId>, std::string> VisibleOf(
      const agent::FrameTask& task, const std::vector<volume::BlockId>& active,
      const std::vector<volume::BlockId>& drawn, const image::FrameImage& picture) const {
    const view::View view = ViewOf(task);
    const auto map = visibility::OcclusionMap::FromImage(picture, visibility::MapKind::kDepth);
    std::vector<volume::BlockId> blocks;
    std::vector<image::PixelMask> masks;
    for (const volume::BlockId id : active) {
      const view::Footprint footprint = view.FootprintOf(layout(), id);
      if (!std::binary_search(drawn.begin(), drawn.end(), id) && !footprint.rect.empty() &&
          !map.Hides(footprint)) {
        blocks.push_back(id);
        masks.push_back(map.OpenPixels(footprint));
      }
    }
    return {blocks, visibility::EncodeOpenPixels(masks)};
  }

 private:
  const int shard_count_;
  TempDir temp_;
  volume::GridGeometry geometry_;
  std::string samples_;
  store::Manifest manifest_;
};

// Flips one bit of the byte at `offset`; negative: from the end.
inline void FlipBit(const std::string& path, std::int64_t offset) {
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekg(offset, offset < 0 ? std::ios::end : std::ios::beg);
  const std::streamoff place = file.tellg();
  const int byte = file.get();
  ISOSCOPE_CHECK(byte >= 0);
  file.seekp(place);
  file.put(static_cast<char>(byte ^ 4));
  file.close();
  ISOSCOPE_CHECK(!file.fail());
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_PARTITION_AGENT_SMALL_DATASET_H_
