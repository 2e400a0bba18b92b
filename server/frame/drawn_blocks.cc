#include "server/frame/drawn_blocks.h"

#include <algorithm>

#include "core/base/check.h"

namespace isoscope::server {

DrawnBlocks::DrawnBlocks(std::int64_t block_count)
    : ray_hits_(block_count),
      occluding_(block_count),
      drawn_(block_count),
      drawn_in_step_3_(block_count) {}

std::size_t DrawnBlocks::BytesOf(std::int64_t block_count) {
  constexpr std::size_t kSets = 4;
  return kSets * sizeof(std::uint64_t) * static_cast<std::size_t>((block_count + 63) / 64);
}

void DrawnBlocks::Add(const ReducedFrame& band) {
  if (band.active == nullptr) {
    return;
  }
  active_ = band.active;
  ray_hits_.UnionWith(band.ray_hits);
  for (const PartBlocks& part : band.blocks) {
    occluding_.InsertAll(part.occluders);
    drawn_.InsertAll(part.occluders);
    drawn_.InsertAll(part.visible);
    drawn_in_step_3_.InsertAll(part.visible);
  }
}

std::vector<volume::BlockId> DrawnBlocks::OpaqueOf(std::size_t part_index) const {
  return MembersOf(part_index, drawn_);
}

std::vector<volume::BlockId> DrawnBlocks::TranslucentOf(std::size_t part_index) const {
  return MembersOf(part_index, drawn_in_step_3_);
}

std::vector<volume::BlockId> DrawnBlocks::MembersOf(std::size_t part_index,
                                                    const volume::BlockSet& set) const {
  std::vector<volume::BlockId> members;
  if (active_ == nullptr) {
    return members;
  }
  ISOSCOPE_CHECK_LT(part_index + 1, active_->begin_by_agent.size());
  for (std::size_t i = active_->begin_by_agent[part_index];
       i < active_->begin_by_agent[part_index + 1]; ++i) {
    if (set.Contains(active_->ids[i])) {
      members.push_back(active_->ids[i]);
    }
  }
  return members;
}

void DrawnBlocks::SetCounts(const std::vector<FramePart>& parts, FrameCost* cost) const {
  if (active_ == nullptr) {
    return;
  }
  cost->ray_hit_block_count = ray_hits_.Count();
  cost->total.occluding_block_count = occluding_.Count();
  cost->total.visible_block_count = drawn_.Count();
  for (frame::AgentStatistics& agent : cost->agents) {
    const auto part = std::find_if(parts.begin(), parts.end(), [&](const FramePart& of_frame) {
      return of_frame.shard_indices == agent.shard_indices;
    });
    ISOSCOPE_CHECK(part != parts.end());
    const auto part_index = static_cast<std::size_t>(part - parts.begin());
    agent.occluding_block_count =
        static_cast<std::int64_t>(MembersOf(part_index, occluding_).size());
    agent.visible_block_count = static_cast<std::int64_t>(MembersOf(part_index, drawn_).size());
  }
}

}  // namespace isoscope::server
