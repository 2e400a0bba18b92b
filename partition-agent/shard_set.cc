#include "partition-agent/shard_set.h"

#include <algorithm>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/rpc/proto_convert.h"

namespace isoscope::agent {

absl::StatusOr<Shards> ShardSet::FindAll(const std::string& dataset_id) const {
  Shards found;
  for (const std::shared_ptr<const Shard>& shard : shards_) {
    if (shard->reader->manifest().dataset_id == dataset_id) {
      found.push_back(shard);
    }
  }
  if (found.empty()) {
    return absl::FailedPreconditionError(
        absl::StrCat("dataset id ", dataset_id, " is not served by this agent (any more)"));
  }
  return found;
}

absl::StatusOr<Shards> ShardSet::Find(
    const std::string& dataset_id,
    const google::protobuf::RepeatedField<std::int32_t>& shard_indices) const {
  ISOSCOPE_ASSIGN_OR_RETURN(const Shards of_dataset, FindAll(dataset_id));
  std::vector<int> served;
  for (const std::shared_ptr<const Shard>& shard : of_dataset) {
    served.push_back(shard->reader->shard_index());
  }
  const store::Manifest& manifest = of_dataset.front()->reader->manifest();
  ISOSCOPE_ASSIGN_OR_RETURN(
      const std::vector<int> wanted,
      rpc::ShardIndicesFromProto(shard_indices, static_cast<int>(manifest.shards.size()),
                                 "shard_indices"));
  Shards found;
  for (const int index : wanted) {
    const auto position = std::find(served.begin(), served.end(), index);
    if (position == served.end()) {
      std::sort(served.begin(), served.end());
      return absl::FailedPreconditionError(absl::StrCat(
          "shard ", index, " of dataset \"", manifest.name,
          "\" is not served by this agent (any more); it serves ", absl::StrJoin(served, ", ")));
    }
    found.push_back(of_dataset[static_cast<std::size_t>(position - served.begin())]);
  }
  return found;
}

}  // namespace isoscope::agent
