#include "web-gateway/known_tokens.h"

#include <algorithm>

#include "core/base/sha256.h"

namespace isoscope::gateway {

void KnownTokens::Learn(const std::string& token, base::MonotonicTime now) {
  const std::string digest = base::Sha256Hex(token);
  const base::MutexLock lock(&mutex_);
  accepted_[digest] = now;
  if (accepted_.size() > kMaxCount) {
    accepted_.erase(std::min_element(
        accepted_.begin(), accepted_.end(),
        [](const auto& left, const auto& right) { return left.second < right.second; }));
  }
}

bool KnownTokens::Knows(const std::string& token, base::MonotonicTime now) {
  if (token.empty()) {
    return false;
  }
  const std::string digest = base::Sha256Hex(token);
  const base::MutexLock lock(&mutex_);
  const auto found = accepted_.find(digest);
  return found != accepted_.end() && now - found->second < kMaxAge;
}

}  // namespace isoscope::gateway
