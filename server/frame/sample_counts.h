// How many samples of a volume have which values, kept between frames: for windows of caps.

#ifndef ISOSCOPE_SERVER_FRAME_SAMPLE_COUNTS_H_
#define ISOSCOPE_SERVER_FRAME_SAMPLE_COUNTS_H_

#include <cstddef>
#include <list>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "absl/base/thread_annotations.h"

#include "core/base/mutex.h"
#include "core/volume/sample_histogram.h"
#include "core/volume/scalar_span.h"

namespace isoscope::server {

// Immutable once shared.
struct SampleCounts {
  std::optional<volume::SampleHistogram> samples;  // not set: the volume has no counts
  volume::ScalarSpan value_range;                  // of all samples that are not NaN
};

// Keeps the counts of the volumes used last, at most 32 KiB each. Thread-safe.
class SampleCountsCache {
 public:
  static constexpr std::size_t kMaxVolumes = 32;

  // dataset_id: of the volume, which says its samples. Returns null if there is no value.
  std::shared_ptr<const SampleCounts> Find(const std::string& dataset_id);
  void Insert(const std::string& dataset_id, std::shared_ptr<const SampleCounts> counts);

 private:
  using Entry = std::pair<std::string, std::shared_ptr<const SampleCounts>>;

  base::Mutex mutex_;
  std::list<Entry> entries_ ABSL_GUARDED_BY(mutex_);  // most recently used first; few
};

}  // namespace isoscope::server

#endif  // ISOSCOPE_SERVER_FRAME_SAMPLE_COUNTS_H_
