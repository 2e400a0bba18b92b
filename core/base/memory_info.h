// What the kernel says about memory.

#ifndef ISOSCOPE_CORE_BASE_MEMORY_INFO_H_
#define ISOSCOPE_CORE_BASE_MEMORY_INFO_H_

#include <cstddef>

namespace isoscope::base {

// The resident set of this process: programs, libraries and data. 0 where /proc can't be read.
std::size_t ResidentBytes();

// What this process may use: the machine's memory, or its control group's limit if that is lower.
std::size_t UsableBytes();

// Lets malloc spread threads over `count` arenas at most. Each holds on to what its threads freed,
// so that its default, eight for each core, can double what a process takes. Call it before threads
// start.
void LimitMallocArenas(int count);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MEMORY_INFO_H_
