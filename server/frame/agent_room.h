// What agents elsewhere had memory for lately. The coordinator learns their limits from refusals,
// so that not every large frame is refused first.

#ifndef ISOSCOPE_SERVER_FRAME_AGENT_ROOM_H_
#define ISOSCOPE_SERVER_FRAME_AGENT_ROOM_H_

#include <cstddef>
#include <functional>
#include <list>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/time/time.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"

namespace isoscope::server {

// Thread-safe.
class AgentRoom {
 public:
  // Returns the time. Called with the mutex held.
  using Clock = std::function<base::MonotonicTime()>;

  // An agent may be restarted with another limit: then bands grow after this time.
  static constexpr absl::Duration kMaxAge = absl::Minutes(1);
  static constexpr std::size_t kMaxEntries = 64;

  explicit AgentRoom(Clock now = base::MonotonicNow) : now_(std::move(now)) {}

  // Returns the most drawn pixels that the agents of a dataset may have room for, of frames with
  // this number of layers; 0: unknown.
  [[nodiscard]] std::size_t MostPixels(const std::string& dataset_id, int max_layers)
      ABSL_LOCKS_EXCLUDED(mutex_);
  // Agents had no room for twice as many. pixels: at least 1
  void Note(const std::string& dataset_id, int max_layers, std::size_t pixels)
      ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Entry {
    std::string dataset_id;
    int max_layers = 0;
    std::size_t pixels = 0;
    base::MonotonicTime noted;
  };
  void DropOld() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  std::list<Entry>::iterator Find(const std::string& dataset_id, int max_layers)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  const Clock now_;
  base::Mutex mutex_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  // the latest first
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_AGENT_ROOM_H_
