#include "core/rpc/metrics_server.h"

#include <cstddef>
#include <cstdint>
#include <exception>
#include <limits>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include <prometheus/collectable.h>
#include <prometheus/exposer.h>
#include <prometheus/metric_family.h>

#include "core/base/log.h"
#include "core/base/status_macros.h"

namespace isoscope::rpc {
namespace {

prometheus::MetricType TypeOf(base::MetricFamily::Type type) {
  switch (type) {
    case base::MetricFamily::Type::kCounter:
      return prometheus::MetricType::Counter;
    case base::MetricFamily::Type::kGauge:
      return prometheus::MetricType::Gauge;
    case base::MetricFamily::Type::kHistogram:
      return prometheus::MetricType::Histogram;
  }
  return prometheus::MetricType::Untyped;
}

prometheus::ClientMetric::Histogram HistogramOf(const base::MetricSample& sample) {
  prometheus::ClientMetric::Histogram histogram;
  const std::vector<std::int64_t>& counts = sample.cumulative_counts;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const bool is_last = i >= base::DurationHistogram::kBounds.size();
    histogram.bucket.push_back({.cumulative_count = static_cast<std::uint64_t>(counts[i]),
                                .upper_bound = is_last ? std::numeric_limits<double>::infinity()
                                                       : base::DurationHistogram::kBounds[i]});
  }
  histogram.sample_count = counts.empty() ? 0 : static_cast<std::uint64_t>(counts.back());
  histogram.sample_sum = sample.value;
  return histogram;
}

prometheus::MetricFamily FamilyOf(const base::MetricFamily& family) {
  prometheus::MetricFamily out;
  out.name = family.name;
  out.help = family.help;
  out.type = TypeOf(family.type);
  for (const base::MetricSample& sample : family.samples) {
    prometheus::ClientMetric metric;
    for (const auto& [name, value] : sample.labels) {
      metric.label.push_back({name, value});
    }
    switch (family.type) {
      case base::MetricFamily::Type::kCounter:
        metric.counter.value = sample.value;
        break;
      case base::MetricFamily::Type::kGauge:
        metric.gauge.value = sample.value;
        break;
      case base::MetricFamily::Type::kHistogram:
        metric.histogram = HistogramOf(sample);
        break;
    }
    out.metric.push_back(std::move(metric));
  }
  return out;
}

class Source final : public prometheus::Collectable {
 public:
  explicit Source(base::CollectMetrics collect) : collect_(std::move(collect)) {}

  [[nodiscard]] std::vector<prometheus::MetricFamily> Collect() const override {
    std::vector<prometheus::MetricFamily> families;
    for (const base::MetricFamily& family : collect_()) {
      families.push_back(FamilyOf(family));
    }
    return families;
  }

 private:
  const base::CollectMetrics collect_;
};

constexpr std::size_t kThreads = 2;

struct Endpoint {
  std::string host;
  int port = 0;
};

absl::StatusOr<Endpoint> ParseListen(absl::string_view listen) {
  const absl::string_view::size_type colon = listen.rfind(':');
  const absl::string_view port =
      colon == absl::string_view::npos ? listen : listen.substr(colon + 1);
  Endpoint endpoint;
  endpoint.host = std::string(colon == absl::string_view::npos ? "" : listen.substr(0, colon));
  if (endpoint.host.empty() || endpoint.host == "localhost") {
    endpoint.host = "127.0.0.1";
  }
  constexpr int kMaxPort = 65535;
  if (port.empty() || !absl::SimpleAtoi(port, &endpoint.port) || endpoint.port < 0 ||
      endpoint.port > kMaxPort || absl::StrContains(endpoint.host, ',')) {
    return absl::InvalidArgumentError(
        absl::StrCat("--metrics-listen is '", listen,
                     "': must be HOST:PORT, such as 0.0.0.0:9464, or a port alone, on 127.0.0.1"));
  }
  return endpoint;
}

}  // namespace

// The exposer throws if it can't bind.
MetricsServer::MetricsServer(const std::string& host, int port, base::CollectMetrics collect)
    : source_(std::make_shared<Source>(std::move(collect))),
      exposer_(std::make_unique<prometheus::Exposer>(absl::StrCat(host, ":", port), kThreads)),
      address_(absl::StrCat(host, ":", this->port())) {
  exposer_->RegisterCollectable(source_);
}
MetricsServer::~MetricsServer() = default;

int MetricsServer::port() const { return exposer_->GetListeningPorts().front(); }

absl::StatusOr<std::unique_ptr<MetricsServer>> MetricsServer::Start(absl::string_view listen,
                                                                    base::CollectMetrics collect) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Endpoint endpoint, ParseListen(listen));
  try {
    return std::unique_ptr<MetricsServer>(
        new MetricsServer(endpoint.host, endpoint.port, std::move(collect)));
  } catch (const std::exception&) {  // it tells no reason
    return absl::UnavailableError(absl::StrCat(
        "can't serve metrics at ", endpoint.host, ":", endpoint.port,
        ": the port is taken, or the host is no address of this machine; it must be a number "
        "(--metrics-listen)"));
  }
}

absl::StatusOr<std::shared_ptr<MetricsServer>> MetricsServer::StartIfAsked(
    absl::string_view listen, base::CollectMetrics collect) {
  if (listen.empty()) {
    return std::shared_ptr<MetricsServer>();
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<MetricsServer> server,
                            Start(listen, std::move(collect)));
  base::LogInfo("metrics_started", {{"address", server->address()}});
  return server;
}

}  // namespace isoscope::rpc
