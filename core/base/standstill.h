// Finds out that a process stands still: all of its threads wait.

#ifndef ISOSCOPE_CORE_BASE_STANDSTILL_H_
#define ISOSCOPE_CORE_BASE_STANDSTILL_H_

#include <cstdint>

namespace isoscope::base {

// Takes samples of the process. A thread that waits for a processor does not stand still, however
// long the machine keeps it waiting. Thread-compatible.
class StandstillWatch {
 public:
  // This many samples in a row must find all threads at rest.
  explicit StandstillWatch(int sample_count) : sample_count_(sample_count) {}

  // Takes a sample. True if the process stands still, but for the calling thread.
  bool Sample();

 private:
  int sample_count_;
  int at_rest_ = 0;
  std::int64_t used_ns_ = -1;  // of processors, by all other threads, at the last sample
};

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_STANDSTILL_H_
