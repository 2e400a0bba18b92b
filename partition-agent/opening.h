// How far an agent is that opens its shards, and how its opening ends early.

#ifndef ISOSCOPE_PARTITION_AGENT_OPENING_H_
#define ISOSCOPE_PARTITION_AGENT_OPENING_H_

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/io/file.h"

namespace isoscope::agent {

struct OpeningProgress {
  int shard_count = 0;
  int open_shard_count = 0;
  std::int64_t table_bytes = 0;  // of files that opening reads: tables, not blocks
  std::int64_t read_bytes = 0;
  std::vector<std::string> datasets{};  // names, ascending, each once
};

// "3 of 8 shards are open, 1,234.5 MiB of 2,000.0 MiB of tables are read".
std::string ToString(const OpeningProgress& progress);

// Thread-safe.
class Opening {
 public:
  // Sets what will be opened, and whose tables count.
  void Begin(const std::vector<std::string>& shard_directories) ABSL_LOCKS_EXCLUDED(mutex_);
  void NoteOpen() { open_shard_count_.fetch_add(1); }

  // Opens a file whose reads are counted, if it is a table. They go in parts, and return CANCELLED
  // once `cancellation` has fired: it outlives the file. Errors as io::OpenRandomAccessFile.
  absl::StatusOr<std::unique_ptr<io::RandomAccessFile>> OpenFile(
      const std::string& path, const base::Cancellation& cancellation);

  [[nodiscard]] OpeningProgress progress() const ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  mutable base::Mutex mutex_;
  OpeningProgress plan_ ABSL_GUARDED_BY(mutex_);  // without the members below
  std::atomic<int> open_shard_count_{0};
  std::atomic<std::int64_t> read_bytes_{0};
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_OPENING_H_
