#include "core/source/chunks/shard_indexes.h"

#include <cstddef>

namespace isoscope::source {
namespace {

// Nodes of the list and the map, their keys, and the index's own head.
constexpr std::int64_t kEntryBytes = 256;

std::int64_t BytesOf(const std::string& key, const ShardIndexes::Index& index) {
  const std::size_t entries = index == nullptr ? 0 : index->size() * sizeof(ShardEntry);
  return kEntryBytes + static_cast<std::int64_t>(2 * key.size() + entries);
}

}  // namespace

ShardIndexes& ShardIndexes::OfProcess() {
  static ShardIndexes* const indexes =
      new ShardIndexes(kDefaultMaxBytes);  // arrays may outlive main
  return *indexes;
}

void ShardIndexes::SetMaxBytes(std::int64_t max_bytes) {
  const base::MutexLock lock(&mutex_);
  max_bytes_ = max_bytes;
  DropSome();
}

std::int64_t ShardIndexes::NumberArray() {
  const base::MutexLock lock(&mutex_);
  return next_array_++;
}

void ShardIndexes::Forget(std::int64_t array) {
  const base::MutexLock lock(&mutex_);
  for (auto kept = places_.lower_bound({array, ""});
       kept != places_.end() && kept->first.first == array;) {
    Drop(kept++);
  }
}

std::optional<ShardIndexes::Index> ShardIndexes::Find(std::int64_t array, const std::string& key) {
  const base::MutexLock lock(&mutex_);
  const auto kept = places_.find({array, key});
  if (kept == places_.end()) {
    return std::nullopt;
  }
  entries_.splice(entries_.begin(), entries_, kept->second);
  return kept->second->index;
}

void ShardIndexes::Keep(std::int64_t array, const std::string& key, Index index) {
  const std::int64_t bytes = BytesOf(key, index);
  std::list<Entry> added;
  added.push_front({.key = {array, key}, .index = std::move(index), .bytes = bytes});
  const base::MutexLock lock(&mutex_);
  if (const auto kept = places_.find(added.front().key); kept != places_.end()) {
    Drop(kept);
  }
  places_.emplace(added.front().key, added.begin());
  entries_.splice(entries_.begin(), added);
  kept_bytes_ += bytes;
  DropSome();
}

std::int64_t ShardIndexes::kept_bytes() const {
  const base::MutexLock lock(&mutex_);
  return kept_bytes_;
}

void ShardIndexes::DropSome() {
  while (kept_bytes_ > max_bytes_ && entries_.size() > 1) {
    Drop(places_.find(entries_.back().key));
  }
}

void ShardIndexes::Drop(std::map<Key, Place>::iterator kept) {
  kept_bytes_ -= kept->second->bytes;
  entries_.erase(kept->second);
  places_.erase(kept);
}

}  // namespace isoscope::source
