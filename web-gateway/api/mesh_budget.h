// Bounds the meshes and films that the gateway writes to disk: the number in work of each caller, and
// the bytes of all.

#ifndef ISOSCOPE_WEB_GATEWAY_API_MESH_BUDGET_H_
#define ISOSCOPE_WEB_GATEWAY_API_MESH_BUDGET_H_

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/mutex.h"

namespace isoscope::gateway {

// Thread-safe. Outlives its leases.
class MeshBudget {
 public:
  // A mesh or film in work, from its request until its answer is sent. The destructor returns its share.
  // Thread-compatible.
  class Lease {
   public:
    Lease(MeshBudget* budget, std::string caller) : budget_(budget), caller_(std::move(caller)) {}
    ~Lease() { budget_->End(caller_, bytes_); }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;

    // Sets its present size on disk. RESOURCE_EXHAUSTED with a retry delay if all meshes and films
    // together would exceed the limit; then its size stays as before.
    absl::Status SetBytes(std::int64_t bytes);

   private:
    MeshBudget* const budget_;
    const std::string caller_;
    std::int64_t bytes_ = 0;
  };

  MeshBudget(int max_per_caller, std::int64_t max_bytes)
      : max_per_caller_(max_per_caller), max_bytes_(max_bytes) {}

  // Begins a mesh or a film. RESOURCE_EXHAUSTED with a retry delay if the caller is at its limit.
  absl::StatusOr<std::shared_ptr<Lease>> Begin(const std::string& caller);

 private:
  // Takes `more` bytes; returns false if they exceed the limit.
  bool TryTake(std::int64_t more) ABSL_LOCKS_EXCLUDED(mutex_);
  void End(const std::string& caller, std::int64_t bytes) ABSL_LOCKS_EXCLUDED(mutex_);

  const int max_per_caller_;
  const std::int64_t max_bytes_;
  base::Mutex mutex_;
  std::map<std::string, int> counts_ ABSL_GUARDED_BY(mutex_);  // by caller; > 0
  std::int64_t bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_API_MESH_BUDGET_H_
