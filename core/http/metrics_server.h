// Serves a program's metrics to Prometheus: GET /metrics over HTTP, in Prometheus' text format. A
// scrape reads atomics and asks the program for gauges; it holds no lock for longer than that, so
// no frame waits for it.
//
// There is no TLS and no authentication, so it listens on loopback unless another host is given.
// Connections without a request make room for others (connections.h).

#ifndef ISOSCOPE_CORE_HTTP_METRICS_SERVER_H_
#define ISOSCOPE_CORE_HTTP_METRICS_SERVER_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/metrics.h"

namespace isoscope::http {

// Thread-safe.
class MetricsServer {
 public:
  // listen: "HOST:PORT", ":PORT" or "PORT"; without a host 127.0.0.1. HOST is an address of this
  // machine, of IPv6 in brackets, or a name of one; PORT 0 takes a free one. INVALID_ARGUMENT:
  // malformed. UNAVAILABLE: can't be bound. `collect` must work until the server is destroyed.
  static absl::StatusOr<std::unique_ptr<MetricsServer>> Start(absl::string_view listen,
                                                              base::CollectMetrics collect);
  // The same, and logs the address; null if `listen` is empty.
  static absl::StatusOr<std::shared_ptr<MetricsServer>> StartIfAsked(absl::string_view listen,
                                                                     base::CollectMetrics collect);
  // Waits for scrapes in work.
  virtual ~MetricsServer() = default;

  [[nodiscard]] virtual int port() const = 0;
  // "HOST:PORT" that it is bound to.
  [[nodiscard]] virtual const std::string& address() const = 0;
};

// Returns the families in Prometheus' text format, version 0.0.4.
std::string MetricsText(const std::vector<base::MetricFamily>& families);

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_METRICS_SERVER_H_
