// The kernel tells the state of each thread (proc(5), /proc/self/task/*/stat): R for one that runs
// or waits for a processor. A thread that computes a little between two samples shows in the time
// of the processors.

#include "core/base/standstill.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <string>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace isoscope::base {
namespace {

// Timers of libraries wake now and then, for some 50 us.
constexpr std::int64_t kMaxUsedNs = 2'000'000;

std::int64_t TimeOf(clockid_t clock) {
  timespec used{};
  clock_gettime(clock, &used);
  return std::int64_t{1'000'000'000} * used.tv_sec + used.tv_nsec;
}

// The state of a thread of this process; 0 if it has ended.
char StateOf(const std::string& thread) {
  const std::string path = absl::StrCat("/proc/self/task/", thread, "/stat");
  const int file = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) {
    return 0;
  }
  std::array<char, 256> text{};
  const ssize_t size = read(file, text.data(), text.size());
  close(file);
  // "ID (NAME) STATE ...", where the name may have any letters.
  const absl::string_view stat(text.data(), static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  const std::size_t end = stat.rfind(')');
  return end == absl::string_view::npos || end + 2 >= stat.size() ? 0 : stat[end + 2];
}

bool HasRunningThread() {
  const std::string own = absl::StrCat(gettid());
  std::error_code error;
  for (std::filesystem::directory_iterator entry("/proc/self/task", error), end;
       !error && entry != end; entry.increment(error)) {
    const std::string thread = entry->path().filename().string();
    if (thread != own && StateOf(thread) == 'R') {
      return true;
    }
  }
  return static_cast<bool>(error);  // without /proc nobody knows
}

}  // namespace

bool StandstillWatch::Sample() {
  const std::int64_t used_ns = TimeOf(CLOCK_PROCESS_CPUTIME_ID) - TimeOf(CLOCK_THREAD_CPUTIME_ID);
  const bool is_at_rest = used_ns_ >= 0 && used_ns - used_ns_ <= kMaxUsedNs && !HasRunningThread();
  used_ns_ = used_ns;
  at_rest_ = is_at_rest ? at_rest_ + 1 : 0;
  return at_rest_ >= sample_count_;
}

}  // namespace isoscope::base
