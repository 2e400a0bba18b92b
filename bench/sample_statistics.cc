#include "bench/sample_statistics.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

namespace isoscope::bench {

double Median(std::vector<double> values) {
  if (values.empty()) {
    return 0;
  }
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  return values.size() % 2 == 1 ? values[middle] : (values[middle - 1] + values[middle]) / 2;
}

double Rounded(double value) { return std::round(value * 1e3) / 1e3; }

double Sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

double MaxOverMean(const std::vector<double>& values) {
  const double sum = Sum(values);
  return sum > 0 ? *std::max_element(values.begin(), values.end()) *
                       static_cast<double>(values.size()) / sum
                 : 0;
}

}  // namespace isoscope::bench
