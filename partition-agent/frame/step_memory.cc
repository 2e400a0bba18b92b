#include "partition-agent/frame/step_memory.h"

#include "absl/time/time.h"

#include "core/base/no_memory.h"
#include "core/base/retry_delay.h"

namespace isoscope::agent {
namespace {

// Other frames end meanwhile, and give their memory back.
constexpr absl::Duration kRetryDelay = absl::Milliseconds(500);

}  // namespace

absl::Status NoMemoryForStep() noexcept {
  absl::Status error = base::NoMemory("a step of the frame");
  try {
    return base::WithRetryDelay(error, kRetryDelay);
  } catch (const std::bad_alloc&) {
    return error;
  }
}

}  // namespace isoscope::agent
