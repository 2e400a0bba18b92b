#include "server/frame/agent_room.h"

#include <algorithm>

namespace isoscope::server {

std::size_t AgentRoom::MostPixels(const std::string& dataset_id, int max_layers) {
  const base::MutexLock lock(&mutex_);
  DropOld();
  const auto found = Find(dataset_id, max_layers);
  return found == entries_.end() ? 0 : found->pixels;
}

void AgentRoom::Note(const std::string& dataset_id, int max_layers, std::size_t pixels) {
  const base::MutexLock lock(&mutex_);
  if (const auto found = Find(dataset_id, max_layers); found != entries_.end()) {
    entries_.erase(found);
  }
  entries_.push_front({dataset_id, max_layers, pixels, now_()});
  if (entries_.size() > kMaxEntries) {
    entries_.pop_back();
  }
}

void AgentRoom::DropOld() {
  const base::MonotonicTime now = now_();
  while (!entries_.empty() && now - entries_.back().noted > kMaxAge) {
    entries_.pop_back();
  }
}

std::list<AgentRoom::Entry>::iterator AgentRoom::Find(const std::string& dataset_id,
                                                      int max_layers) {
  return std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) {
    return entry.max_layers == max_layers && entry.dataset_id == dataset_id;
  });
}

}  // namespace isoscope::server
