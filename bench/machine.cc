#include "bench/machine.h"

#include <cstddef>
#include <fstream>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include <oneapi/tbb/info.h>
#include <sys/sysinfo.h>
#include <sys/utsname.h>

#include "core/base/units.h"

namespace isoscope::bench {
namespace {

// Returns the text after `separator` in the first line of a file that begins with `key`, or "".
std::string ValueInFile(const char* path, absl::string_view key, char separator) {
  std::ifstream file(path);
  for (std::string line; std::getline(file, line);) {
    const std::size_t at = line.find(separator);
    if (absl::StartsWith(line, key) && at != std::string::npos) {
      const std::size_t begin = line.find_first_not_of(" \"", at + 1);
      const std::size_t end = line.find_last_not_of(" \"");
      return begin == std::string::npos ? "" : line.substr(begin, end + 1 - begin);
    }
  }
  return "";
}

}  // namespace

Machine DescribeMachine() {
  Machine machine;
  machine.processor = ValueInFile("/proc/cpuinfo", "model name", ':');
  if (machine.processor.empty()) {
    machine.processor = "unknown processor";
  }
  machine.core_count = oneapi::tbb::info::default_concurrency();
  struct sysinfo memory {};
  if (sysinfo(&memory) == 0) {
    machine.memory_gib = static_cast<double>(memory.totalram) *
                         static_cast<double>(memory.mem_unit) / static_cast<double>(base::kGiB);
  }
  const std::string distribution = ValueInFile("/etc/os-release", "PRETTY_NAME", '=');
  utsname kernel{};
  machine.system = absl::StrCat(
      distribution.empty() ? "unknown system" : distribution,
      uname(&kernel) == 0 ? absl::StrCat(", ", kernel.sysname, " ", kernel.release) : "");
  return machine;
}

std::string ToString(const Machine& machine) {
  return absl::StrFormat("%s, %d %s, %.1f GiB, %s", machine.processor, machine.core_count,
                         machine.core_count == 1 ? "core" : "cores", machine.memory_gib,
                         machine.system);
}

std::string Timestamp() {
  return absl::FormatTime("%Y-%m-%d %H:%M UTC", absl::Now(), absl::UTCTimeZone());
}

}  // namespace isoscope::bench
