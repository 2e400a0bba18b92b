#include "core/base/no_memory.h"

#include "absl/strings/str_cat.h"

namespace isoscope::base {

absl::Status NoMemory(absl::string_view what) noexcept {
  try {
    return absl::ResourceExhaustedError(absl::StrCat("no memory for ", what));
  } catch (const std::bad_alloc&) {
    return {absl::StatusCode::kResourceExhausted, ""};  // allocates nothing
  }
}

}  // namespace isoscope::base
