// The metrics of a server, as its tests read them.

#ifndef ISOSCOPE_TESTS_SUPPORT_METRIC_VALUES_H_
#define ISOSCOPE_TESTS_SUPPORT_METRIC_VALUES_H_

#include <map>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"

#include "core/base/metrics.h"

namespace isoscope::testing {

// "name a=b c=d" to value; of histograms the number of observations.
inline std::map<std::string, double> ValuesOf(const std::vector<base::MetricFamily>& families) {
  std::map<std::string, double> values;
  for (const base::MetricFamily& family : families) {
    for (const base::MetricSample& sample : family.samples) {
      std::string key = family.name;
      for (const auto& [name, value] : sample.labels) {
        absl::StrAppend(&key, " ", name, "=", value);
      }
      values[key] = sample.cumulative_counts.empty()
                        ? sample.value
                        : static_cast<double>(sample.cumulative_counts.back());
    }
  }
  return values;
}

inline void ExpectNamesFollowTheConvention(const std::vector<base::MetricFamily>& families) {
  std::set<std::string> names;
  for (const base::MetricFamily& family : families) {
    EXPECT_TRUE(names.insert(family.name).second) << family.name << " comes twice";
    EXPECT_TRUE(absl::EndsWith(family.help, ".")) << family.name;
    EXPECT_FALSE(family.samples.empty()) << family.name;
    EXPECT_EQ(absl::EndsWith(family.name, "_total"),
              family.type == base::MetricFamily::Type::kCounter)
        << family.name;
    if (family.type == base::MetricFamily::Type::kHistogram) {
      EXPECT_TRUE(absl::EndsWith(family.name, "_seconds")) << family.name;
    }
  }
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_SUPPORT_METRIC_VALUES_H_
