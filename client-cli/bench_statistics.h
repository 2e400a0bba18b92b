// What measurements are summed up with, and where they were made.

#ifndef ISOSCOPE_CLIENT_CLI_BENCH_STATISTICS_H_
#define ISOSCOPE_CLIENT_CLI_BENCH_STATISTICS_H_

#include <string>
#include <vector>

namespace isoscope::cli {

// The middle value, or the mean of the two in the middle; 0 of none.
double Median(std::vector<double> values);
double Sum(const std::vector<double>& values);
// 1: all equal; 0 if there are none or all are 0.
double MaxOverMean(const std::vector<double>& values);

struct Machine {
  std::string processor;  // "Intel(R) Xeon(R) Processor"
  int core_count = 0;     // that this process may use
  double memory_gib = 0;
  std::string system;  // "Debian GNU/Linux 12 (bookworm), Linux 6.1.0"
};
// This one; what can't be found out is "unknown" or 0.
Machine DescribeMachine();
// "Intel(R) Xeon(R) Processor, 2 cores, 7.8 GiB, Debian ..., Linux 6.1.0".
std::string ToString(const Machine& machine);

// Now, "2026-11-20 19:49 UTC".
std::string Timestamp();

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_BENCH_STATISTICS_H_
