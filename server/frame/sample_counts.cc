#include "server/frame/sample_counts.h"

#include <algorithm>

namespace isoscope::server {

std::shared_ptr<const SampleCounts> SampleCountsCache::Find(const std::string& dataset_id) {
  const base::MutexLock lock(&mutex_);
  const auto found = std::find_if(entries_.begin(), entries_.end(),
                                  [&](const Entry& entry) { return entry.first == dataset_id; });
  if (found == entries_.end()) {
    return nullptr;
  }
  entries_.splice(entries_.begin(), entries_, found);
  return found->second;
}

void SampleCountsCache::Insert(const std::string& dataset_id,
                               std::shared_ptr<const SampleCounts> counts) {
  const base::MutexLock lock(&mutex_);
  entries_.remove_if([&](const Entry& entry) { return entry.first == dataset_id; });
  if (entries_.size() == kMaxVolumes) {
    entries_.pop_back();
  }
  entries_.emplace_front(dataset_id, std::move(counts));
}

}  // namespace isoscope::server
