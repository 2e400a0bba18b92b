// Cuts one part of a dataset: a slab of blocks of each of its volumes. docs/partitioning.md says how
// parts are run.

#ifndef ISOSCOPE_CORE_PARTITION_PART_WRITER_H_
#define ISOSCOPE_CORE_PARTITION_PART_WRITER_H_

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/partition/partitioner.h"
#include "core/source/volume_series.h"
#include "core/store/part_file.h"

namespace isoscope::partition {

struct PartOptions {
  // As of the whole dataset; `check_source` is not used. The distribution is random.
  PartitionOptions volume;
  store::PartNumber part;
  // Names and values of all that decides the samples of the source, the same on every machine.
  std::vector<std::pair<std::string, std::string>> source_members;
};

struct PartReport {
  int written_volumes = 0;
  int kept_volumes = 0;  // were finished before, or by another process meanwhile
  std::int64_t block_count = 0;
};

// Cuts a part into "<output>.partial" (part_folder.h). Volumes of the part that are finished are
// kept. Any number of processes may cut parts at once, the same part too, on any machines that see
// the folder; each may be killed at any moment and be run again.
//
// Memory and determinism are those of Partition.
//
// INVALID_ARGUMENT, RESOURCE_EXHAUSTED and CANCELLED as Partition. ALREADY_EXISTS: the output.
// FAILED_PRECONDITION: other parts have another source or other options; the message says what
// differs. ABORTED: the source has changed.
absl::StatusOr<PartReport> PartitionPart(source::VolumeSeries& source, const PartOptions& options,
                                         const base::Cancellation& cancellation);

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PART_WRITER_H_
