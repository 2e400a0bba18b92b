#include "core/base/memory_info.h"

#include <malloc.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <fstream>

#include <sys/mman.h>

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

void LimitMallocArenas(int count) {
  ::mallopt(M_ARENA_MAX, count);  // NOLINT(concurrency-mt-unsafe): before threads start
}

void ReturnFreedMemory() { ::malloc_trim(0); }

void ReturnPages(char* begin, std::size_t size) {
  const std::size_t page = PageBytes();
  const std::size_t misaligned = reinterpret_cast<std::uintptr_t>(begin) % page;
  const std::size_t head = misaligned == 0 ? 0 : page - misaligned;
  if (size >= head + page) {
    // Advice: if the kernel does not take it, the pages are freed with their buffer.
    ::madvise(begin + head, (size - head) / page * page, MADV_DONTNEED);
  }
}

absl::Duration ProcessorTime() {
  timespec used{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
  return absl::DurationFromTimespec(used);
}

bool RestWatch::HasComeToRest(absl::Duration processor_time) {
  const bool rests = processor_time - last_look_ < kInterval / 100;
  const bool has_come_to_rest = rests && has_worked_;
  last_look_ = processor_time;
  has_worked_ = !rests;
  return has_come_to_rest;
}

}  // namespace isoscope::base
