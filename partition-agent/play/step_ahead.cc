#include "partition-agent/play/step_ahead.h"

#include <algorithm>
#include <span>
#include <utility>

#include "absl/types/span.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/expect_read.h"
#include "core/volume/block_set.h"

namespace isoscope::agent {
namespace {

// The bytes that the system reads at a time: enough for a disk to be busy, few enough for a frame
// that comes to find it free soon.
constexpr std::size_t kMaxExpectedBytes = 4 * static_cast<std::size_t>(base::kMiB);

// Meshes are in the cache before they come here.
class CachedOnly final : public MeshSink {
 public:
  explicit CachedOnly(const MeshCache* cache) : cache_(*cache), before_(cache->unkept_count()) {}

  absl::Status Add(std::span<const render::MeshToDraw> /*meshes*/) override {
    return cache_.unkept_count() == before_
               ? absl::OkStatus()
               : absl::ResourceExhaustedError("the cache has no more room for meshes");
  }
  [[nodiscard]] bool is_full() const override { return false; }
  absl::Status Drain() override { return absl::OkStatus(); }

 private:
  const MeshCache& cache_;
  const std::uint64_t before_;
};

}  // namespace

// The round before that of the last frame: frames that need room evict these meshes first.
StepAhead::StepAhead(const ExpectedFrame& frame, SurfaceBlocks blocks,
                     const AgentResources& resources, const base::Cancellation* cancellation)
    : resources_(resources),
      cancellation_(*cancellation),
      colors_(frame.colors),
      blocks_(std::move(blocks)),
      supply_(&blocks_, frame.cache_round - 1, resources_, cancellation, frame.with_magnitudes,
              frame.colors) {
  volume::BlockSet hidden(blocks_.shards().front()->reader->layout().block_count(), frame.hidden);
  missing_ = blocks_.ChooseAll();
  std::erase_if(missing_, [&](const ChosenMesh& mesh) { return hidden.Contains(mesh.block_id); });
  supply_.EraseCached(&missing_);
}

absl::StatusOr<std::unique_ptr<StepAhead>> StepAhead::Make(const ExpectedFrame& frame,
                                                           const AgentResources& resources,
                                                           const base::Cancellation* cancellation) {
  IndexCost cost;
  ISOSCOPE_ASSIGN_OR_RETURN(
      SurfaceBlocks blocks,
      SurfaceBlocks::Find(frame.shards, frame.rules, resources.cache, *cancellation, &cost));
  blocks.EraseOutside(view::Clipper(frame.clip, frame.shards.front()->reader->manifest().geometry));
  return std::unique_ptr<StepAhead>(
      new StepAhead(frame, std::move(blocks), resources, cancellation));
}

std::vector<io::FileRead> StepAhead::ReadsOf(const std::vector<ChosenMesh>& meshes) const {
  using Block = std::pair<const Shard*, std::uint32_t>;
  std::vector<Block> blocks;
  for (const ChosenMesh& mesh : meshes) {
    blocks.emplace_back(blocks_.shards()[mesh.shard_index].get(), mesh.ordinal);
    if (const Shard* const color = colors_.ShardOf(mesh.shard_index, mesh.surface_index);
        color != nullptr) {
      blocks.emplace_back(color, mesh.ordinal);
    }
  }
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  std::vector<io::FileRead> reads;
  for (auto begin = blocks.begin(); begin != blocks.end();) {
    const auto end = std::find_if(begin, blocks.end(),
                                  [&](const Block& block) { return block.first != begin->first; });
    std::vector<std::uint32_t> ordinals;
    std::transform(begin, end, std::back_inserter(ordinals),
                   [](const Block& block) { return block.second; });
    const store::ShardReader& reader = *begin->first->reader;
    for (const store::ShardReader::DiskRun& run : reader.PlanDiskRuns(ordinals)) {
      reads.push_back(reader.RequestFor(run));
    }
    begin = end;
  }
  return reads;
}

absl::Status StepAhead::ReadSamples(FramesInWork* frames) const {
  const std::vector<io::FileRead> reads = ReadsOf(missing_);
  std::size_t expected_bytes = 0;
  std::size_t expected_begin = 0;  // earlier reads are most likely done
  for (std::size_t i = 0; i < reads.size(); ++i) {
    ISOSCOPE_RETURN_IF_ERROR(frames->AwaitIdleDisk(cancellation_));
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    io::ExpectRead(reads[i]);
    expected_bytes += reads[i].size;
    if (expected_bytes < kMaxExpectedBytes && i + 1 < reads.size()) {
      continue;
    }
    const std::size_t left_bytes = i + 1 < reads.size() ? kMaxExpectedBytes / 2 : 0;
    while (expected_bytes > left_bytes) {
      expected_bytes -= reads[expected_begin++].size;
    }
    ISOSCOPE_RETURN_IF_ERROR(io::AwaitExpectedRead(reads[expected_begin - 1]));
  }
  return absl::OkStatus();
}

absl::Status StepAhead::MakeMeshes() {
  CachedOnly sink(resources_.cache->meshes());
  return supply_.AddMeshes(missing_, &sink).status();
}

}  // namespace isoscope::agent
