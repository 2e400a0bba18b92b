// Core files: what the system writes of a process that crashed. One that has read credentials holds
// them in memory, and its core would, too.

#ifndef ISOSCOPE_CORE_SOURCE_REMOTE_CORE_FILES_H_
#define ISOSCOPE_CORE_SOURCE_REMOTE_CORE_FILES_H_

namespace isoscope::source {

// From now on the system writes no core of this process, nor of children that it starts. Called
// where a credential is read. A core of registers alone would not do: vector registers of a thread
// that waits still have what it copied last, such as a password. Should a core be taken by other
// means, memory is left out. Does nothing with ISOSCOPE_FULL_CORES=1. Thread-safe.
// Sources: Linux, Documentation/filesystems/proc.rst, "3.4 /proc/<pid>/coredump_filter"; core(5).
void ForbidCores();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REMOTE_CORE_FILES_H_
