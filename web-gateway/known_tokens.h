// Users' tokens that the coordinator has accepted lately. Their holders' connections find a place
// when strangers fill the gateway (core/http/connections.h). They have no further rights: each
// request passes its token to the coordinator.

#ifndef ISOSCOPE_WEB_GATEWAY_KNOWN_TOKENS_H_
#define ISOSCOPE_WEB_GATEWAY_KNOWN_TOKENS_H_

#include <cstddef>
#include <map>
#include <string>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::gateway {

// Holds digests of at most kMaxCount tokens, the latest. Thread-safe.
class KnownTokens {
 public:
  static constexpr std::size_t kMaxCount = 1024;
  // A token that was not accepted again for this long is not known any more.
  static constexpr absl::Duration kMaxAge = absl::Minutes(10);

  // The coordinator has accepted the token now.
  void Learn(const std::string& token) { Learn(token, base::MonotonicNow()); }
  [[nodiscard]] bool Knows(const std::string& token) { return Knows(token, base::MonotonicNow()); }
  void Learn(const std::string& token, base::MonotonicTime now) ABSL_LOCKS_EXCLUDED(mutex_);
  // False for an empty token.
  [[nodiscard]] bool Knows(const std::string& token, base::MonotonicTime now)
      ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  base::Mutex mutex_;
  std::map<std::string, base::MonotonicTime> accepted_ ABSL_GUARDED_BY(mutex_);  // by digest
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_KNOWN_TOKENS_H_
