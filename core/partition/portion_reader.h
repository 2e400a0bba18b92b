// Reads the samples of portions from a source, in one pass, whatever the source can do.

#ifndef ISOSCOPE_CORE_PARTITION_PORTION_READER_H_
#define ISOSCOPE_CORE_PARTITION_PORTION_READER_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/io/scratch_file.h"
#include "core/partition/partition_plan.h"
#include "core/source/volume_source.h"
#include "core/volume/block_layout.h"

namespace isoscope::partition {

// Portions of whole planes are read with the planes that two of them share taken over from the one
// before, so every plane is read once. Bands of a source that can't seek are staged: a layer's
// planes are read once, in order, into a scratch file that holds one layer, and bands come from
// there. Bands of a source that can seek are read from it directly. Thread-compatible.
class PortionReader {
 public:
  // Everything must outlive it; scratch files are made in `directory`.
  PortionReader(source::VolumeSource* source, const volume::BlockLayout& layout,
                const PartitionPlan& plan, std::string directory,
                const base::Cancellation* cancellation);

  // What staging takes of memory.
  static std::int64_t StagingBytes(const source::VolumeSource& source);

  // Reads portion `i` as [z][y][x] over SamplesOfPortion into `out`. Portions are read in ascending
  // order from 0, again from 0 for another pass. `previous` is portion i - 1 as it was read, null
  // for i = 0; it may be `out`. The source's errors, the scratch file's, CANCELLED.
  absl::Status Read(std::int64_t i, const char* previous, char* out);

 private:
  absl::Status ReadPlanes(std::int64_t begin, std::int64_t end, char* out);
  absl::Status ReadBand(const math::IndexBox& box, char* out);
  absl::Status StageUpTo(std::int64_t end_plane);

  source::VolumeSource& source_;
  const volume::BlockLayout& layout_;
  const PartitionPlan& plan_;
  const std::string directory_;
  const base::Cancellation& cancellation_;
  const std::int64_t row_bytes_;

  // Staging: plane z lies at slot z % ring_planes_.
  std::unique_ptr<io::ScratchFile> scratch_;
  std::int64_t ring_planes_ = 0;
  std::int64_t staged_end_ = 0;  // planes [.., staged_end_) were staged
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PORTION_READER_H_
