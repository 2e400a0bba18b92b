#include "core/base/memory_info.h"

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>

namespace isoscope::base {
namespace {

std::size_t PageBytes() { return static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)); }

}  // namespace

std::size_t ResidentBytes() {
  // The file has the whole size, then the resident size, in pages.
  std::ifstream file("/proc/self/statm");
  std::size_t size = 0;
  std::size_t resident = 0;
  if (!(file >> size >> resident)) {
    return 0;
  }
  return resident * PageBytes();
}

std::size_t UsableBytes() {
  std::size_t usable = static_cast<std::size_t>(::sysconf(_SC_PHYS_PAGES)) * PageBytes();
  // These are the files of control groups version 2 and version 1, as a container sees its own
  // group. A file without a number sets no limit.
  for (const char* path :
       {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"}) {
    std::ifstream file(path);
    std::size_t limit = 0;
    if (file >> limit && limit > 0) {
      usable = std::min(usable, limit);
    }
  }
  return usable;
}

void LimitMallocArenas(int count) { ::mallopt(M_ARENA_MAX, count); }

}  // namespace isoscope::base
