#include "core/base/metrics.h"

#include <algorithm>

#include "absl/status/status.h"
#include "absl/time/clock.h"

#include "core/base/check.h"
#include "core/base/memory_info.h"
#include "core/base/version.h"

namespace isoscope::base {
namespace {

// About when the process began: this is set before main().
const absl::Time kStart = absl::Now();

}  // namespace

void DurationHistogram::Observe(absl::Duration duration) {
  const double seconds = std::max(absl::ToDoubleSeconds(duration), 0.0);
  const auto bucket = static_cast<std::size_t>(
      std::lower_bound(kBounds.begin(), kBounds.end(), seconds) - kBounds.begin());
  counts_[bucket].fetch_add(1, std::memory_order_relaxed);
  nanoseconds_.fetch_add(std::max<std::int64_t>(absl::ToInt64Nanoseconds(duration), 0),
                         std::memory_order_relaxed);
}

MetricSample MetricSample::Of(double value, MetricLabels labels) {
  return {.labels = std::move(labels), .value = value, .cumulative_counts = {}};
}

MetricSample MetricSample::Of(const Counter& counter, MetricLabels labels) {
  return Of(static_cast<double>(counter.value()), std::move(labels));
}

MetricSample MetricSample::Of(const DurationHistogram& histogram, MetricLabels labels) {
  MetricSample sample;
  sample.labels = std::move(labels);
  sample.value = 1e-9 * static_cast<double>(histogram.nanoseconds_.load(std::memory_order_relaxed));
  std::int64_t sum = 0;
  for (const std::atomic<std::int64_t>& count : histogram.counts_) {
    sum += count.load(std::memory_order_relaxed);
    sample.cumulative_counts.push_back(sum);
  }
  return sample;
}

CountersByName::CountersByName(std::string label, std::vector<std::string> outcomes,
                               std::size_t max_names)
    : label_(std::move(label)),
      outcomes_(std::move(outcomes)),
      max_names_(max_names),
      other_(outcomes_.size()) {}

void CountersByName::Add(absl::string_view name, std::size_t outcome) {
  const MutexLock lock(&mutex_);
  const std::string key(name);
  const auto found = counts_.find(key);
  if (found != counts_.end()) {
    ++found->second[outcome];
  } else if (counts_.size() < max_names_) {
    ++counts_.emplace(key, outcomes_.size()).first->second[outcome];
  } else {
    ++other_[outcome];
  }
}

std::vector<MetricSample> CountersByName::Samples() const {
  const MutexLock lock(&mutex_);
  std::vector<MetricSample> samples;
  const auto append = [&](const std::string& name, const std::vector<std::int64_t>& counts) {
    for (std::size_t i = 0; i < outcomes_.size(); ++i) {
      samples.push_back(MetricSample::Of(static_cast<double>(counts[i]),
                                         {{label_, name}, {"outcome", outcomes_[i]}}));
    }
  };
  for (const auto& [name, counts] : counts_) {
    append(name, counts);
  }
  append(kOtherName, other_);
  return samples;
}

void RequestMetrics::Count(std::size_t method, absl::StatusCode code, absl::Duration duration) {
  ISOSCOPE_CHECK(method < method_metrics_.size());
  const auto number = static_cast<std::size_t>(code);
  method_metrics_[method]
      .by_code[number < kCodeCount ? number : static_cast<std::size_t>(absl::StatusCode::kUnknown)]
      .Add();
  method_metrics_[method].duration.Observe(duration);
}

std::vector<MetricSample> RequestMetrics::Counts() const {
  std::vector<MetricSample> samples;
  for (std::size_t i = 0; i < methods_.size(); ++i) {
    for (std::size_t code = 0; code < kCodeCount; ++code) {
      const std::int64_t count = method_metrics_[i].by_code[code].value();
      if (count > 0 || code == 0) {
        samples.push_back(MetricSample::Of(
            static_cast<double>(count),
            {{"method", methods_[i]},
             {"code", absl::StatusCodeToString(static_cast<absl::StatusCode>(code))}}));
      }
    }
  }
  return samples;
}

std::vector<MetricSample> RequestMetrics::Durations() const {
  std::vector<MetricSample> samples;
  for (std::size_t i = 0; i < methods_.size(); ++i) {
    samples.push_back(MetricSample::Of(method_metrics_[i].duration, {{"method", methods_[i]}}));
  }
  return samples;
}

std::vector<MetricFamily> ProcessMetrics(absl::string_view program,
                                         std::int64_t memory_limit_bytes) {
  using Type = MetricFamily::Type;
  std::vector<MetricFamily> families = {
      {.name = "isoscope_build_info",
       .help = "Always 1; the labels tell program and version.",
       .type = Type::kGauge,
       .samples = {MetricSample::Of(
           1, {{"program", std::string(program)}, {"version", std::string(Version())}})}},
      {.name = "process_start_time_seconds",
       .help = "When the process began, in seconds since 1970.",
       .type = Type::kGauge,
       .samples = {MetricSample::Of(1e-9 * static_cast<double>(absl::ToUnixNanos(kStart)))}},
      {.name = "process_resident_memory_bytes",
       .help = "Resident memory of the process.",
       .type = Type::kGauge,
       .samples = {MetricSample::Of(static_cast<double>(ResidentBytes()))}}};
  if (memory_limit_bytes > 0) {
    families.push_back({.name = "isoscope_memory_limit_bytes",
                        .help = "The process's --memory-limit.",
                        .type = Type::kGauge,
                        .samples = {MetricSample::Of(static_cast<double>(memory_limit_bytes))}});
  }
  return families;
}

}  // namespace isoscope::base
