#include "core/base/process_setup.h"

#include "absl/synchronization/mutex.h"
#include <oneapi/tbb/info.h>
#include <openssl/crypto.h>

#include "core/base/absl_waits.h"
#include "core/base/log.h"
#include "core/base/memory_info.h"

namespace isoscope::base {

void SetUpProcess() {
  // Debian builds abseil with the detection on, so every lock would take a global one.
  absl::SetMutexDeadlockDetectionMode(absl::OnDeadlockCycle::kIgnore);
  LimitMallocArenas(oneapi::tbb::info::default_concurrency());
  // OpenSSL would free its locks in exit(), while a thread of gRPC may still use them to reconnect.
  // Only the first call in a process can set this.
  OPENSSL_init_crypto(OPENSSL_INIT_NO_ATEXIT, nullptr);
  if (!AreAbslWaitsMonotonic()) {
    LogWarning("waits_by_date",
               {{"note", "when the clock is set back, gRPC's timers stand still"}});
  }
}

}  // namespace isoscope::base
