// Questions to the agents of a dataset, outside of frames. Each part is asked of its first replica,
// all at the same time, with the trace identity of the client's request. The next replica is asked
// if that fails, or if it has not answered after half a second or a quarter of the client's time.

#ifndef ISOSCOPE_SERVER_FRAME_AGENT_QUERIES_H_
#define ISOSCOPE_SERVER_FRAME_AGENT_QUERIES_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/cancellation.h"
#include "core/base/trace_context.h"
#include "core/frame/frame_spec.h"
#include "core/math/box.h"
#include "core/math/vec.h"
#include "core/view/clip_region.h"
#include "core/visibility/depth_bounds.h"
#include "core/volume/block_layout.h"
#include "core/volume/inside_rule.h"
#include "core/volume/sample_histogram.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/cluster/agent_failure.h"
#include "server/cluster/replica_board.h"
#include "wire/histogram_convert.h"

namespace isoscope::server {

// The agents to ask. Both references outlive the question.
struct QueryTarget {
  const std::string& dataset_id;
  const std::vector<FramePart>& parts;  // all shards of the dataset, unless some are missing
  // If one agent is enough, `turn` selects the first one to ask: successive turns use all in
  // rotation.
  std::size_t turn = 0;
  int level = 0;  // whose blocks AskActiveBox asks for
};

// An agent that was slower than another one with the same question.
struct LostHedge {
  AgentIdentity agent;
  absl::Duration waited;  // since it was asked
};

// The failures and delays of agents in one query.
struct QueryReport {
  std::vector<AgentFailure> failures = {};  // includes agents that another one replaced
  std::vector<LostHedge> lost_hedges = {};
};

template <typename T>
struct QueryOutcome {
  absl::StatusOr<T> result;
  QueryReport report;
};

// Returns the histogram of the whole dataset: the sum of all agents' parts. Blocks. Errors as
// DatasetService.GetHistogram.
QueryOutcome<volume::HistogramPart> AskHistogram(const QueryTarget& target,
                                                 const wire::HistogramQuery& query,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation);

// The extent of a surface.
struct ActiveExtent {
  std::int64_t active_block_count = 0;
  std::optional<math::IndexBox> cells;  // box around the active blocks; not set if there are none
};

// Returns the number of blocks that are active for any of some surfaces and not wholly outside of
// `clip`, and their box. Blocks of missing shards count too. Asks one agent of any part, because
// every agent knows all ranges. Blocks are those of the target's level. Waits. UNAVAILABLE,
// FAILED_PRECONDITION, DEADLINE_EXCEEDED, CANCELLED.
QueryOutcome<ActiveExtent> AskActiveBox(const QueryTarget& target,
                                        const volume::BlockLayout& layout,
                                        const std::vector<volume::InsideRule>& rules,
                                        const view::ClipRegion& clip,
                                        const base::TraceContext& identity,
                                        const base::Cancellation& cancellation);

// Returns the box of the cells that are active for any of some surfaces and not wholly outside of
// `clip`; not set if there are none. Asks every part, whose agents read blocks. Blocks.
// UNAVAILABLE, FAILED_PRECONDITION, DATA_LOSS, DEADLINE_EXCEEDED, CANCELLED.
QueryOutcome<std::optional<math::IndexBox>> AskCellBox(const QueryTarget& target,
                                                       const volume::BlockLayout& layout,
                                                       const std::vector<volume::InsideRule>& rules,
                                                       const view::ClipRegion& clip,
                                                       const base::TraceContext& identity,
                                                       const base::Cancellation& cancellation);

// Returns the bounds of depth in the picture of a frame, of blocks of missing shards, too. The
// agents of the parts share the blocks; each of them could do any share, because every agent knows
// all ranges. Blocks. UNAVAILABLE, FAILED_PRECONDITION, DEADLINE_EXCEEDED, CANCELLED.
//
// spec: has a camera, and a picture of at most frame::kMaxBoundsPixels
QueryOutcome<visibility::DepthBounds> AskDepthBounds(const QueryTarget& target,
                                                     const frame::FrameSpec& spec,
                                                     const base::TraceContext& identity,
                                                     const base::Cancellation& cancellation);

// Returns the number of active blocks of level 0 that a level shows nothing of, for one surface.
// Asks every part, whose agents read the level's blocks. Blocks. UNAVAILABLE, FAILED_PRECONDITION,
// DATA_LOSS, DEADLINE_EXCEEDED, CANCELLED.
//
// block_count: of level 0
QueryOutcome<std::int64_t> AskUnresolved(const QueryTarget& target, std::int64_t block_count,
                                         int level, const volume::InsideRule& rule,
                                         const base::TraceContext& identity,
                                         const base::Cancellation& cancellation);

// A point of world space, and the block whose surface is seen there.
struct ShownPoint {
  math::Vec3d position;
  volume::BlockId block_id = 0;
  volume::InsideRule rule = {};  // of the surface
  bool is_on_cap = false;
};

// The agents' answer for a point.
struct PointAnswer {
  std::optional<math::Vec3d> gradient;  // of the field; not set where it is not finite
  std::optional<int> shard_index;       // shard of the block; not set if no part has it
  std::vector<double> values;           // by volume; empty if no part has the block
  std::optional<double> label;          // not set if the surface has none, or no part has the block
};

// Returns the agents' answers for some points, at most wire::kMaxPickedPixels. Each agent answers
// for the cells and blocks in its shards. Blocks. UNAVAILABLE, FAILED_PRECONDITION, DATA_LOSS,
// DEADLINE_EXCEEDED, CANCELLED.
//
// volume_ids: dataset ids of the scalar volumes whose values are wanted; may be empty
QueryOutcome<std::vector<PointAnswer>> AskPoints(const QueryTarget& target,
                                                 const std::vector<ShownPoint>& points,
                                                 const std::vector<std::string>& volume_ids,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_AGENT_QUERIES_H_
