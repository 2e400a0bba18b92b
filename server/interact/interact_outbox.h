// The answers of an interactive stream that wait for their client. No gRPC, no threads, no clock of
// its own. Tells the schedule the end of each answer.
//
// One answer is written at a time. At most one frame, one error and one deferral wait, because a newer
// one replaces a waiting one of its kind. Tiles replace nothing, and wait one at a time: the schedule
// begins none while one waits. So a slow client holds one message in the network and few here.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACT_OUTBOX_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACT_OUTBOX_H_

#include <cstdint>
#include <list>
#include <optional>

#include "absl/container/flat_hash_set.h"
#include "absl/status/status.h"

#include "core/base/memory_budget.h"
#include "core/base/monotonic_time.h"
#include "isoscope/v1/interact_service.pb.h"
#include "server/interact/interactive_schedule.h"

namespace isoscope::server {

// A frame, a tile, an error, or a deferral of the exact frame.
struct InteractAnswer {
  isoscope::v1::InteractResponse message = {};
  bool is_of_exact_work = false;
  bool is_part = false;  // of an exact frame that comes in parts
  // Memory of the message and of gRPC's copy, until it is written: slow clients together must not
  // exceed the coordinator's memory.
  std::optional<base::MemoryBudget::Reservation> memory = std::nullopt;

  // Replaces the frame by the error.
  void SetError(const absl::Status& status);
};

// Thread-compatible. Times never go back.
class InteractOutbox {
 public:
  // `schedule` outlives the outbox.
  explicit InteractOutbox(InteractiveSchedule* schedule) : schedule_(*schedule) {}

  // Queues an answer. Drops a frame that is older than one before it, and every answer after Close.
  void Push(InteractAnswer answer, base::MonotonicTime now);
  // Begins the write of the next answer, and sets its frame_number. The result is valid until
  // EndWrite. Null: a write is under way, or no answer waits.
  const isoscope::v1::InteractResponse* BeginWrite(base::MonotonicTime now);
  void EndWrite();
  // Drops what waits of an exact frame that comes in parts: another picture is wanted.
  void DropParts();
  // Drops the waiting answers. From now on nothing is written.
  void Close();

  // Returns true if a sent frame is a moving one, and was not shown.
  [[nodiscard]] bool IsUnshownMoving(std::int64_t frame_number) const {
    return moving_.contains(frame_number);
  }
  // Records that the client has shown a frame. Returns IsUnshownMoving as it was before.
  bool NoteShown(std::int64_t frame_number) { return moving_.erase(frame_number) > 0; }

  [[nodiscard]] bool is_writing() const { return is_writing_; }
  [[nodiscard]] std::int64_t sent_count() const { return sent_count_; }

 private:
  InteractiveSchedule& schedule_;
  std::list<InteractAnswer> waiting_;
  InteractAnswer in_flight_;
  bool is_writing_ = false;
  bool is_closed_ = false;
  std::int64_t sent_count_ = 0;       // the number of the last answer that was sent
  std::int64_t newest_sequence_ = 0;  // of the frames so far
  absl::flat_hash_set<std::int64_t> moving_;
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACT_OUTBOX_H_
