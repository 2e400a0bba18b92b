// Facts about memory from the kernel.

#ifndef ISOSCOPE_CORE_BASE_MEMORY_INFO_H_
#define ISOSCOPE_CORE_BASE_MEMORY_INFO_H_

#include <cstddef>

namespace isoscope::base {

// Returns the resident set of this process: program, libraries and data. 0 if /proc can't be read.
std::size_t ResidentBytes();

// Returns the memory that this process may use: the machine's, or the limit of its control group.
std::size_t UsableBytes();

// Lets malloc spread threads over `count` arenas at most. An arena keeps the memory that its
// threads have freed, so the default of eight arenas for each core can double the size of a
// process. Call it before threads start.
void LimitMallocArenas(int count);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_MEMORY_INFO_H_
