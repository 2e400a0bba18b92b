#include "core/source/remote/core_files.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>

#include "absl/strings/string_view.h"
#include <sys/resource.h>

namespace isoscope::source {
namespace {

// In bytes. No core file is so short. Where a program takes cores from a pipe, limits count for
// nothing but for this one: do_coredump() of Linux takes it for a crash of that program.
constexpr rlim_t kNoCore = 1;

// Returns true: there is nothing more to try.
bool LimitCores() {
  const char* const full = std::getenv("ISOSCOPE_FULL_CORES");  // NOLINT(concurrency-mt-unsafe)
  if (full != nullptr && absl::string_view(full) == "1") {
    return true;
  }
  rlimit limit{};
  if (getrlimit(RLIMIT_CORE, &limit) == 0) {
    limit.rlim_cur = std::min(limit.rlim_max, kNoCore);
    setrlimit(RLIMIT_CORE, &limit);
  }
  const int file = open("/proc/self/coredump_filter", O_WRONLY | O_CLOEXEC);
  if (file >= 0) {
    [[maybe_unused]] const ssize_t written = write(file, "0", 1);
    close(file);
  }
  return true;
}

}  // namespace

void ForbidCores() { [[maybe_unused]] static const bool is_done = LimitCores(); }

}  // namespace isoscope::source
