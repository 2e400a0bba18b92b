// The shards that an agent serves, of any datasets.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "google/protobuf/repeated_field.h"

#include "partition-agent/shard.h"

namespace isoscope::agent {

// Immutable; thread-safe.
class ShardSet {
 public:
  explicit ShardSet(Shards shards) : shards_(std::move(shards)) {}

  // Finds the shards of a dataset by index. FAILED_PRECONDITION names the dataset or shard that is
  // not served; INVALID_ARGUMENT if the indices are malformed. O(shards).
  [[nodiscard]] absl::StatusOr<Shards> Find(
      const std::string& dataset_id,
      const google::protobuf::RepeatedField<std::int32_t>& shard_indices) const;
  // Returns all shards of a dataset that are served. FAILED_PRECONDITION if there are none.
  [[nodiscard]] absl::StatusOr<Shards> FindAll(const std::string& dataset_id) const;

  [[nodiscard]] const Shards& all() const { return shards_; }

 private:
  const Shards shards_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_SET_H_
