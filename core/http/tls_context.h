// The certificate that browsers see. Before a connection is accepted, at most once a second, its
// files are checked, and read again when they have changed.

#ifndef ISOSCOPE_CORE_HTTP_TLS_CONTEXT_H_
#define ISOSCOPE_CORE_HTTP_TLS_CONTEXT_H_

#include <memory>
#include <string>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"

namespace boost::asio::ssl {
class context;
}  // namespace boost::asio::ssl

namespace isoscope::http {

// Thread-compatible.
class TlsContext {
 public:
  static constexpr absl::Duration kReloadInterval = absl::Seconds(1);

  // Loads a chain and its key, PEM. INVALID_ARGUMENT if they can't be used.
  static absl::StatusOr<std::unique_ptr<TlsContext>> Make(const std::string& certificate_file,
                                                          const std::string& key_file);

  // Returns the context for the next connection. Unusable files are logged, and the last good ones
  // stay.
  std::shared_ptr<boost::asio::ssl::context> Get(base::MonotonicTime now);

 private:
  TlsContext(std::string certificate_file, std::string key_file)
      : certificate_file_(std::move(certificate_file)), key_file_(std::move(key_file)) {}
  // Returns a key of the state of both files: it changes when one is replaced or written.
  [[nodiscard]] std::string StateOfFiles() const;
  absl::Status Load();

  const std::string certificate_file_;
  const std::string key_file_;
  std::shared_ptr<boost::asio::ssl::context> context_;
  std::string state_;
  base::MonotonicTime looked_;
};

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_TLS_CONTEXT_H_
