// Reads the samples of portions from a source in one pass, whether the source can seek or not.

#ifndef ISOSCOPE_CORE_PARTITION_PORTION_READER_H_
#define ISOSCOPE_CORE_PARTITION_PORTION_READER_H_

#include <cstdint>
#include <memory>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/io/scratch_file.h"
#include "core/partition/block_cutter.h"
#include "core/partition/partition_plan.h"
#include "core/source/volume_source.h"
#include "core/volume/block_layout.h"

namespace isoscope::partition {

// Portions of whole planes: planes that two portions share are copied from the portion before, so
// every plane is read once. Bands of a source that can't seek are staged: the planes of a layer are
// read once, in order, into a scratch file that holds one layer, and bands are read from there.
// Bands of a source that can seek are read from it directly. Thread-compatible.
class PortionReader {
 public:
  // All pointers and references must outlive the reader. Scratch files go to `directory`.
  PortionReader(source::VolumeSource* source, const volume::BlockLayout& layout,
                const PartitionPlan& plan, std::string directory,
                const base::Cancellation* cancellation);

  // Returns the memory that staging takes.
  static std::int64_t StagingBytes(const source::VolumeSource& source);

  // Reads a portion. Portions come in ascending order, and from the first again for another pass.
  //
  // previous: portion i - 1 as it was read; null for the first of a pass; may be `out`
  // out:      [z][y][x] over SamplesOfPortion, x fastest; plan.portion_bytes suffice
  //
  // Errors: the source's, the scratch file's, CANCELLED.
  absl::Status Read(std::int64_t i, const char* previous, char* out);

  // Passes over some portions once: calls visit(slab, portion), then report(share of the portions that
  // are done). The next portion is read while `visit` works on this one, if the plan has two
  // buffers. Errors as Read, and those of `visit`.
  absl::Status ForEachPortion(const PortionRange& portions,
                              absl::FunctionRef<absl::Status(const Slab&, const Portion&)> visit,
                              absl::FunctionRef<void(double)> report);

 private:
  // The end of the planes that are best read together with `z`.
  [[nodiscard]] std::int64_t LayerEnd(std::int64_t z) const;
  absl::Status ReadPlanes(std::int64_t begin, std::int64_t end, char* out);
  absl::Status ReadBand(const math::IndexBox& box, char* out);
  absl::Status StageUpTo(std::int64_t end_plane);

  source::VolumeSource& source_;
  const volume::BlockLayout& layout_;
  const PartitionPlan& plan_;
  const std::string directory_;
  const base::Cancellation& cancellation_;
  const source::CancellableReads reads_;
  const std::int64_t row_bytes_;

  // Staging: a ring of planes in the scratch file. Plane z is the ring's plane z % ring_planes_.
  std::unique_ptr<io::ScratchFile> scratch_;
  std::int64_t ring_planes_ = 0;
  std::int64_t staged_end_ = 0;  // the next plane to stage
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_PORTION_READER_H_
