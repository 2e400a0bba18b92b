// Numbers about a running process, for monitoring: counters and histograms that many threads update
// by atomics alone, and samples for a scrape. http::MetricsServer serves them.
//
// The coordinator's metrics belong to the parts that count them (AppendMetrics). An agent and a
// gateway have one file each with all of theirs (agent_metrics, gateway_metrics). Names and units follow Prometheus:
// isoscope_<what>_<unit>, base units (seconds, bytes), counters end in _total.

#ifndef ISOSCOPE_CORE_BASE_METRICS_H_
#define ISOSCOPE_CORE_BASE_METRICS_H_

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::base {

// Grows. Thread-safe.
class Counter {
 public:
  // REQUIRES: amount >= 0.
  void Add(std::int64_t amount = 1) { value_.fetch_add(amount, std::memory_order_relaxed); }
  void Add(absl::Duration amount) { Add(absl::ToInt64Nanoseconds(amount)); }

  [[nodiscard]] std::int64_t value() const { return value_.load(std::memory_order_relaxed); }
  // Returns the sum in seconds. REQUIRES: the counter counts durations, in nanoseconds.
  [[nodiscard]] double seconds() const { return 1e-9 * static_cast<double>(value()); }

 private:
  std::atomic<std::int64_t> value_{0};
};

// Counts durations by size. Thread-safe.
class DurationHistogram {
 public:
  // Upper bounds of the buckets, in seconds; a last bucket counts longer durations. 16 and 33 ms
  // are those of views at 60 and at 30 frames a second.
  static constexpr std::array<double, 18> kBounds = {0.001, 0.0025, 0.005, 0.01, 0.016, 0.025,
                                                     0.033, 0.05,   0.1,   0.25, 0.5,   1,
                                                     2.5,   5,      10,    30,   60,    300};

  // Negative durations count as 0.
  void Observe(absl::Duration duration);

 private:
  friend struct MetricSample;
  std::array<std::atomic<std::int64_t>, kBounds.size() + 1> counts_{};
  std::atomic<std::int64_t> nanoseconds_{0};
};

// Observes its own life, or up to End. Thread-compatible.
class ScopedObservation {
 public:
  // `histogram` may be null, and outlives the scope.
  explicit ScopedObservation(DurationHistogram* histogram)
      : histogram_(histogram), start_(MonotonicNow()) {}
  ~ScopedObservation() { End(); }
  ScopedObservation(const ScopedObservation&) = delete;
  ScopedObservation& operator=(const ScopedObservation&) = delete;

  void End() {
    if (histogram_ != nullptr) {
      std::exchange(histogram_, nullptr)->Observe(MonotonicNow() - start_);
    }
  }

 private:
  DurationHistogram* histogram_;
  const MonotonicTime start_;
};

// Goes up and down. Thread-safe.
class Gauge {
 public:
  void Add(std::int64_t amount) { value_.fetch_add(amount, std::memory_order_relaxed); }
  [[nodiscard]] std::int64_t value() const { return value_.load(std::memory_order_relaxed); }

 private:
  std::atomic<std::int64_t> value_{0};
};

// An amount that counts in a gauge while it lives. Thread-safe, but for its end.
class GaugeShare {
 public:
  // `gauge` outlives the share.
  explicit GaugeShare(Gauge* gauge) : gauge_(gauge) {}
  ~GaugeShare() { Set(0); }
  GaugeShare(const GaugeShare&) = delete;
  GaugeShare& operator=(const GaugeShare&) = delete;

  void Set(std::int64_t amount) { gauge_->Add(amount - amount_.exchange(amount)); }
  void Add(std::int64_t amount) {
    amount_.fetch_add(amount);
    gauge_->Add(amount);
  }

 private:
  Gauge* const gauge_;
  std::atomic<std::int64_t> amount_{0};
};

using MetricLabels = std::vector<std::pair<std::string, std::string>>;

// One value, or one histogram, of a metric.
struct MetricSample {
  static MetricSample Of(double value, MetricLabels labels = {});
  static MetricSample Of(const Counter& counter, MetricLabels labels = {});
  static MetricSample Of(const DurationHistogram& histogram, MetricLabels labels = {});

  MetricLabels labels;
  double value = 0;  // histograms: the sum, in seconds
  // Histograms only: the counts of observations up to each of kBounds, then of all.
  std::vector<std::int64_t> cumulative_counts;
};

struct MetricFamily {
  enum class Type { kCounter, kGauge, kHistogram };

  std::string name;
  std::string help;  // one sentence
  Type type = Type::kGauge;
  std::vector<MetricSample> samples;  // of different labels
};

// Returns what a scrape sees. Thread-safe.
using CollectMetrics = std::function<std::vector<MetricFamily>()>;

// Counts by a name that others choose, such as a token's, and by outcome. The first `max_names`
// names have series of their own, all later ones share kOtherName: the number of series is bounded.
// Thread-safe.
class CountersByName {
 public:
  static constexpr char kOtherName[] = "(other)";

  // label:    of the names
  // outcomes: the values of the label "outcome"
  CountersByName(std::string label, std::vector<std::string> outcomes, std::size_t max_names);

  // outcome: index in the list.
  void Add(absl::string_view name, std::size_t outcome) ABSL_LOCKS_EXCLUDED(mutex_);
  // Those of kOtherName come last, and are always there.
  [[nodiscard]] std::vector<MetricSample> Samples() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  const std::string label_;
  const std::vector<std::string> outcomes_;
  const std::size_t max_names_;
  mutable Mutex mutex_;
  std::map<std::string, std::vector<std::int64_t>, std::less<>> counts_ ABSL_GUARDED_BY(mutex_);
  std::vector<std::int64_t> other_ ABSL_GUARDED_BY(mutex_);
};

// Counts the requests of a server by method and status code, with their durations. Thread-safe.
class RequestMetrics {
 public:
  explicit RequestMetrics(std::vector<std::string> methods)
      : methods_(std::move(methods)), method_metrics_(methods_.size()) {}

  // `method`: index in the list.
  void Count(std::size_t method, absl::StatusCode code, absl::Duration duration);

  // The samples of a counter with the labels method and code, and of a histogram by method. Each
  // method has at least a sample for OK.
  [[nodiscard]] std::vector<MetricSample> Counts() const;
  [[nodiscard]] std::vector<MetricSample> Durations() const;

 private:
  static constexpr std::size_t kCodeCount = 17;  // those of gRPC
  struct MethodMetrics {
    std::array<Counter, kCodeCount> by_code;
    DurationHistogram duration;
  };

  const std::vector<std::string> methods_;
  std::deque<MethodMetrics> method_metrics_;
};

// The metrics that every program has: version, start time and memory.
std::vector<MetricFamily> ProcessMetrics(absl::string_view program,
                                         std::int64_t memory_limit_bytes);

}  // namespace isoscope::base

#endif  // ISOSCOPE_CORE_BASE_METRICS_H_
