// Decides which frame is drawn next, and which one is refused. No threads, no clock of its own:
// every event brings its time.
//
// Clients stand in one queue. The first one has a frame taken, and goes to the end of the queue if
// it has more. So a client with a hundred frames waits as long as one with a single frame.
//
// When all places are taken, the client with the most waiting frames loses its newest one to a
// client with at least two fewer. A refused client without waiting frames keeps its place in the
// queue. If it retries within twice the delay that it was told, it replaces a client that came to
// the queue after it. Thus no client starves, and refused clients are served in the order of their
// first requests.

#ifndef ISOSCOPE_SERVER_ADMISSION_ADMISSION_QUEUE_H_
#define ISOSCOPE_SERVER_ADMISSION_ADMISSION_QUEUE_H_

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "absl/container/flat_hash_map.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"

namespace isoscope::server {

struct AdmissionLimits {
  int max_working = 4;   // frames in work at a time, >= 1
  int max_waiting = 32;  // frames that wait besides, >= 0
};

// Thread-compatible. Times never go back.
class AdmissionQueue {
 public:
  using Ticket = std::int64_t;  // of a frame that has a place; > 0

  // Bounds of the retry delays.
  static constexpr absl::Duration kMinRetryDelay = absl::Milliseconds(10);
  static constexpr absl::Duration kMaxRetryDelay = absl::Minutes(1);
  // A frame's duration as long as none has ended.
  static constexpr absl::Duration kGuessedDuration = absl::Milliseconds(100);
  // If more clients than this were refused, the oldest lose their places in the queue.
  static constexpr std::size_t kMaxOutside = 1024;

  explicit AdmissionQueue(const AdmissionLimits& limits) : limits_(limits) {}

  struct Answer {
    std::optional<Ticket> ticket;   // none: refused
    std::optional<Ticket> evicted;  // a frame that waited and now has no place
    absl::Duration retry_delay;     // for the client that is refused or evicted
  };
  // Gives a frame of `client` a place if one is free. `client` may be any text.
  Answer Admit(const std::string& client, base::MonotonicTime now);
  // Lets a frame wait for its turn, at most until `deadline`. REQUIRES: it has a place, and does
  // not wait yet.
  void Join(Ticket ticket, base::MonotonicTime deadline);
  // Removes the frame whose turn it is from the queue, to work on it; none if none waits.
  std::optional<Ticket> TakeNext(base::MonotonicTime now);
  // Removes a waiting frame from the queue, with its place. Returns false if it does not wait.
  bool Leave(Ticket ticket);
  // Removes all waiting frames whose deadline has passed, and returns them.
  std::vector<Ticket> Expire(base::MonotonicTime now);
  // Returns the place of a frame, if it still has one.
  void End(Ticket ticket, base::MonotonicTime now);

  // The first deadline of the waiting frames; infinite future if none waits.
  [[nodiscard]] base::MonotonicTime next_deadline() const {
    return deadlines_.empty() ? base::MonotonicTime::InfiniteFuture() : deadlines_.begin()->first;
  }
  [[nodiscard]] int working_count() const { return working_count_; }
  [[nodiscard]] int waiting_count() const { return static_cast<int>(deadlines_.size()); }
  // Number of clients with frames that wait.
  [[nodiscard]] int waiting_client_count() const { return static_cast<int>(clients_.size()); }
  // Number of clients that were refused, have no waiting frame, and are expected to retry.
  [[nodiscard]] int outside_count() const { return static_cast<int>(outside_.size()); }

 private:
  using Turn = std::uint64_t;  // place in the queue

  enum class State { kAdmitted, kWaiting, kWorking };
  struct Frame {
    std::string client;
    Turn turn = 0;  // of its client, when the frame was admitted
    State state = State::kAdmitted;
    base::MonotonicTime deadline = {};
    base::MonotonicTime begin = {};  // of its work
  };
  struct Client {
    Turn turn = 0;
    std::deque<Ticket> waiting = {};  // never empty
  };
  struct Refused {
    Turn turn = 0;
    base::MonotonicTime forgotten;  // when its place in the queue expires
  };

  // Removes a waiting frame from its client and from the queue.
  void RemoveWaiting(Ticket ticket, const Frame& frame);
  // The client that loses a frame to `client`, or end().
  std::map<std::string, Client>::iterator FindLoser(const std::string& client, bool was_refused,
                                                    Turn turn);
  // Mean time between the starts of two frames.
  [[nodiscard]] absl::Duration Interval() const;
  // Returns the retry delay of a refused client, and keeps its place in the queue.
  absl::Duration Refuse(const std::string& client, Turn turn, base::MonotonicTime now);

  const AdmissionLimits limits_;
  Ticket next_ticket_ = 1;
  Turn next_turn_ = 1;
  int working_count_ = 0;
  std::optional<absl::Duration> mean_duration_;  // of work, of the last frames
  absl::flat_hash_map<Ticket, Frame> frames_;    // that have a place
  std::map<std::string, Client> clients_;
  std::map<Turn, std::string> line_;  // of the clients
  std::set<std::pair<base::MonotonicTime, Ticket>> deadlines_;
  std::map<std::string, Refused> outside_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_ADMISSION_QUEUE_H_
