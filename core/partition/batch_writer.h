// Writes batches of blocks on a thread of its own, while the next ones are cut: a write waits for
// the disk, and holds one core for the copy into the page cache.

#ifndef ISOSCOPE_CORE_PARTITION_BATCH_WRITER_H_
#define ISOSCOPE_CORE_PARTITION_BATCH_WRITER_H_

#include <cstddef>
#include <deque>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/mutex.h"
#include "core/partition/block_batch.h"
#include "core/partition/shard_set.h"

namespace isoscope::partition {

// Take, cut and Write for each batch, then Finish. Batches are written one after the other, in the
// order of Write. Thread-compatible. The destructor drops the batches whose write has not begun.
class BatchWriter {
 public:
  // `shards` outlives it, and is used by nobody else until Finish. REQUIRES: batch_count >= 1.
  BatchWriter(ShardSet* shards, std::size_t batch_count);
  ~BatchWriter();

  BatchWriter(const BatchWriter&) = delete;
  BatchWriter& operator=(const BatchWriter&) = delete;

  // Waits until a batch is free, and returns it. The error of an earlier write instead, if there is
  // one. REQUIRES: the batch before was given to Write.
  absl::StatusOr<BlockBatch*> Take();
  // Queues a batch that was taken and cut.
  void Write(BlockBatch* batch);
  // Waits until all batches are written. Returns the first error.
  absl::Status Finish();

 private:
  void Run();
  [[nodiscard]] absl::Status WriteNext(BlockBatch* batch);

  ShardSet& shards_;
  std::vector<BlockBatch> batches_;
  base::Mutex mutex_;
  base::CondVar changed_;
  std::vector<BlockBatch*> free_ ABSL_GUARDED_BY(mutex_);
  std::deque<BlockBatch*> queue_ ABSL_GUARDED_BY(mutex_);  // the first one is being written
  absl::Status status_ ABSL_GUARDED_BY(mutex_);
  bool is_stopping_ ABSL_GUARDED_BY(mutex_) = false;
  std::thread thread_;  // last: it uses the others
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_BATCH_WRITER_H_
