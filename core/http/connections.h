// The connections of a server: their limits, and which of them makes room for another.
//
//   a connection   while                                          counts for
//   waits          TLS begins, a header comes, or none comes      max_count + max_entering
//   works          a request is in work, its answer is on its     max_count; a stranger's also for
//                  way, or it is a WebSocket                      max_strangers and max_of_address
//
// Nobody knows who calls before a header is there. So a new connection always finds a place, as
// long as another one waits: of the address that has most waiting strangers, the one that has
// waited longest is dropped. So whoever opens connections and sends nothing drops his own.
// Connections whose last request was a known caller's are dropped after all strangers. A
// connection that works is not dropped. A request beyond a limit is refused with an answer.

#ifndef ISOSCOPE_CORE_HTTP_CONNECTIONS_H_
#define ISOSCOPE_CORE_HTTP_CONNECTIONS_H_

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "absl/base/thread_annotations.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::http {

struct ConnectionLimits {
  int max_count = 256;      // that work
  int max_entering = 16;    // further ones, which wait, or ask for health; at least 2
  int max_strangers = 192;  // that work, of all callers that are not known
  int max_of_address = 64;  // that work, of strangers with one address
};

// Who asks for what.
enum class Caller {
  kStranger,
  kKnown,   // showed a token that counts
  kHealth,  // asks for health: half of max_entering at a time work besides max_count
};

enum class Placement {
  kTaken,
  kFull,         // max_count are at work, or max_strangers
  kAddressFull,  // max_of_address are at work
  kDropped,      // this connection was dropped before: close it
};

// Thread-safe. Outlives its leases.
class Connections {
 public:
  // Asks a connection to end: after the answer in work, or at once. Must not block.
  using Closer = std::function<void(bool at_once)>;

  // A place among the connections; the destructor gives it back. Waits at first. Thread-safe.
  class Lease {
   public:
    Lease(Connections* connections, std::int64_t id) : connections_(connections), id_(id) {}
    ~Lease() { connections_->Remove(id_); }
    Lease(const Lease&) = delete;
    Lease& operator=(const Lease&) = delete;

    // Replaces the closer. Calls it at once if all connections are being closed, or this one was
    // dropped.
    void SetCloser(Closer closer) { connections_->SetCloser(id_, std::move(closer)); }
    // From waiting to work. `address`: the caller's, PeerKey.
    [[nodiscard]] Placement BeginWork(Caller caller, const std::string& address) {
      return connections_->BeginWork(id_, caller, address);
    }
    // Back to waiting.
    void EndWork() { connections_->EndWork(id_); }

   private:
    Connections* const connections_;
    const std::int64_t id_;
  };

  explicit Connections(const ConnectionLimits& limits) : limits_(limits) {}

  // Takes a place for a connection of `address` (PeerKey), and drops another if need be. Null if no
  // other one waits, or all are being closed.
  std::shared_ptr<Lease> TryAdd(const std::string& address);
  // Calls every closer, and those that are set later.
  void Close(bool at_once);
  // Returns true from Close on.
  [[nodiscard]] bool is_closing();
  // Waits until there are no connections; false if `deadline` passes before.
  bool AwaitNone(base::MonotonicTime deadline);
  [[nodiscard]] int count();
  // Connections that were dropped so far.
  [[nodiscard]] std::int64_t dropped_count();

 private:
  enum class State { kWaiting, kWorking, kDropped };

  struct Connection {
    std::string address;
    Closer closer = nullptr;
    State state = State::kWaiting;
    Caller caller = Caller::kStranger;  // of the request in work, or of the last one
    std::string work_address = {};      // of the caller of the request in work
    std::int64_t since = 0;             // the number of the event that began its state
  };

  void Remove(std::int64_t id) ABSL_LOCKS_EXCLUDED(mutex_);
  void SetCloser(std::int64_t id, Closer closer) ABSL_LOCKS_EXCLUDED(mutex_);
  Placement BeginWork(std::int64_t id, Caller caller, const std::string& address)
      ABSL_LOCKS_EXCLUDED(mutex_);
  void EndWork(std::int64_t id) ABSL_LOCKS_EXCLUDED(mutex_);
  // Returns the connection to drop; null if none waits.
  Connection* FindVictim() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void StopCountingWork(Connection* connection) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const ConnectionLimits limits_;
  base::Mutex mutex_;
  base::CondVar removed_;
  std::int64_t next_id_ ABSL_GUARDED_BY(mutex_) = 0;
  std::int64_t next_event_ ABSL_GUARDED_BY(mutex_) = 0;
  std::int64_t dropped_count_ ABSL_GUARDED_BY(mutex_) = 0;
  bool is_closing_ ABSL_GUARDED_BY(mutex_) = false;
  bool is_closing_at_once_ ABSL_GUARDED_BY(mutex_) = false;
  std::map<std::int64_t, Connection> connections_ ABSL_GUARDED_BY(mutex_);
  int alive_count_ ABSL_GUARDED_BY(mutex_) = 0;    // that were not dropped
  int working_count_ ABSL_GUARDED_BY(mutex_) = 0;  // but for kHealth
  int working_health_ ABSL_GUARDED_BY(mutex_) = 0;
  int working_strangers_ ABSL_GUARDED_BY(mutex_) = 0;
  std::map<std::string, int> strangers_of_address_ ABSL_GUARDED_BY(mutex_);  // that work
};

}  // namespace isoscope::http

#endif  // ISOSCOPE_CORE_HTTP_CONNECTIONS_H_
