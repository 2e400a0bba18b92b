// Questions to the agents of a dataset, outside of frames. Each part is asked of its first replica,
// all at the same time, in the name of the client's request; and of the next one if that fails.

#ifndef ISOSCOPE_SERVER_FRAME_AGENT_QUERIES_H_
#define ISOSCOPE_SERVER_FRAME_AGENT_QUERIES_H_

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/trace_context.h"
#include "core/math/box.h"
#include "core/rpc/histogram_convert.h"
#include "core/volume/block_layout.h"
#include "core/volume/sample_histogram.h"
#include "isoscope/v1/isosurface_service.pb.h"
#include "server/cluster/agent_failure.h"
#include "server/cluster/replica_board.h"

namespace isoscope::server {

// Whom to ask. Both outlive the question.
struct QueryTarget {
  const std::string& dataset_id;
  const std::vector<FramePart>& parts;  // all shards of the dataset, unless some are missing
};

// An answer, and the agents that failed, also those that another one stood in for.
template <typename T>
struct QueryOutcome {
  absl::StatusOr<T> result;
  std::vector<AgentFailure> failures;
};

// Returns the histogram of the whole dataset: the sum of all agents' parts. Blocks. Errors as
// DatasetService.GetHistogram.
QueryOutcome<volume::HistogramPart> AskHistogram(const QueryTarget& target,
                                                 const rpc::HistogramQuery& query,
                                                 const base::TraceContext& identity,
                                                 const base::Cancellation& cancellation);

// Where a surface is.
struct ActiveExtent {
  std::int64_t active_block_count = 0;
  std::optional<math::IndexBox> cells;  // of the box around these blocks; not set if there are none
};

// Returns the blocks of the volume that are active for any of some isovalues and not wholly outside
// of `clip`, also those of missing shards. Asks the first part, because every
// agent knows all ranges. Blocks. UNAVAILABLE, FAILED_PRECONDITION, DEADLINE_EXCEEDED, CANCELLED.
QueryOutcome<ActiveExtent> AskActiveBox(const QueryTarget& target,
                                        const volume::BlockLayout& layout,
                                        const std::vector<double>& isovalues,
                                        const isoscope::v1::ClipRegion& clip,
                                        const base::TraceContext& identity,
                                        const base::Cancellation& cancellation);

// Returns the gradient of the field at each of some points of world space, at most
// rpc::kMaxPickedPixels; not set where it is not finite. Each agent answers for the points in its
// shards. Blocks. UNAVAILABLE, FAILED_PRECONDITION, DATA_LOSS, DEADLINE_EXCEEDED, CANCELLED.
QueryOutcome<std::vector<std::optional<math::Vec3d>>> AskGradients(
    const QueryTarget& target, const std::vector<math::Vec3d>& points,
    const base::TraceContext& identity, const base::Cancellation& cancellation);

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_AGENT_QUERIES_H_
