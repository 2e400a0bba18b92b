// Serves a program's metrics to Prometheus: GET /metrics over HTTP, in Prometheus' text format. A
// scrape reads atomics and asks the program for gauges; it holds no lock for longer than that, so
// no frame waits for it.
//
// The HTTP server (civetweb, in prometheus-cpp) has no TLS and no authentication, so it listens on
// loopback unless another host is given.

#ifndef ISOSCOPE_CORE_RPC_METRICS_SERVER_H_
#define ISOSCOPE_CORE_RPC_METRICS_SERVER_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/metrics.h"

namespace prometheus {  // NOLINT(readability-identifier-naming): theirs
class Collectable;
class Exposer;
}  // namespace prometheus

namespace isoscope::rpc {

// Thread-safe.
class MetricsServer {
 public:
  // listen: "HOST:PORT", ":PORT" or "PORT"; without a host 127.0.0.1. HOST is an address of this
  // machine, as a number, or localhost; PORT 0 takes a free one. INVALID_ARGUMENT: malformed.
  // UNAVAILABLE: can't be bound. `collect` must work until the server is destroyed.
  static absl::StatusOr<std::unique_ptr<MetricsServer>> Start(absl::string_view listen,
                                                              base::CollectMetrics collect);
  // The same, and logs the address; null if `listen` is empty.
  static absl::StatusOr<std::shared_ptr<MetricsServer>> StartIfAsked(absl::string_view listen,
                                                                     base::CollectMetrics collect);
  // Waits for scrapes in work.
  ~MetricsServer();

  [[nodiscard]] int port() const;
  // "HOST:PORT" that it is bound to.
  [[nodiscard]] const std::string& address() const { return address_; }

 private:
  MetricsServer(const std::string& host, int port, base::CollectMetrics collect);

  const std::shared_ptr<prometheus::Collectable> source_;
  const std::unique_ptr<prometheus::Exposer> exposer_;
  const std::string address_;
};

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_CORE_RPC_METRICS_SERVER_H_
