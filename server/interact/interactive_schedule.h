// Decides which frames of an interactive stream are drawn, and when. No gRPC, no threads, no clock
// of its own: every event brings its time.

#ifndef ISOSCOPE_SERVER_INTERACT_INTERACTIVE_SCHEDULE_H_
#define ISOSCOPE_SERVER_INTERACT_INTERACTIVE_SCHEDULE_H_

#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "absl/time/time.h"

#include "core/base/monotonic_time.h"

namespace isoscope::server {

// A frame to draw now.
struct FrameStart {
  std::int64_t work = 0;      // number of the work, in order of begin: 1, 2, ...
  std::int64_t sequence = 0;  // sequence of the state that it shows
  bool is_exact = false;
};

// Thread-compatible. Times never go back.
class InteractiveSchedule {
 public:
  // A view rests when no state has come for this long.
  static constexpr absl::Duration kRestDelay = absl::Milliseconds(120);
  // A frame that was sent this long ago counts as shown, so that a stalled client blocks no others.
  static constexpr absl::Duration kShownTimeout = absl::Seconds(2);
  // One frame is drawn at a time, while the one before is encoded. Two drawn at a time would share
  // cores and agents: they come no faster, and each shows an older state.
  static constexpr int kMaxInWork = 2;
  static constexpr int kMinCredits = 2;
  static constexpr int kMaxCredits = 8;
  // The most exact frames that were sent and not shown. They have their own credits, so that moving
  // frames on their way delay none.
  static constexpr int kExactCredits = 2;
  // The same of a view that refines, whose exact frame comes in parts.
  static constexpr int kPartCredits = 4;
  // After an error nothing begins for this long, so a client of wrong states gets only some errors.
  static constexpr absl::Duration kErrorPause = absl::Milliseconds(100);
  // A moving frame that takes less is not worth cancelling: it would be shown long before the next
  // one is complete.
  static constexpr absl::Duration kWorthCancelling = absl::Milliseconds(100);

  // Sets a new state, which replaces all before it. `refines`: its exact frame comes in parts, each
  // of which is an exact work, and which are cancelled at once by another picture. REQUIRES:
  // `sequence` is greater than every earlier one.
  void OnState(std::int64_t sequence, bool is_at_rest, base::MonotonicTime now,
               bool refines = false);
  // Sets a new state with the picture of the newest one: what was begun for that is begun for this.
  void OnSamePicture(std::int64_t sequence, bool is_at_rest);
  // The exact frame of the newest state needs another work.
  void ContinueExact() { exact_started_ = 0; }
  // The picture of the work is drawn, and is now encoded.
  void OnDrawn(std::int64_t work);
  // The work has ended. If `has_answer`, its answer waits to be sent.
  void OnWorkEnded(std::int64_t work, bool has_answer, base::MonotonicTime now);
  // An answer is an error.
  void OnError(base::MonotonicTime now) { pause_end_ = now + kErrorPause; }
  // An answer was passed to the network, under the number that the client will acknowledge.
  // `is_exact`: it is of an exact work. `is_part`: it is a part, which delays no moving frame.
  void OnSent(std::int64_t frame_number, base::MonotonicTime now, bool is_exact = false,
              bool is_part = false);
  // A waiting answer was replaced by a newer one, and will not be sent.
  void OnDropped(bool is_exact = false);
  // The client has shown a frame. Returns the time since it was sent; none if it was shown before,
  // was sent far too long ago, or was never sent.
  std::optional<absl::Duration> OnShown(std::int64_t frame_number, base::MonotonicTime now);
  // The most frames under way, kMinCredits to kMaxCredits: in work, waiting, or sent and not shown.
  void SetCredits(int credits);

  struct Step {
    std::vector<std::int64_t> cancel;  // works to cancel
    std::optional<FrameStart> start;
    std::vector<std::int64_t> overdue;  // frames that count as shown from now on
    // The time to call Next again if no event comes before. Infinite future: not needed.
    base::MonotonicTime wake = base::MonotonicTime::InfiniteFuture();
  };
  // Decides the next action. Call again after each start, until there is none.
  Step Next(base::MonotonicTime now);

  [[nodiscard]] int under_way_count() const {
    return static_cast<int>(in_work_.size()) + waiting_count_ + static_cast<int>(sent_.size()) -
           sent_part_count_;
  }
  [[nodiscard]] bool is_working() const { return !in_work_.empty(); }

 private:
  struct Sent {
    base::MonotonicTime time;
    bool is_exact = false;
    bool is_part = false;
  };
  struct Work {
    std::int64_t sequence = 0;
    bool is_exact = false;
    bool is_cancelled = false;
    bool is_drawn = false;
    bool is_part = false;  // of an exact frame
    base::MonotonicTime start;
  };

  static constexpr std::size_t kMaxOverdue = 64;

  // Returns the frames that timed out.
  std::vector<std::int64_t> Expire(base::MonotonicTime now);
  // Return true if another frame may be drawn, and if the client has room for an exact one.
  [[nodiscard]] bool MayDraw() const;
  [[nodiscard]] bool MayBeginExact() const;
  // Returns when the oldest frame that was sent counts as shown; infinite future if there is none.
  [[nodiscard]] base::MonotonicTime NextExpiry() const;
  [[nodiscard]] bool MayCancel(const Work& work, base::MonotonicTime now) const;
  FrameStart Begin(bool is_exact, base::MonotonicTime now);

  std::int64_t newest_ = 0;
  base::MonotonicTime newest_time_;
  bool newest_rests_ = false;
  bool newest_refines_ = false;
  std::int64_t moving_started_ = 0;  // newest state whose moving frame was begun
  std::int64_t exact_started_ = 0;   // newest state whose exact frame was begun

  std::int64_t next_work_ = 1;
  std::map<std::int64_t, Work> in_work_;
  bool cancelled_last_ = false;  // the last work that ended had been cancelled
  std::optional<absl::Duration> expected_moving_;
  std::optional<absl::Duration> expected_exact_;

  int credits_ = kMinCredits;
  base::MonotonicTime pause_end_ = base::MonotonicTime::InfinitePast();
  int waiting_count_ = 0;
  int waiting_exact_count_ = 0;           // among the waiting ones
  std::map<std::int64_t, Sent> sent_;     // sent and not shown yet
  int sent_part_count_ = 0;               // among them
  std::map<std::int64_t, Sent> overdue_;  // the last kMaxOverdue that timed out
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_INTERACT_INTERACTIVE_SCHEDULE_H_
