// The threads that work on frames, and the queue of clients in front of them (admission_queue.h).
//
// A frame leaves the queue at once if its deadline passes, its caller cancels, or it makes room for
// another client's frame. A separate thread ends such frames. So Leave and Admit never run the work
// of another caller.

#ifndef ISOSCOPE_SERVER_ADMISSION_ADMISSION_H_
#define ISOSCOPE_SERVER_ADMISSION_ADMISSION_H_

#include <deque>
#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/container/flat_hash_map.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "server/admission/admission_queue.h"

namespace isoscope::server {

struct AdmissionOptions {
  AdmissionLimits limits;
  // Messages have the noun of the admitted work, and the flags that set the limits (empty: none).
  std::string noun = "frame";
  std::string flags = "--max-concurrent-frames, --max-queued-frames";
};

// Thread-safe. Outlives its places. The destructor ends the frames that wait with UNAVAILABLE, and
// waits for those in work.
class Admission {
 public:
  // Called once: with OK on a frame thread when the turn has come, else with the reason on the
  // thread that ends frames, where it must be short:
  //
  //   DEADLINE_EXCEEDED   the deadline passed in the queue; says the waiting time and the load
  //   CANCELLED           Leave was called
  //   RESOURCE_EXHAUSTED  evicted for another client; has a retry delay (retry_delay.h)
  //   UNAVAILABLE         the coordinator stops
  using Work = std::function<void(const absl::Status& turn)>;
  using Ticket = AdmissionQueue::Ticket;

  explicit Admission(AdmissionOptions options);
  ~Admission();

  Admission(const Admission&) = delete;
  Admission& operator=(const Admission&) = delete;

  // The place of a frame among those in work and those that wait. The destructor returns it.
  class Place {
   public:
    Place(Place&& other) noexcept
        : admission_(std::exchange(other.admission_, nullptr)), ticket_(other.ticket_) {}
    Place& operator=(Place&&) = delete;
    ~Place() {
      if (admission_ != nullptr) {
        admission_->End(ticket_);
      }
    }

    [[nodiscard]] Ticket ticket() const { return ticket_; }

   private:
    friend class Admission;
    Place(Admission* admission, Ticket ticket) : admission_(admission), ticket_(ticket) {}

    Admission* admission_;
    const Ticket ticket_;
  };

  // Takes a place for a frame of `client`. RESOURCE_EXHAUSTED with a retry delay if there is none.
  // Does not block.
  absl::StatusOr<Place> Admit(const std::string& client) ABSL_LOCKS_EXCLUDED(mutex_);
  // Lets the frame wait for its turn. REQUIRES: it has a place; at most once for each.
  void Schedule(Ticket ticket, base::MonotonicTime deadline, Work work) ABSL_LOCKS_EXCLUDED(mutex_);
  // Ends a frame that waits; no effect on others. Does not block, and runs no work.
  void Leave(Ticket ticket) ABSL_LOCKS_EXCLUDED(mutex_);

  struct Counts {
    int working = 0;
    int waiting = 0;
    int waiting_clients = 0;
    int outside_clients = 0;  // refused, and expected to retry
  };
  [[nodiscard]] Counts counts() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Waiting {
    Work work;
    base::MonotonicTime arrival;
  };
  struct Ended {
    Work work;
    absl::Status status;
  };

  void End(Ticket ticket) ABSL_LOCKS_EXCLUDED(mutex_);
  void RunFrames() ABSL_LOCKS_EXCLUDED(mutex_);
  void RunEndings() ABSL_LOCKS_EXCLUDED(mutex_);
  // Queues the work of a frame that left the queue for the thread that ends frames.
  void EndWith(Ticket ticket, absl::Status status) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void ExpireFrames() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // "4 frames are in work and 32 wait, of 9 clients (limits: 4 and 32, --max-...)".
  [[nodiscard]] std::string Describe() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const AdmissionOptions options_;
  mutable base::Mutex mutex_;
  base::CondVar joined_;  // a frame waits for a thread, or all stops
  base::CondVar ending_;  // a frame is to be ended, there is an earlier deadline, or all stops
  AdmissionQueue queue_ ABSL_GUARDED_BY(mutex_);
  absl::flat_hash_map<Ticket, Waiting> waiting_ ABSL_GUARDED_BY(mutex_);
  std::deque<Ended> ended_ ABSL_GUARDED_BY(mutex_);
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  bool is_last_ended_ ABSL_GUARDED_BY(mutex_) = false;  // no frame thread is left
  std::vector<std::thread> frame_threads_;
  std::thread ending_thread_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_ADMISSION_H_
