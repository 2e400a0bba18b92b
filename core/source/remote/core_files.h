// Core files: what the system writes of a process that crashed. One that has read credentials holds
// them in memory, and its core would, too.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_CORE_FILES_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_CORE_FILES_H_

namespace isoscope::source {

// Leaves the memory of this process, and of children that it starts from now on, out of their core
// files: they keep registers alone. Called where a credential is read. Does nothing where the system
// has no /proc/self/coredump_filter, nor with ISOSCOPE_FULL_CORES=1. Thread-safe.
// Source: Linux, Documentation/filesystems/proc.rst, "3.4 /proc/<pid>/coredump_filter".
void LeaveMemoryOutOfCores();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_CORE_FILES_H_
