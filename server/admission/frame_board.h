// The frames that a coordinator has in work, for operators: GetClusterStatus, `isoscope top`.

#ifndef ISOSCOPE_SERVER_ADMISSION_FRAME_BOARD_H_
#define ISOSCOPE_SERVER_ADMISSION_FRAME_BOARD_H_

#include <atomic>
#include <list>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/monotonic_time.h"
#include "core/base/mutex.h"
#include "core/base/printable.h"

namespace isoscope::server {

enum class FramePhase {
  kQueued,
  kPreparing,
  kOccluderSelection,
  kOccluderRendering,
  kVisibilityCulling,
  kFinishing,
};

struct FrameNote {
  std::string request_id;
  base::ForeignText client = {};   // as gRPC names it
  base::ForeignText dataset = {};  // as the request names it
  int width_px = 0;
  int height_px = 0;
  base::MonotonicTime arrival;
};

// Thread-safe. Outlives its entries.
class FrameBoard {
 private:
  struct Line {
    FrameNote note;
    std::atomic<FramePhase> phase{FramePhase::kQueued};
  };

 public:
  // A frame on the board, until it is destroyed. Its phase may be set by any thread.
  class Entry {
   public:
    Entry(Entry&& other) noexcept
        : board_(std::exchange(other.board_, nullptr)), line_(other.line_) {}
    Entry& operator=(Entry&&) = delete;
    ~Entry() {
      if (board_ != nullptr) {
        board_->Remove(line_);
      }
    }

    [[nodiscard]] std::atomic<FramePhase>* phase() const { return &line_->phase; }

   private:
    friend class FrameBoard;
    Entry(FrameBoard* board, std::list<Line>::iterator line) : board_(board), line_(line) {}

    FrameBoard* board_;
    std::list<Line>::iterator line_;
  };

  FrameBoard() = default;
  FrameBoard(const FrameBoard&) = delete;
  FrameBoard& operator=(const FrameBoard&) = delete;

  Entry Add(FrameNote note) ABSL_LOCKS_EXCLUDED(mutex_);

  struct Frame {
    FrameNote note;
    FramePhase phase = FramePhase::kQueued;
  };
  // In the order of their arrival.
  [[nodiscard]] std::vector<Frame> Frames() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  void Remove(std::list<Line>::iterator line) ABSL_LOCKS_EXCLUDED(mutex_);

  mutable base::Mutex mutex_;
  std::list<Line> lines_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_ADMISSION_FRAME_BOARD_H_
