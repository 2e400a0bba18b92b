// The values of an agent's samples that may be labels.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_LABEL_VALUES_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_LABEL_VALUES_H_

#include <cstddef>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/volume/label_values.h"
#include "partition-agent/shard/shard.h"

namespace isoscope::agent {

// Returns the values of the samples of some shards. Blocks of one value tell it by their span; all
// others are read, one disk run after the other, until the answer is known.
//
// shards: of one dataset, at least one
//
// Errors: DATA_LOSS as ShardReader::ReadDiskRun; CANCELLED, DEADLINE_EXCEEDED.
absl::StatusOr<volume::LabelValues> LabelValuesOfShards(const Shards& shards, std::size_t max_count,
                                                        const base::Cancellation& cancellation);

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_SHARD_LABEL_VALUES_H_
