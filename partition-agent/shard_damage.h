// The files of shards that could not be read: an agent reports them to coordinators, and keeps the
// paths of its machine to itself.

#ifndef ISOSCOPE_PARTITION_AGENT_SHARD_DAMAGE_H_
#define ISOSCOPE_PARTITION_AGENT_SHARD_DAMAGE_H_

#include <map>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/base/mutex.h"

namespace isoscope::agent {

// The latest error of a shard. `message` names the file below the shard's folder.
struct ShardDamage {
  std::string dataset;
  int shard_index = 0;
  std::string message;
};

// Thread-safe.
class ShardDamages {
 public:
  // hides_paths: callers may be on other machines. Else messages keep their paths.
  explicit ShardDamages(bool hides_paths) : hides_paths_(hides_paths) {}

  // Adds the folder of a shard that is served: an absolute path without a slash at its end.
  // source: the path of an index-only shard's samples, whose folder is not told either, nor those of
  //         other paths of this machine; or ""
  void AddShard(const std::string& directory, std::string dataset, int shard_index,
                const std::string& source = "") ABSL_LOCKS_EXCLUDED(mutex_);

  // Returns the error of a call for its caller. An error that names a path in the folder of a shard
  // is one of its files. It is noted, its first time with this message is logged, and it becomes
  // DATA_LOSS without the folder's path. RESOURCE_EXHAUSTED (open files, memory) stays and gets a
  // retry delay; it says nothing about the file. So do the ends of calls: CANCELLED,
  // DEADLINE_EXCEEDED, UNAVAILABLE. Other errors and OK stay as they are.
  //
  // A source that can't be read (ErrorReason::kSourceUnreadable) is no damage of a shard: the error
  // is logged as source_unreadable, and keeps its code, but for UNAUTHENTICATED, which becomes
  // PERMISSION_DENIED.
  absl::Status ForCaller(absl::Status status) ABSL_LOCKS_EXCLUDED(mutex_);

  // A folder below a shard's folder, or that itself, could be read: its damage is over.
  void Forget(const std::string& directory) ABSL_LOCKS_EXCLUDED(mutex_);

  // The damaged shards, by folder.
  [[nodiscard]] std::vector<ShardDamage> damages() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  struct Entry {
    std::string dataset;
    int shard_index = 0;
    std::string source_folder;                    // with a slash at its end; "" if there is none
    std::map<std::string, std::string> messages;  // by path of the file
    std::string source_message;                   // the latest that was logged
  };

  const bool hides_paths_;
  mutable base::Mutex mutex_;
  std::map<std::string, Entry> shards_ ABSL_GUARDED_BY(mutex_);  // by folder
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SHARD_DAMAGE_H_
