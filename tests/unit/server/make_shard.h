// Descriptions of shards, as agents send them, without shards; and the sets that datasets make of
// them.

#ifndef ISOSCOPE_TESTS_UNIT_SERVER_MAKE_SHARD_H_
#define ISOSCOPE_TESTS_UNIT_SERVER_MAKE_SHARD_H_

#include <cstddef>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/store/manifest.h"
#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "server/cluster/dataset_catalog.h"
#include "wire/proto_convert.h"

namespace isoscope::testing {

inline constexpr char kSomeId[] = "0123456789abcdef0123456789abcdef";

// One shard of a dataset of 9^3 samples in 8 blocks.
inline isoscope::internal::v1::ShardDescription MakeShard(const std::string& name, int shard_index,
                                                          int shard_count,
                                                          const std::string& id = kSomeId) {
  store::Manifest manifest;
  manifest.dataset_id = id;
  manifest.name = name;
  manifest.geometry.sample_dims = {9, 9, 9};
  manifest.value_range = {0, 255};
  manifest.block_cells = {4, 4, 4};
  manifest.shards.resize(static_cast<std::size_t>(shard_count));
  isoscope::internal::v1::ShardDescription shard;
  *shard.mutable_dataset() = wire::ToProto(manifest);
  shard.set_manifest_crc32c(0x1234);
  shard.set_range_table_crc32c(0x5678);
  shard.set_shard_index(shard_index);
  shard.set_block_count(8 / shard_count);
  return shard;
}

// "0,2: a:1 b:1" for each set.
inline std::vector<std::string> SetsOf(const server::DatasetState& dataset) {
  std::vector<std::string> sets;
  for (const server::ReplicaSet& set : dataset.replica_sets) {
    sets.push_back(absl::StrCat(
        absl::StrJoin(set.shard_indices, ","), ": ",
        absl::StrJoin(set.agents, " ", [](std::string* out, const server::ServingAgent& agent) {
          absl::StrAppend(out, agent.address);
        })));
  }
  return sets;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_SERVER_MAKE_SHARD_H_
