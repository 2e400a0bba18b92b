// Reads the units of a far source before the blocks that lie in them are read.

#ifndef ISOSCOPE_PARTITION_AGENT_SUPPLY_UNIT_READ_AHEAD_H_
#define ISOSCOPE_PARTITION_AGENT_SUPPLY_UNIT_READ_AHEAD_H_

#include <cstddef>
#include <thread>
#include <vector>

#include "absl/base/thread_annotations.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/math/vec.h"
#include "core/store/sample_reader.h"

namespace isoscope::agent {

// Reads units on threads of its own, which wait for a server most of the time: in their order, and
// no farther ahead of their use than SampleReader::max_units_ahead. Thread-safe.
class UnitReadAhead {
 public:
  // Enough for 1 Gbit/s over 100 ms with units of 512 KiB.
  static constexpr std::size_t kMaxThreads = 32;

  struct Unit {
    const store::SampleReader* reader = nullptr;
    math::Index3 index{0, 0, 0};
  };

  // units:        in the order in which they are used, of one source; the readers outlive this
  // cancellation: outlives this
  UnitReadAhead(std::vector<Unit> units, const base::Cancellation& cancellation);
  // Ends the reads under way.
  ~UnitReadAhead();
  UnitReadAhead(const UnitReadAhead&) = delete;
  UnitReadAhead& operator=(const UnitReadAhead&) = delete;

  // Says that the first `count` units were used. The count may go back, which changes nothing.
  void HasUsed(std::size_t count) ABSL_LOCKS_EXCLUDED(mutex_);

 private:
  void Run() ABSL_LOCKS_EXCLUDED(mutex_);

  const std::vector<Unit> units_;
  std::size_t max_ahead_ = 0;
  base::Cancellation ended_;
  base::Mutex mutex_;
  base::CondVar changed_;
  std::size_t next_ ABSL_GUARDED_BY(mutex_) = 0;
  std::size_t used_count_ ABSL_GUARDED_BY(mutex_) = 0;
  // After an error nothing more is read ahead: who needs the unit reads it, and reports.
  bool has_failed_ ABSL_GUARDED_BY(mutex_) = false;
  base::Cancellation::Callback frame_ends_;
  std::vector<std::thread> threads_;
};

}  // namespace isoscope::agent

#endif  // ISOSCOPE_PARTITION_AGENT_SUPPLY_UNIT_READ_AHEAD_H_
