// Facts about memory from the kernel.

#ifndef ISOSCOPE_CORE_BASE_MEMORY_INFO_H_
#define ISOSCOPE_CORE_BASE_MEMORY_INFO_H_

#include <cstddef>

#include "absl/time/time.h"

namespace isoscope::base {

// Returns the resident set of this process: program, libraries and data. 0 if /proc can't be read.
std::size_t ResidentBytes();

// Returns the memory that this process may use: the machine's, or the limit of its control group.
std::size_t UsableBytes();

// Lets malloc spread threads over `count` arenas at most. An arena keeps the memory that its
// threads have freed, so the default of eight arenas for each core can double the size of a
// process. Call it before threads start.
void LimitMallocArenas(int count);

// Gives the memory that this process has freed, and malloc keeps, back to the kernel. Takes some
// milliseconds. Later allocations come from the kernel again.
void ReturnFreedMemory();

// Gives the whole pages of `size` bytes from `begin` back to the kernel, while they stay allocated.
// For large buffers whose begin is used up. The bytes are undefined then. REQUIRES: the memory is
// private and not a file's, as that of malloc.
void ReturnPages(char* begin, std::size_t size);

// Returns the processor time that all threads of this process have used.
absl::Duration ProcessorTime();

// Tells when a process has come to rest, so that it can return memory without slowing work down.
// Thread-compatible.
class RestWatch {
 public:
  // The time between two calls of HasComeToRest. A process at rest uses less than a hundredth of a
  // processor in it: health checks and scrapes of metrics count as rest.
  static constexpr absl::Duration kInterval = absl::Seconds(5);

  // To be called every kInterval with the processor time so far. True if the process has rested
  // since the last look, but not all the time since this was last true.
  bool HasComeToRest(absl::Duration processor_time);

 private:
  absl::Duration last_look_;
  bool has_worked_ = true;  // a start is work
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MEMORY_INFO_H_
