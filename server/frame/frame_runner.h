// Runs a frame with a ticket: finds dataset and agents, and lets the agents draw. Jobs call the
// runner, the runner calls the ticket, and both use the state of the coordinator.

#ifndef ISOSCOPE_SERVER_FRAME_FRAME_RUNNER_H_
#define ISOSCOPE_SERVER_FRAME_FRAME_RUNNER_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/metrics.h"
#include "core/base/trace_recorder.h"
#include "core/frame/frame_spec.h"
#include "core/view/view.h"
#include "core/volume/grid_geometry.h"
#include "isoscope/v1/dataset.pb.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/cluster/frame_part.h"
#include "server/cluster/series_state.h"
#include "server/frame/active_blocks.h"
#include "server/frame/active_counts.h"
#include "server/frame/agent_queries.h"
#include "server/frame/agent_room.h"
#include "server/frame/cell_boxes.h"
#include "server/frame/coordinator_state.h"
#include "server/frame/drawn_blocks.h"
#include "server/frame/frame_coordinator.h"
#include "server/frame/frame_ends.h"
#include "server/frame/frame_ticket.h"
#include "server/frame/render_statistics.h"
#include "server/frame/sample_counts.h"
#include "server/frame/unresolved_counts.h"
#include "wire/frame_convert.h"

namespace isoscope::server {

// A dataset, the parts of a frame on it, and its view.
struct FrameTarget {
  std::shared_ptr<const DatasetState> dataset;
  std::vector<FramePart> parts;  // of all shards, unless some are missing (allow_partial)
  view::View view;               // of the level's grid, with the clip planes of level 0
  volume::BlockLayout layout;    // of the level
  image::FragmentOrder order;
  SelectedVolume selected;     // `dataset` is its dataset
  volume::GridGeometry whole;  // of level 0
  int level = 0;
  int asked_level = 0;     // the one that the request asks for; `level` may be coarser
  int coarsest_level = 0;  // of those that fit the surfaces
  double spacing_px = 0;   // of the level, if the request has a choice of one

  // Returns the view of another camera or window. Errors as View::Make.
  [[nodiscard]] absl::StatusOr<view::View> ViewOf(const frame::FrameSpec& spec) const {
    return ViewOf(*spec.camera, spec.viewport, spec.region);
  }
  [[nodiscard]] absl::StatusOr<view::View> ViewOf(const view::Camera& camera,
                                                  const view::Viewport& viewport,
                                                  const std::optional<view::Region>& region) const;
};

using wire::AskedFrame;

// Lets a frame be of a coarser level than it asks for.
struct CoarserLevel {
  // The samples of a volume that is drawn quickly, on few cores: 512 x 512 x 512.
  static constexpr std::int64_t kQuickSampleCount = std::int64_t{1} << 27;

  // The frame is of this level, or of a coarser one that it asks for. Not set: of the finest one of
  // at most kQuickSampleCount samples.
  std::optional<int> least = 0;
};

// The place of a drawing among those of its call.
struct DrawingContext {
  // The blocks that earlier bands of the picture have drawn: agents do not count them again, and
  // the result has its own. Null: the drawing counts by itself.
  const DrawnBlocks* drawn = nullptr;
  int drawing_count = 1;       // of the call; they share the spans of its trace
  bool others_follow = false;  // other drawings of the frame: agents that stop wait for them
  // Learns of the calls, so that FrameRunner::EndCalls can tell agents if none follow after all. Null:
  // others never follow.
  FollowingCalls* following = nullptr;
};

// Returns true if the frame may work with fewer pixels: an agent, or the coordinator, has no memory
// for as many at a time.
bool MayWorkSmaller(const absl::Status& status);

// Thread-safe.
class FrameRunner {
 public:
  // The state outlives the runner.
  explicit FrameRunner(CoordinatorState* state)
      : state_(*state), active_blocks_(state->memory.active_blocks_bytes()) {}

  // Takes the memory of a frame, then finds its dataset, among those that the caller may see, and
  // checks that its agents can draw it. Resolves the camera. Blocks. Errors as IsosurfaceService
  // says.
  //
  // trace: null: no trace was asked for
  // coarser: not set: of the level that it asks for
  absl::StatusOr<FrameTarget> Prepare(FrameTicket* ticket, AskedFrame* asked,
                                      base::TraceRecorder* trace,
                                      const std::optional<CoarserLevel>& coarser = std::nullopt);

  // Returns the bytes of the samples of all active blocks of the target's level that are not wholly
  // outside of the clip region, from the cache or from an agent. Blocks. Errors as AskActiveBox.
  absl::StatusOr<std::int64_t> FindActiveBytes(const FrameIdentity& identity,
                                               const frame::FrameSpec& spec,
                                               const FrameTarget& target);

  // Runs one frame to its end. Blocks. Errors as IsosurfaceService says; logs agents that failed.
  // With allow_partial, `parts` loses those that no agent could do, and the frame shows the others.
  // If it loses some after a band, the picture must be begun again.
  absl::StatusOr<FrameResult> Run(const FrameIdentity& identity, const AskedFrame& asked,
                                  const FrameTarget& target, std::vector<FramePart>* parts,
                                  const DrawingContext& context = {});
  // Tells agents that wait for another call of the frame that none follows. Does not block.
  void EndCalls(const FrameIdentity& identity, FollowingCalls* following);
  // Sets the missing shards of a frame of `parts`, if any, and the share of the surface that it
  // has.
  absl::Status AddMissingShards(const FrameIdentity& identity, const AskedFrame& asked,
                                const FrameTarget& target, const std::vector<FramePart>& parts,
                                FrameCost* cost);

  [[nodiscard]] CoordinatorState& state() const { return state_; }
  [[nodiscard]] AgentRoom& agent_room() { return agent_room_; }
  [[nodiscard]] SampleCountsCache& sample_counts() { return sample_counts_; }
  [[nodiscard]] UnresolvedCounts& unresolved_counts() { return unresolved_counts_; }
  void AppendMetrics(std::vector<base::MetricFamily>* families) const {
    active_blocks_.AppendMetrics(families);
    cell_boxes_.AppendSamples(&families->back());
    unresolved_counts_.AppendSamples(&families->back());
    active_counts_.AppendSamples(&families->back());
  }

 private:
  class Attempt;
  absl::StatusOr<FrameTarget> FindTarget(const FrameIdentity& identity, AskedFrame* asked,
                                         const std::optional<CoarserLevel>& coarser);
  // Turns a target of level 0 into one of the level that the frame asks for, and sets
  // FrameSpec::level. Once, for all bands and drawings of the frame.
  absl::Status PlaceLevel(const std::optional<CoarserLevel>& coarser, AskedFrame* asked,
                          FrameTarget* target);
  // Resolves the camera of the frame. Asks agents for the box of the surface if the camera fits it.
  absl::Status PlaceCamera(const FrameIdentity& identity, const QueryTarget& query,
                           const isoscope::v1::Dataset& dataset,
                           const volume::GridGeometry& geometry, const volume::BlockLayout& layout,
                           AskedFrame* asked);
  // Returns the box of the active cells, from the cache or from the agents. With allow_partial an
  // agent that can't answer leaves it unset.
  absl::StatusOr<CellBoxCache::CellBox> FindCellBox(const FrameIdentity& identity,
                                                    const QueryTarget& query, int shard_count,
                                                    const volume::BlockLayout& layout,
                                                    const AskedFrame& asked);

  CoordinatorState& state_;
  FrameEnds frame_ends_;
  ActiveBlocksCache active_blocks_;
  AgentRoom agent_room_;
  CellBoxCache cell_boxes_;
  SampleCountsCache sample_counts_;
  UnresolvedCounts unresolved_counts_;
  ActiveCounts active_counts_;
};

// Returns the bytes of the samples of some blocks of the target's level, as if none were at the border.
std::int64_t BytesOfBlocks(const FrameTarget& target, std::int64_t block_count);

// Returns the layout of the dataset's blocks on a grid: its own, or that of a level. INVALID_ARGUMENT
// if it has none.
absl::StatusOr<volume::BlockLayout> LayoutOf(const isoscope::v1::Dataset& dataset,
                                             const volume::GridGeometry& grid);
// Returns the grid of a level of the dataset, whose grid is `whole`.
volume::GridGeometry GridOfLevel(const volume::GridGeometry& whole, int level);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_FRAME_RUNNER_H_
