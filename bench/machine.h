// The machine and the date of a measurement.

#ifndef ISOSCOPE_BENCH_MACHINE_H_
#define ISOSCOPE_BENCH_MACHINE_H_

#include <string>

namespace isoscope::bench {

struct Machine {
  std::string processor;  // "Intel(R) Xeon(R) Processor"
  int core_count = 0;     // available to this process
  double memory_gib = 0;
  std::string system;  // "Debian GNU/Linux 12 (bookworm), Linux 6.1.0"
};
// Describes this machine. An unknown text is "unknown", an unknown number is 0.
Machine DescribeMachine();
// "Intel(R) Xeon(R) Processor, 2 cores, 7.8 GiB, Debian ..., Linux 6.1.0".
std::string ToString(const Machine& machine);

// Returns the present time: "2026-11-20 19:49 UTC".
std::string Timestamp();

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_MACHINE_H_
