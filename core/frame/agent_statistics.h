// The cost of one agent's part in a frame. The agent measures it, the coordinator sums it up.

#ifndef ISOSCOPE_CORE_FRAME_AGENT_STATISTICS_H_
#define ISOSCOPE_CORE_FRAME_AGENT_STATISTICS_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/time/time.h"

namespace isoscope::frame {

// Units and meanings are those of isoscope.v1.SurfaceStatistics.
struct SurfaceStatistics {
  std::int64_t triangle_count = 0;
  std::int64_t unique_vertex_count = 0;

  SurfaceStatistics& operator+=(const SurfaceStatistics& other) {
    triangle_count += other.triangle_count;
    unique_vertex_count += other.unique_vertex_count;
    return *this;
  }
  friend bool operator==(const SurfaceStatistics&, const SurfaceStatistics&) = default;
};

// Adds surface by surface; the longer list gives the length.
inline void AddTo(const std::vector<SurfaceStatistics>& from, std::vector<SurfaceStatistics>* to) {
  to->resize(std::max(from.size(), to->size()));
  for (std::size_t i = 0; i < from.size(); ++i) {
    (*to)[i] += from[i];
  }
}

// Units and meanings are those of isoscope.v1.AgentStatistics.
struct AgentStatistics {
  // The agent and its shards. Agents leave both empty; the coordinator fills them in.
  std::string agent_address;
  std::vector<int> shard_indices;

  std::int64_t active_block_count = 0;
  std::int64_t occluding_block_count = 0;
  std::int64_t visible_block_count = 0;
  std::int64_t triangle_count = 0;
  std::int64_t unique_vertex_count = 0;
  std::int64_t read_bytes = 0;
  std::int64_t index_page_read_count = 0;
  absl::Duration extract_duration;
  absl::Duration render_duration;
  absl::Duration busy_duration;
  std::vector<SurfaceStatistics> surfaces = {};
};

}  // namespace isoscope::frame

#endif  // ISOSCOPE_CORE_FRAME_AGENT_STATISTICS_H_
