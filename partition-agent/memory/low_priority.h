// Threads of low priority, for work that can wait.

#ifndef ISOSCOPE_PARTITION_AGENT_MEMORY_LOW_PRIORITY_H_
#define ISOSCOPE_PARTITION_AGENT_MEMORY_LOW_PRIORITY_H_

#include <unistd.h>

#include <sys/resource.h>
#include <sys/syscall.h>

namespace isoscope::agent {

// On Linux, this sets the priority of one thread. If it fails, the thread still works.
inline void LowerPriorityOfThisThread() {
  constexpr int kNice = 10;
  static_cast<void>(::setpriority(PRIO_PROCESS, static_cast<id_t>(::syscall(SYS_gettid)), kNice));
}

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_MEMORY_LOW_PRIORITY_H_
