#include "web-gateway/api/mesh_budget.h"

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

#include "core/base/retry_delay.h"

namespace isoscope::gateway {
namespace {

// They take seconds.
constexpr absl::Duration kRetryDelay = absl::Seconds(2);

absl::Status Refuse(const std::string& message) {
  return base::WithRetryDelay(absl::ResourceExhaustedError(message), kRetryDelay);
}

}  // namespace

absl::Status MeshBudget::Lease::SetBytes(std::int64_t bytes) {
  if (!budget_->TryTake(bytes - bytes_)) {
    return Refuse(absl::StrCat("the meshes and films in work fill the gateway's disk space, ",
                               budget_->max_bytes_, " bytes (--max-mesh-bytes): ask again later"));
  }
  bytes_ = bytes;
  return absl::OkStatus();
}

absl::StatusOr<std::shared_ptr<MeshBudget::Lease>> MeshBudget::Begin(const std::string& caller) {
  {
    const base::MutexLock lock(&mutex_);
    int& count = counts_[caller];  // above 0 if the caller is refused
    if (count >= max_per_caller_) {
      return Refuse(absl::StrCat(count,
                                 " meshes and films of this caller are in work, which is the "
                                 "gateway's limit (--max-caller-meshes): ask again later"));
    }
    ++count;
  }
  return std::make_shared<Lease>(this, caller);
}

bool MeshBudget::TryTake(std::int64_t more) {
  const base::MutexLock lock(&mutex_);
  if (more > 0 && bytes_ + more > max_bytes_) {
    return false;
  }
  bytes_ += more;
  return true;
}

void MeshBudget::End(const std::string& caller, std::int64_t bytes) {
  const base::MutexLock lock(&mutex_);
  bytes_ -= bytes;
  const auto found = counts_.find(caller);
  if (--found->second == 0) {
    counts_.erase(found);
  }
}

}  // namespace isoscope::gateway
