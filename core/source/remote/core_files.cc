#include "core/source/remote/core_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstdlib>

#include "absl/strings/string_view.h"

namespace isoscope::source {
namespace {

// Returns true: there is nothing more to try.
bool WriteFilter() {
  const char* const full = std::getenv("ISOSCOPE_FULL_CORES");  // NOLINT(concurrency-mt-unsafe)
  if (full != nullptr && absl::string_view(full) == "1") {
    return true;
  }
  const int file = open("/proc/self/coredump_filter", O_WRONLY | O_CLOEXEC);
  if (file >= 0) {
    [[maybe_unused]] const ssize_t written = write(file, "0", 1);  // cores stay as they were
    close(file);
  }
  return true;
}

}  // namespace

void LeaveMemoryOutOfCores() { [[maybe_unused]] static const bool is_done = WriteFilter(); }

}  // namespace isoscope::source
