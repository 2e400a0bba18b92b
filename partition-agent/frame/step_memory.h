// Memory that runs out in a step of a frame. The limit has room for the step's pixels then, so the
// machine is short of memory: the same frame may work later, and fewer pixels need be no help.

#ifndef ISOSCOPE_PARTITION_AGENT_FRAME_STEP_MEMORY_H_
#define ISOSCOPE_PARTITION_AGENT_FRAME_STEP_MEMORY_H_

#include <new>
#include <type_traits>

#include "absl/status/status.h"

namespace isoscope::agent {

// Returns RESOURCE_EXHAUSTED with a retry delay: its reason is TOO_BUSY, not TOO_LARGE. It has
// neither delay nor message if there is no memory for them.
absl::Status NoMemoryForStep() noexcept;

// Returns what fn() returns, an absl::Status or absl::StatusOr; NoMemoryForStep() if it throws
// std::bad_alloc.
template <typename Fn>
std::invoke_result_t<const Fn&> OrNoMemoryForStep(const Fn& fn) {
  try {
    return fn();
  } catch (const std::bad_alloc&) {
    return NoMemoryForStep();
  }
}

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_FRAME_STEP_MEMORY_H_
