#include "core/base/metrics.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/version.h"

namespace isoscope::base {
namespace {

using ::testing::ElementsAre;
using ::testing::Pair;

TEST(MetricsTest, ManyThreadsCountEachEventOnce) {
  Counter counter;
  DurationHistogram histogram;
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&] {
      for (int k = 0; k < 1000; ++k) {
        counter.Add();
        histogram.Observe(absl::Milliseconds(2));
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_EQ(counter.value(), 8000);
  const MetricSample sample = MetricSample::Of(histogram);
  EXPECT_EQ(sample.cumulative_counts.back(), 8000);
  EXPECT_NEAR(sample.value, 16, 1e-9);
}

TEST(MetricsTest, AHistogramPutsADurationIntoTheBucketsThatItDoesNotExceed) {
  DurationHistogram histogram;
  histogram.Observe(absl::Milliseconds(1));  // exactly the first bound
  histogram.Observe(absl::Milliseconds(30));
  histogram.Observe(absl::Hours(1));          // beyond the last
  histogram.Observe(-absl::Milliseconds(5));  // a clock that went back
  const MetricSample sample = MetricSample::Of(histogram);
  ASSERT_EQ(sample.cumulative_counts.size(), DurationHistogram::kBounds.size() + 1);
  for (std::size_t i = 0; i < DurationHistogram::kBounds.size(); ++i) {
    EXPECT_EQ(sample.cumulative_counts[i], DurationHistogram::kBounds[i] < 0.03 ? 2 : 3) << i;
  }
  EXPECT_EQ(sample.cumulative_counts.back(), 4);
  EXPECT_NEAR(sample.value, 3600.031, 1e-9);
  EXPECT_TRUE(std::is_sorted(DurationHistogram::kBounds.begin(), DurationHistogram::kBounds.end()));
}

TEST(MetricsTest, ACounterOfDurationsGivesSeconds) {
  Counter counter;
  counter.Add(absl::Milliseconds(1500));
  counter.Add(absl::Nanoseconds(1));
  EXPECT_DOUBLE_EQ(counter.seconds(), 1.500000001);
}

TEST(MetricsTest, ScopedObservationsCountOnce) {
  DurationHistogram histogram;
  {
    ScopedObservation scope(&histogram);
    scope.End();
  }
  { const ScopedObservation scope(&histogram); }
  { const ScopedObservation nobody(nullptr); }
  EXPECT_EQ(MetricSample::Of(histogram).cumulative_counts.back(), 2);
}

TEST(MetricsTest, RequestsAreCountedByMethodAndCode) {
  RequestMetrics requests({"Draw", "Ask"});
  requests.Count(0, absl::StatusCode::kOk, absl::Milliseconds(5));
  requests.Count(0, absl::StatusCode::kUnavailable, absl::Milliseconds(5));
  requests.Count(0, absl::StatusCode::kUnavailable, absl::Milliseconds(5));
  requests.Count(0, static_cast<absl::StatusCode>(77), absl::Milliseconds(5));
  const std::vector<MetricSample> counts = requests.Counts();
  std::vector<std::pair<std::string, double>> found;
  for (const MetricSample& sample : counts) {
    ASSERT_EQ(sample.labels.size(), 2u);
    EXPECT_EQ(sample.labels[0].first, "method");
    EXPECT_EQ(sample.labels[1].first, "code");
    found.emplace_back(sample.labels[0].second + " " + sample.labels[1].second, sample.value);
  }
  EXPECT_THAT(found, ElementsAre(Pair("Draw OK", 1), Pair("Draw UNKNOWN", 1),
                                 Pair("Draw UNAVAILABLE", 2), Pair("Ask OK", 0)));
  ASSERT_EQ(requests.Durations().size(), 2u);
  EXPECT_EQ(requests.Durations()[0].cumulative_counts.back(), 4);
}

TEST(MetricsTest, AProcessTellsItsVersionStartAndMemory) {
  const std::vector<MetricFamily> families = ProcessMetrics("isoscope-test", 1 << 20);
  ASSERT_EQ(families.size(), 4u);
  EXPECT_EQ(families[0].samples[0].labels[1].second, std::string(Version()));
  EXPECT_GT(families[1].samples[0].value, 1.7e9);
  EXPECT_GT(families[2].samples[0].value, 1e5);
  EXPECT_EQ(families[3].samples[0].value, 1 << 20);
  EXPECT_EQ(ProcessMetrics("isoscope-test", 0).size(), 3u);
}

TEST(CountersByNameTest, NamesBeyondTheBoundShareOneSeries) {
  CountersByName counters("agent", {"done", "failed"}, 2);
  for (const char* name : {"a:1", "b:1", "c:1", "d:1", "a:1"}) {
    counters.Add(name, 0);
  }
  counters.Add("d:1", 1);
  std::vector<std::string> seen;
  for (const MetricSample& sample : counters.Samples()) {
    seen.push_back(sample.labels[0].first + "=" + sample.labels[0].second + " " +
                   sample.labels[1].second + " " + std::to_string(static_cast<int>(sample.value)));
  }
  EXPECT_EQ(seen, (std::vector<std::string>{"agent=a:1 done 2", "agent=a:1 failed 0",
                                            "agent=b:1 done 1", "agent=b:1 failed 0",
                                            "agent=(other) done 2", "agent=(other) failed 1"}));
}

TEST(CountersByNameTest, ManyThreadsLoseNothing) {
  CountersByName counters("caller", {"done"}, 3);
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&counters, i] {
      for (int j = 0; j < 1000; ++j) {
        counters.Add(std::to_string((i + j) % 5), 0);
      }
    });
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  double sum = 0;
  for (const MetricSample& sample : counters.Samples()) {
    sum += sample.value;
  }
  EXPECT_EQ(sum, 8000);
  EXPECT_EQ(counters.Samples().size(), 4u);
}

TEST(GaugeTest, AShareCountsWhileItLives) {
  Gauge gauge;
  {
    GaugeShare share(&gauge);
    GaugeShare other(&gauge);
    share.Set(10);
    share.Add(5);
    other.Set(100);
    EXPECT_EQ(gauge.value(), 115);
    share.Set(1);
    EXPECT_EQ(gauge.value(), 101);
  }
  EXPECT_EQ(gauge.value(), 0);
}

TEST(DurationHistogramTest, FramesOfViewsThatMoveHaveBoundsOfTheirRates) {
  for (const double bound : {0.016, 0.033}) {
    EXPECT_TRUE(std::count(DurationHistogram::kBounds.begin(), DurationHistogram::kBounds.end(),
                           bound) == 1)
        << bound;
  }
}

}  // namespace
}  // namespace isoscope::base
