// The frames that an agent finishes before it stops. Between two calls of a frame, such as its
// bands, the agent has nothing to do for it, however long the others draw.

#ifndef ISOSCOPE_PARTITION_AGENT_BEGUN_FRAMES_H_
#define ISOSCOPE_PARTITION_AGENT_BEGUN_FRAMES_H_

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::agent {

// Knows a frame by the id of its request and its number in the coordinator; a question by the id
// alone. Each is begun while a call of it is in work, and for some time after. Once the agent stops,
// only calls of what has begun are let in. Thread-safe; outlives its calls.
class BegunFrames {
 public:
  // A call that does not say that others follow may still have some: questions at the points of a
  // pick, a drawing with smaller bands after an agent had no room.
  static constexpr absl::Duration kAfterLastCall = absl::Seconds(1);
  // A call that was said to follow begins within this time: others may draw their parts as long. It
  // never comes if the coordinator dies, which then does not say so. `docker stop` waits 10 s.
  static constexpr absl::Duration kBetweenCalls = absl::Seconds(5);
  // Those between calls beyond it are forgotten, the one that ends first before others.
  static constexpr std::size_t kMaxEntries = 1024;

  // A call in work. Thread-compatible.
  class Call {
   public:
    Call() = default;
    ~Call() { End(); }
    Call(Call&& other) noexcept { *this = std::move(other); }
    Call& operator=(Call&& other) noexcept;
    Call(const Call&) = delete;
    Call& operator=(const Call&) = delete;

    // Says that others follow, at the latest at `deadline`. Default: none; a question knows nothing of
    // that.
    void ExpectOthersUntil(base::MonotonicTime deadline) { others_until_ = deadline; }

   private:
    friend class BegunFrames;
    using Key = std::pair<std::string, std::int64_t>;
    Call(BegunFrames* frames, Key key, bool is_question)
        : frames_(frames), key_(std::move(key)), is_question_(is_question) {}
    void End();

    BegunFrames* frames_ = nullptr;
    Key key_;
    bool is_question_ = false;
    base::MonotonicTime others_until_ = base::MonotonicTime::InfinitePast();
  };

  // after_last_call: kAfterLastCall but in tests
  explicit BegunFrames(absl::Duration after_last_call = kAfterLastCall)
      : after_last_call_(after_last_call) {}

  // All return UNAVAILABLE if the agent stops and what they ask for has not begun. A number is at
  // least 0.
  absl::StatusOr<Call> BeginFrame(const std::string& request_id, std::int64_t frame_number)
      ABSL_LOCKS_EXCLUDED(mutex_);
  absl::StatusOr<Call> BeginQuestion(const std::string& request_id) ABSL_LOCKS_EXCLUDED(mutex_);
  // No other call of the frame follows, whatever its calls have said: one that still is in work is the
  // last.
  void EndFrame(const std::string& request_id, std::int64_t frame_number)
      ABSL_LOCKS_EXCLUDED(mutex_);
  [[nodiscard]] absl::Status CheckNotStopping() const ABSL_LOCKS_EXCLUDED(mutex_);

  // Lets in nothing new from now on. Returns the number of requests that go on.
  std::size_t Stop() ABSL_LOCKS_EXCLUDED(mutex_);
  // Waits until all that has begun has ended, at most until `deadline`.
  void AwaitEnd(base::MonotonicTime deadline) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  using Key = Call::Key;
  struct Entry {
    int call_count = 0;      // in work
    bool has_ended = false;  // EndFrame was called, and no call has begun since
    // If no call is in work. The last call of a frame says when.
    base::MonotonicTime end = base::MonotonicTime::InfinitePast();
  };
  using Entries = std::map<Key, Entry>;

  Call Begin(Key key, bool is_question) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  void EndCall(const Call& call) ABSL_LOCKS_EXCLUDED(mutex_);
  void Forget(base::MonotonicTime now) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  // Returns the next end of an entry between calls; infinite: there is none.
  [[nodiscard]] base::MonotonicTime NextEnd() const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const absl::Duration after_last_call_;
  mutable base::Mutex mutex_;
  base::CondVar changed_;
  Entries entries_ ABSL_GUARDED_BY(mutex_);
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_BEGUN_FRAMES_H_
