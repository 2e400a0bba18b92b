#include "partition-agent/frame/occluder_rays.h"

#include <algorithm>
#include <cstdint>
#include <memory>

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/status_macros.h"
#include "core/visibility/occluder_selection.h"
#include "core/volume/block_set.h"

namespace isoscope::agent {
namespace {

// One task casts this many rays, in some hundred microseconds.
constexpr std::int64_t kRaysPerTask = 1024;

// Returns the active blocks of the opaque surfaces, of the whole volume, that are not clipped.
std::shared_ptr<const volume::BlockSet> BlocksThatStopRays(const store::ShardReader& reader,
                                                           const view::Clipper& clipper,
                                                           const frame::FrameSpec& spec) {
  std::vector<std::shared_ptr<const volume::BlockSet>> active;
  for (const frame::Surface& surface : spec.surfaces) {
    if (!surface.is_translucent()) {
      active.push_back(reader.ActiveBlocks(surface.rule));
    }
  }
  if (active.size() == 1 && clipper.empty()) {
    return active.front();  // no copy
  }
  auto blocks = std::make_shared<volume::BlockSet>(reader.layout().block_count());
  for (const std::shared_ptr<const volume::BlockSet>& surface_blocks : active) {
    blocks->UnionWith(*surface_blocks);
  }
  clipper.EraseOutside(reader.layout(), blocks.get());
  return blocks;
}

}  // namespace

absl::StatusOr<std::vector<volume::BlockId>> CastRays(
    const store::ShardReader& reader, const view::View& view, const view::Clipper& clipper,
    const FrameTask& task, const base::Cancellation& cancellation, base::TraceRecorder* trace) {
  const volume::BlockLayout& layout = reader.layout();
  const std::shared_ptr<const volume::BlockSet> active =
      BlocksThatStopRays(reader, clipper, task.spec);
  const visibility::RaySet rays(view, layout, task.spec.ray_seed);
  const visibility::RayShare share =
      visibility::ShareOfRays(rays.count(), task.agent_index, task.agent_count);
  const std::int64_t task_count = (share.end - share.begin + kRaysPerTask - 1) / kRaysPerTask;
  tbb::enumerable_thread_specific<volume::BlockSet> hits_by_thread(layout.block_count());
  tbb::parallel_for(std::int64_t{0}, task_count, [&](std::int64_t i) {
    if (cancellation.is_cancelled()) {
      return;
    }
    const base::TraceScope scope(trace, "rays");
    const std::int64_t begin = share.begin + i * kRaysPerTask;
    rays.Cast(begin, std::min(begin + kRaysPerTask, share.end), *active, &hits_by_thread.local());
  });
  ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
  volume::BlockSet hits(layout.block_count());
  for (const volume::BlockSet& thread_hits : hits_by_thread) {
    hits.UnionWith(thread_hits);
  }
  return hits.Ids();
}

}  // namespace isoscope::agent
