// How the agents of a process share its memory limit: what is fixed, what frames need while a step
// runs, and what is left for caches.

#ifndef ISOSCOPE_PARTITION_AGENT_AGENT_MEMORY_H_
#define ISOSCOPE_PARTITION_AGENT_AGENT_MEMORY_H_

#include <cstddef>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/memory_budget.h"
#include "core/view/camera.h"
#include "partition-agent/block_cache.h"

namespace isoscope::agent {

// Thread-safe. Outlives the agents that use it.
class AgentMemory {
 public:
  // A quarter of what the process may use, at least 1 GiB.
  static std::size_t DefaultLimitBytes();
  static constexpr std::size_t kMinLimitBytes = std::size_t{96} << 20;

  // REQUIRES: limit_bytes >= kMinLimitBytes. The cache keeps nothing before Settle.
  explicit AgentMemory(std::size_t limit_bytes);

  // Once all shards are open: gives the cache what the process does not hold yet and frames do not
  // need. FAILED_PRECONDITION if that is nothing: says how much the limit must be.
  absl::Status Settle();

  // For a renderer: unused images and buffers, and meshes that wait for their pixels to be shaded.
  [[nodiscard]] std::size_t unused_image_bytes() const { return limit_bytes_ / 16; }
  [[nodiscard]] std::size_t kept_mesh_bytes() const { return limit_bytes_ / 16; }

  // What one step of a frame, or one batch of an export, may have of reads under way: a 32nd of the
  // limit, at most 16 MiB (more does not pay), at least one run of blocks.
  [[nodiscard]] std::size_t read_bytes() const;

  // What one step of a frame needs, read_bytes() among it. Waits for others; RESOURCE_EXHAUSTED if
  // the viewport is too large for the limit.
  absl::StatusOr<base::MemoryBudget::Reservation> ReserveStep(
      const view::Viewport& viewport, const base::Cancellation& cancellation);

  [[nodiscard]] BlockCache* cache() { return &cache_; }

 private:
  const std::size_t limit_bytes_;
  base::MemoryBudget steps_;
  BlockCache cache_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_AGENT_MEMORY_H_
