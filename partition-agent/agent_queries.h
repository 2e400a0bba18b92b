// Answers questions about an agent's shards: their descriptions, histograms, active blocks,
// gradients. No gRPC. Errors: INVALID_ARGUMENT if the request is malformed; those of
// ShardSet::Find; those of the function that computes the answer.

#ifndef ISOSCOPE_PARTITION_AGENT_AGENT_QUERIES_H_
#define ISOSCOPE_PARTITION_AGENT_AGENT_QUERIES_H_

#include <vector>

#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/render/renderer.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "partition-agent/memory/agent_resources.h"
#include "partition-agent/opening.h"
#include "partition-agent/shard_damage.h"
#include "partition-agent/shard_set.h"

namespace isoscope::agent {

// Describes the renderer, and the shards of datasets without fields, by name and index. This never
// changes.
isoscope::internal::v1::DescribeShardsResponse DescribePlain(const Shards& shards,
                                                             const render::Renderer& renderer);
// Adds the shards of series as they are now, after a look for new scalar volumes.
void AddSeries(const ShardSet& shards, isoscope::internal::v1::DescribeShardsResponse* description);

// Adds how far the opening is.
void AddOpening(const OpeningProgress& progress,
                isoscope::internal::v1::DescribeShardsResponse* description);
void AddDamages(const std::vector<ShardDamage>& damages,
                isoscope::internal::v1::DescribeShardsResponse* description);

// Each overload scans all blocks of the shards or of the volume, and blocks its thread.
absl::Status AnswerQuery(const ShardSet& shards,
                         const isoscope::internal::v1::GetShardHistogramRequest& request,
                         const base::Cancellation& cancellation,
                         isoscope::internal::v1::GetShardHistogramResponse* response);
absl::Status AnswerQuery(const ShardSet& shards,
                         const isoscope::internal::v1::GetActiveBoxRequest& request,
                         const base::Cancellation& cancellation,
                         isoscope::internal::v1::GetActiveBoxResponse* response);
// Reads some blocks, on the threads of `resources`.
absl::Status AnswerQuery(const ShardSet& shards, const AgentResources& resources,
                         const isoscope::internal::v1::GetCellBoxRequest& request,
                         const base::Cancellation& cancellation,
                         isoscope::internal::v1::GetCellBoxResponse* response);
// Reads the active blocks of a level, on the threads of `resources`.
absl::Status AnswerQuery(const ShardSet& shards, const AgentResources& resources,
                         const isoscope::internal::v1::GetResolvedBlocksRequest& request,
                         const base::Cancellation& cancellation,
                         isoscope::internal::v1::GetResolvedBlocksResponse* response);
// Computes in the arena of `resources`.
absl::Status AnswerQuery(const ShardSet& shards, const AgentResources& resources,
                         const isoscope::internal::v1::GetDepthBoundsRequest& request,
                         const base::Cancellation& cancellation,
                         isoscope::internal::v1::GetDepthBoundsResponse* response);
absl::Status AnswerQuery(const ShardSet& shards,
                         const isoscope::internal::v1::GetGradientsRequest& request,
                         const base::Cancellation& cancellation,
                         isoscope::internal::v1::GetGradientsResponse* response);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_AGENT_QUERIES_H_
