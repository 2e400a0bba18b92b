// The connections of clients: their limit, and their end.

#ifndef ISOSCOPE_WEB_GATEWAY_CONNECTIONS_H_
#define ISOSCOPE_WEB_GATEWAY_CONNECTIONS_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>

#include "absl/base/thread_annotations.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::gateway {

// Thread-safe. Outlives its leases.
class Connections {
 public:
  // Asks a connection to end: after the answer in work, or at once. Must not block.
  using Closer = std::function<void(bool at_once)>;

  // A place among the connections; the destructor gives it back. Thread-safe.
  class Lease {
   public:
    Lease(Connections* connections, std::int64_t id) : connections_(connections), id_(id) {}
    ~Lease() { connections_->Remove(id_); }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;

    // Replaces the closer. Calls it at once if all connections are being closed.
    void SetCloser(Closer closer) { connections_->SetCloser(id_, std::move(closer)); }

   private:
    Connections* const connections_;
    const std::int64_t id_;
  };

  explicit Connections(int max_count) : max_count_(max_count) {}

  // Takes a place; null if there is none, or all are being closed.
  std::shared_ptr<Lease> TryAdd();
  // Calls every closer, and those that are set later.
  void Close(bool at_once);
  // Returns true from Close on.
  [[nodiscard]] bool is_closing();
  // Waits until there are no connections; false if `deadline` passes before.
  bool AwaitNone(base::MonotonicTime deadline);
  [[nodiscard]] int count();

 private:
  void Remove(std::int64_t id) ABSL_LOCKS_EXCLUDED(mutex_);
  void SetCloser(std::int64_t id, Closer closer) ABSL_LOCKS_EXCLUDED(mutex_);

  const int max_count_;
  base::Mutex mutex_;
  base::CondVar removed_;
  std::int64_t next_id_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_closing_ ABSL_GUARDED_BY(mutex_) = false;
  bool is_closing_at_once_ ABSL_GUARDED_BY(mutex_) = false;
  std::map<std::int64_t, Closer> closers_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::gateway

#endif  // ISOSCOPE_WEB_GATEWAY_CONNECTIONS_H_
