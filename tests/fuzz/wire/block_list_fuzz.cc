// Lists of blocks and of shards: accepted ones ascend within their bounds, and come back from their
// encoding.

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "isoscope/internal/v1/partition_agent_service.pb.h"
#include "tests/fuzz/fuzz_input.h"
#include "wire/proto_convert.h"

namespace isoscope::fuzz {
namespace {

namespace internal = isoscope::internal::v1;

constexpr std::int64_t kMaxBlockCount = std::int64_t{1} << 31;

template <typename T>
void RequireAscent(const std::vector<T>& ids, std::int64_t end) {
  std::int64_t least = 0;
  for (const T id : ids) {
    Require(static_cast<std::int64_t>(id) >= least && static_cast<std::int64_t>(id) < end,
            "ids ascend within their bounds");
    least = static_cast<std::int64_t>(id) + 1;
  }
}

void ReadBlocks(absl::string_view bytes, std::int64_t block_count) {
  internal::BlockList list;
  if (!list.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return;
  }
  const auto ids = wire::BlockListFromProto(list, block_count, "hits");
  if (!ids.ok()) {
    RequireError(ids.status(), {absl::StatusCode::kInvalidArgument}, "hits");
    return;
  }
  RequireAscent(*ids, block_count);
  const auto again = wire::BlockListFromProto(wire::ToProto(*ids), block_count, "again");
  Require(again.ok() && *again == *ids, "a list comes back from its message");
}

void ReadShards(absl::string_view bytes, int shard_count) {
  internal::BeginFrame begin;
  if (!begin.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return;
  }
  const auto indices = wire::ShardIndicesFromProto(begin.shard_indices(), shard_count, "shards");
  if (!indices.ok()) {
    RequireError(indices.status(), {absl::StatusCode::kInvalidArgument}, "shards");
    return;
  }
  Require(!indices->empty(), "a list of shards has one");
  RequireAscent(*indices, shard_count);
}

void Run(Input input) {
  const bool is_of_shards = input.Byte() % 2 == 1;
  const std::uint64_t bound = input.Number();
  const absl::string_view rest = input.Rest();
  if (is_of_shards) {
    ReadShards(rest, static_cast<int>(bound % 65536));
  } else {
    ReadBlocks(rest, static_cast<std::int64_t>(bound % kMaxBlockCount));
  }
}

std::string Bound(std::uint32_t bound) {
  std::string bytes(8, '\0');
  for (std::size_t i = 0; i < 4; ++i) {
    bytes[i] = static_cast<char>(bound >> (8 * i) & 0xff);
  }
  return bytes;
}

}  // namespace

std::vector<std::string> Seeds() {
  std::vector<std::string> seeds;
  const std::vector<std::vector<volume::BlockId>> lists{
      {}, {0}, {0, 1, 2, 3}, {7, 90, 1000, 100000}};
  for (const std::vector<volume::BlockId>& ids : lists) {
    for (const std::uint32_t bound : {8U, 200000U}) {
      seeds.push_back(std::string(1, '\0') + Bound(bound) + wire::ToProto(ids).SerializeAsString());
    }
  }
  internal::BeginFrame begin;
  for (const int index : {0, 1, 5}) {
    begin.add_shard_indices(index);
  }
  seeds.push_back("\1" + Bound(6) + begin.SerializeAsString());
  return seeds;
}

}  // namespace isoscope::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  isoscope::fuzz::Run(isoscope::fuzz::Input(data, size));
  return 0;
}
