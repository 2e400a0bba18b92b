// Decides which frame is drawn next, and which one is refused. No threads, no clock of its own:
// every event brings its time.
//
// Clients stand in one line. The first one has a frame taken, and goes to the end of the line if it
// has more. So a client with a hundred frames waits among others as one with a single frame does.
//
// When all places are taken, the client with the most waiting frames loses its newest one to a
// client with at least two fewer. A refused client without waiting frames keeps its place in the
// line: when it comes again, in the time that it was told and as long again, it takes the place of
// one that came to the line after it. Thus nobody is refused for ever, however many come, and those
// who wait outside are served in the order in which they first came.

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

namespace isoscope::server {

struct AdmissionLimits {
  int max_working = 4;   // frames in work at a time, >= 1
  int max_waiting = 32;  // beside them, >= 0
};

// Thread-compatible. Times never go back.
class AdmissionQueue {
 public:
  using Ticket = std::int64_t;  // of a frame that has a place; > 0

  // Told times lie between these.
  static constexpr absl::Duration kMinRetryDelay = absl::Milliseconds(10);
  static constexpr absl::Duration kMaxRetryDelay = absl::Minutes(1);
  // A frame's duration as long as none has ended.
  static constexpr absl::Duration kGuessedDuration = absl::Milliseconds(100);
  // More refused clients than this lose their place in the line.
  static constexpr std::size_t kMaxOutside = 1024;

  explicit AdmissionQueue(const AdmissionLimits& limits) : limits_(limits) {}

  struct Answer {
    std::optional<Ticket> ticket;   // none: refused
    std::optional<Ticket> evicted;  // a frame that waited and now has no place
    absl::Duration retry_delay;     // for whoever is refused or evicted
  };
  // Gives a frame of `client` a place, if there is one. `client` may be any text.
  Answer Admit(const std::string& client, absl::Time now);
  // Lets a frame wait for its turn, at most until `deadline`. REQUIRES: it has a place, and does
  // not wait yet.
  void Join(Ticket ticket, absl::Time deadline);
  // Takes the frame whose turn it is out of the line, to work on it; none if none waits.
  std::optional<Ticket> TakeNext(absl::Time now);
  // Takes a waiting frame out of the line, and its place away. Returns false if it does not wait.
  bool Leave(Ticket ticket);
  // Does so to all that wait and whose deadline has passed, and returns them.
  std::vector<Ticket> Expire(absl::Time now);
  // Gives a place back, if the frame still has one.
  void End(Ticket ticket, absl::Time now);

  // The first deadline of those that wait; infinite future if none waits.
  [[nodiscard]] absl::Time next_deadline() const {
    return deadlines_.empty() ? absl::InfiniteFuture() : deadlines_.begin()->first;
  }
  [[nodiscard]] int working_count() const { return working_count_; }
  [[nodiscard]] int waiting_count() const { return static_cast<int>(deadlines_.size()); }
  // Those with frames that wait.
  [[nodiscard]] int waiting_client_count() const { return static_cast<int>(clients_.size()); }
  // Those that were refused, have none that waits, and are expected to come again.
  [[nodiscard]] int outside_count() const { return static_cast<int>(outside_.size()); }

 private:
  using Turn = std::uint64_t;  // place in the line

  enum class State { kAdmitted, kWaiting, kWorking };
  struct Frame {
    std::string client;
    Turn turn = 0;  // of its client, when it was admitted
    State state = State::kAdmitted;
    absl::Time deadline = {};
    absl::Time begin = {};  // of its work
  };
  struct Client {
    Turn turn = 0;
    std::deque<Ticket> waiting = {};  // never empty
  };
  struct Refused {
    Turn turn = 0;
    absl::Time forgotten;  // when its place in the line is lost
  };

  // Removes a frame that waits from its client and from the line.
  void RemoveWaiting(Ticket ticket, const Frame& frame);
  // The client that loses a frame to `client`, or end().
  std::map<std::string, Client>::iterator FindLoser(const std::string& client, bool was_refused,
                                                    Turn turn);
  // The time in which a frame is begun, on average.
  [[nodiscard]] absl::Duration Interval() const;
  // Tells a refused client when to come again, and keeps its place in the line.
  absl::Duration Refuse(const std::string& client, Turn turn, absl::Time now);

  const AdmissionLimits limits_;
  Ticket next_ticket_ = 1;
  Turn next_turn_ = 1;
  int working_count_ = 0;
  std::optional<absl::Duration> mean_duration_;  // of work, of the last frames
  absl::flat_hash_map<Ticket, Frame> frames_;    // that have a place
  std::map<std::string, Client> clients_;
  std::map<Turn, std::string> line_;  // of the clients
  std::set<std::pair<absl::Time, Ticket>> deadlines_;
  std::map<std::string, Refused> outside_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_ADMISSION_QUEUE_H_
