// Statistics over repeated measurements.

#ifndef ISOSCOPE_BENCH_SAMPLE_STATISTICS_H_
#define ISOSCOPE_BENCH_SAMPLE_STATISTICS_H_

#include <vector>

namespace isoscope::bench {

// The middle value, or the mean of the two in the middle; 0 of none.
double Median(std::vector<double> values);
// To three decimals.
double Rounded(double value);
double Sum(const std::vector<double>& values);
// 1: all equal; 0 if there are none or all are 0.
double MaxOverMean(const std::vector<double>& values);

}  // namespace isoscope::bench

#endif  // ISOSCOPE_BENCH_SAMPLE_STATISTICS_H_
