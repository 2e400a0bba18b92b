// Memory that runs out, as a status. std::bad_alloc passes through parallel loops to their caller.
// It becomes a status once, where a step begins: of a frame, of a read, of a picture.

#ifndef ISOSCOPE_CORE_BASE_NO_MEMORY_H_
#define ISOSCOPE_CORE_BASE_NO_MEMORY_H_

#include <new>
#include <type_traits>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace isoscope::base {

// Returns RESOURCE_EXHAUSTED: there is no memory for `what`. It has no message if there is no
// memory for one either.
absl::Status NoMemory(absl::string_view what) noexcept;

// Returns what fn() returns, an absl::Status or absl::StatusOr; NoMemory(what) if it throws
// std::bad_alloc.
template <typename Fn>
std::invoke_result_t<const Fn&> OrNoMemory(absl::string_view what, const Fn& fn) {
  try {
    return fn();
  } catch (const std::bad_alloc&) {
    return NoMemory(what);
  }
}

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_NO_MEMORY_H_
