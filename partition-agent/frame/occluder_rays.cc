#include "partition-agent/frame/occluder_rays.h"

#include <algorithm>
#include <cstdint>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "absl/types/span.h"
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/base/status_macros.h"
#include "core/visibility/occluder_selection.h"
#include "core/volume/block_set.h"
#include "core/volume/block_tree.h"

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

// The same blocks as a tree.
absl::StatusOr<std::shared_ptr<const volume::BlockTree>> TreeThatStopsRays(
    const store::ShardReader& reader, const view::Clipper& clipper, const frame::FrameSpec& spec) {
  std::vector<std::shared_ptr<const volume::BlockTree>> active;
  for (const frame::Surface& surface : spec.surfaces) {
    if (!surface.is_translucent()) {
      ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const volume::BlockTree> tree,
                                reader.ActiveTree(surface.rule));
      active.push_back(std::move(tree));
    }
  }
  const volume::BlockLayout& layout = reader.layout();
  if (active.empty()) {
    return std::make_shared<const volume::BlockTree>(layout.block_dims(),
                                                     absl::Span<const volume::BlockTree::Brick>());
  }
  if (active.size() > 1) {
    std::vector<const volume::BlockTree*> trees;
    for (const std::shared_ptr<const volume::BlockTree>& tree : active) {
      trees.push_back(tree.get());
    }
    active = {std::make_shared<const volume::BlockTree>(volume::BlockTree::Union(trees))};
  }
  if (clipper.empty()) {
    return active.front();  // no copy
  }
  return std::make_shared<const volume::BlockTree>(
      active.front()->Filtered([&](const math::Index3& index) {
        return clipper.SideOf(layout, layout.IdOf(index)) != view::Clipper::Side::kOutside;
      }));
}

// Casts the rays of a share in parallel by cast(begin, end). Returns the error of `cancellation` if
// it fires.
template <typename Cast>
absl::Status CastShare(const visibility::RayShare& share, const base::Cancellation& cancellation,
                       base::TraceRecorder* trace, const Cast& cast) {
  const std::int64_t task_count = (share.end - share.begin + kRaysPerTask - 1) / kRaysPerTask;
  tbb::parallel_for(std::int64_t{0}, task_count, [&](std::int64_t i) {
    if (cancellation.is_cancelled()) {
      return;
    }
    const base::TraceScope scope(trace, "rays");
    const std::int64_t begin = share.begin + i * kRaysPerTask;
    cast(begin, std::min(begin + kRaysPerTask, share.end));
  });
  return cancellation.Check();
}

absl::StatusOr<std::vector<volume::BlockId>> CastThroughSet(const visibility::RaySet& rays,
                                                            const visibility::RayShare& share,
                                                            const volume::BlockSet& active,
                                                            std::int64_t block_count,
                                                            const base::Cancellation& cancellation,
                                                            base::TraceRecorder* trace) {
  tbb::enumerable_thread_specific<volume::BlockSet> hits_by_thread(block_count);
  ISOSCOPE_RETURN_IF_ERROR(
      CastShare(share, cancellation, trace, [&](std::int64_t begin, std::int64_t end) {
        rays.Cast(begin, end, active, &hits_by_thread.local());
      }));
  volume::BlockSet hits(block_count);
  for (const volume::BlockSet& thread_hits : hits_by_thread) {
    hits.UnionWith(thread_hits);
  }
  return hits.Ids();
}

absl::StatusOr<std::vector<volume::BlockId>> CastThroughTree(const visibility::RaySet& rays,
                                                             const visibility::RayShare& share,
                                                             const volume::BlockTree& active,
                                                             const base::Cancellation& cancellation,
                                                             base::TraceRecorder* trace) {
  using Marks = std::vector<std::uint64_t>;
  const Marks none(active.words().size());
  tbb::enumerable_thread_specific<Marks> marks_by_thread(none);
  ISOSCOPE_RETURN_IF_ERROR(
      CastShare(share, cancellation, trace, [&](std::int64_t begin, std::int64_t end) {
        rays.Cast(begin, end, active, absl::MakeSpan(marks_by_thread.local()));
      }));
  Marks marks = none;
  for (const Marks& thread_marks : marks_by_thread) {
    std::transform(marks.begin(), marks.end(), thread_marks.begin(), marks.begin(),
                   std::bit_or<>());
  }
  return active.IdsOf(marks);
}

}  // namespace

absl::StatusOr<std::vector<volume::BlockId>> CastRays(
    const store::ShardReader& reader, const view::View& view, const view::Clipper& clipper,
    const FrameTask& task, const base::Cancellation& cancellation, base::TraceRecorder* trace,
    std::int64_t max_dense_blocks) {
  const std::int64_t block_count = reader.layout().block_count();
  const visibility::RaySet rays(view, reader.layout(), task.spec.ray_seed);
  const visibility::RayShare share =
      visibility::ShareOfRays(rays.count(), task.agent_index, task.agent_count);
  if (block_count > max_dense_blocks) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const volume::BlockTree> active,
                              TreeThatStopsRays(reader, clipper, task.spec));
    return CastThroughTree(rays, share, *active, cancellation, trace);
  }
  return CastThroughSet(rays, share, *BlocksThatStopRays(reader, clipper, task.spec), block_count,
                        cancellation, trace);
}

}  // namespace isoscope::agent
