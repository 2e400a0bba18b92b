#include "core/partition/batch_writer.h"

#include <new>

#include "core/base/check.h"

namespace isoscope::partition {

BatchWriter::BatchWriter(ShardSet* shards, std::size_t batch_count)
    : shards_(*shards), batches_(batch_count) {
  ISOSCOPE_CHECK(batch_count >= 1);
  for (BlockBatch& batch : batches_) {
    free_.push_back(&batch);
  }
  thread_ = std::thread([this] { Run(); });
}

BatchWriter::~BatchWriter() {
  {
    const base::MutexLock lock(&mutex_);
    is_stopping_ = true;
  }
  changed_.SignalAll();
  thread_.join();
}

absl::StatusOr<BlockBatch*> BatchWriter::Take() {
  const base::MutexLock lock(&mutex_);
  changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
    return !free_.empty() || !status_.ok();
  });
  if (!status_.ok()) {
    return status_;
  }
  BlockBatch* const batch = free_.back();
  free_.pop_back();
  return batch;
}

void BatchWriter::Write(BlockBatch* batch) {
  {
    const base::MutexLock lock(&mutex_);
    queue_.push_back(batch);
  }
  changed_.SignalAll();
}

absl::Status BatchWriter::Finish() {
  const base::MutexLock lock(&mutex_);
  changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
    return queue_.empty() || !status_.ok();
  });
  return status_;
}

void BatchWriter::Run() {
  for (;;) {
    BlockBatch* batch = nullptr;
    {
      const base::MutexLock lock(&mutex_);
      changed_.Await(&mutex_, [this]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) {
        return is_stopping_ || !queue_.empty();
      });
      if (is_stopping_) {
        return;
      }
      batch = queue_.front();
    }
    const absl::Status status = WriteNext(batch);
    {
      const base::MutexLock lock(&mutex_);
      queue_.pop_front();
      free_.push_back(batch);
      status_.Update(status);
      is_stopping_ = is_stopping_ || !status.ok();
    }
    changed_.SignalAll();
  }
}

absl::Status BatchWriter::WriteNext(BlockBatch* batch) {
  try {
    return shards_.Write(batch);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("no memory to write blocks");
  }
}

}  // namespace isoscope::partition
