// The answers of agents to DescribeShards: a dataset that is complete has each of its shards once,
// at agents that said so.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"

#include "server/cluster/dataset_catalog.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/unit/server/make_shard.h"

namespace isoscope::fuzz {
namespace {

namespace internal = isoscope::internal::v1;

void RequireComplete(const server::DatasetState& state,
                     const std::vector<server::AgentState>& agents) {
  std::vector<int> indices;
  for (const server::ReplicaSet& set : state.replica_sets) {
    Require(!set.agents.empty(), "a set has an agent");
    for (const server::ServingAgent& serving : set.agents) {
      const auto agent = std::find_if(agents.begin(), agents.end(), [&](const auto& known) {
        return known.address == serving.address;
      });
      Require(agent != agents.end() && agent->status.ok(),
              "a frame is drawn by agents that answer");
      Require(agent->picture_revision == state.picture_revision,
              "a frame is drawn with one picture revision");
      for (const int index : set.shard_indices) {
        Require(std::any_of(agent->shards.begin(), agent->shards.end(),
                            [&](const internal::ShardDescription& shard) {
                              return shard.shard_index() == index &&
                                     shard.dataset().dataset_id() == state.dataset.dataset_id();
                            }),
                "an agent draws shards that it has");
      }
    }
    indices.insert(indices.end(), set.shard_indices.begin(), set.shard_indices.end());
  }
  std::sort(indices.begin(), indices.end());
  Require(static_cast<std::int64_t>(indices.size()) == state.dataset.shard_count(),
          "a complete dataset has all of its shards");
  for (std::size_t i = 0; i < indices.size(); ++i) {
    Require(indices[i] == static_cast<int>(i), "a complete dataset has each shard once");
  }
}

void Run(Input input) {
  std::vector<server::AgentState> agents;
  for (int i = 0; i < 3 && !input.empty(); ++i) {
    const absl::string_view bytes = input.Piece();
    internal::DescribeShardsResponse answer;
    if (!answer.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
      continue;
    }
    server::AgentState agent;
    agent.address = absl::StrCat("agent:", i);
    server::AdoptAnswer(answer, &agent);
    if (!agent.status.ok()) {
      Require(!agent.status.message().empty(), "an answer is refused for a reason");
    }
    agents.push_back(agent);
  }
  const auto datasets = server::DatasetsOf(agents);
  for (const auto& [name, state] : datasets) {
    Require(name == state.dataset.name(), "a dataset is found by its name");
    if (state.status.ok()) {
      RequireComplete(state, agents);
    } else {
      RequireError(state.status, {absl::StatusCode::kFailedPrecondition});
    }
    Require(server::FindDataset(datasets, name, "").ok() || name.empty(),
            "a dataset that is listed is found");
  }
  static_cast<void>(server::DescribeUnreachable(agents));
}

internal::DescribeShardsResponse Answer(const std::vector<internal::ShardDescription>& shards) {
  internal::DescribeShardsResponse answer;
  answer.set_version("1.2.3");
  answer.set_renderer("cpu");
  answer.mutable_picture_revision()->set_number(1);
  answer.mutable_picture_revision()->set_back_end(internal::PictureRevision::BACK_END_CPU);
  answer.mutable_shards()->Assign(shards.begin(), shards.end());
  return answer;
}

}  // namespace

std::vector<std::string> Seeds() {
  using testing::MakeShard;
  const std::string first = Answer({MakeShard("head", 0, 2)}).SerializeAsString();
  const std::string second = Answer({MakeShard("head", 1, 2)}).SerializeAsString();
  const std::string other =
      Answer({MakeShard("head", 0, 1, "ffffffffffffffffffffffffffffffff"), MakeShard("tail", 0, 1)})
          .SerializeAsString();
  return {MakePiece(first), MakePiece(first) + MakePiece(second),
          MakePiece(first) + MakePiece(other) + MakePiece(second),
          MakePiece(first) + MakePiece(first) + MakePiece(second)};
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
