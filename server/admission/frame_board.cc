#include "server/admission/frame_board.h"

#include <iterator>

namespace isoscope::server {

FrameBoard::Entry FrameBoard::Add(FrameNote note) {
  const base::MutexLock lock(&mutex_);
  lines_.emplace_back();
  lines_.back().note = std::move(note);
  return {this, std::prev(lines_.end())};
}

void FrameBoard::Remove(std::list<Line>::iterator line) {
  const base::MutexLock lock(&mutex_);
  lines_.erase(line);
}

std::vector<FrameBoard::Frame> FrameBoard::Frames() const {
  const base::MutexLock lock(&mutex_);
  std::vector<Frame> frames;
  for (const Line& line : lines_) {
    frames.push_back({line.note, line.phase.load(std::memory_order_relaxed)});
  }
  return frames;
}

}  // namespace isoscope::server
