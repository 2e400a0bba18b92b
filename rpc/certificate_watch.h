// Monitors the program's own certificate: when it expires, and whether it can be read.

#ifndef ISOSCOPE_RPC_CERTIFICATE_WATCH_H_
#define ISOSCOPE_RPC_CERTIFICATE_WATCH_H_

#include <atomic>
#include <cstdint>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/metrics.h"

namespace isoscope::rpc {

// Returns when the first certificate of a PEM file expires. Errors of reading; INVALID_ARGUMENT.
absl::StatusOr<absl::Time> CertificateExpiry(const std::string& certificate_file);

// Thread-safe.
class CertificateWatch {
 public:
  // Empty: there is none.
  explicit CertificateWatch(std::string certificate_file) : file_(std::move(certificate_file)) {}

  // Days until the certificate expires, as it is in the file now: negative after that, 0 if it
  // can't be read, infinity without a file.
  double DaysLeft();
  // Returns how often DaysLeft began to fail to read the certificate.
  [[nodiscard]] std::int64_t failures() const { return failures_.value(); }

 private:
  const std::string file_;
  std::atomic<bool> is_failing_{false};
  base::Counter failures_;
};

}  // namespace isoscope::rpc

#endif  // ISOSCOPE_RPC_CERTIFICATE_WATCH_H_
