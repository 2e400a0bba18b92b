// Writes a generated volume to a file that the partitioner reads.

#ifndef ISOSCOPE_CORE_SYNTHETIC_VOLUME_FILE_H_
#define ISOSCOPE_CORE_SYNTHETIC_VOLUME_FILE_H_

#include <cstdint>
#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/base/cancellation.h"
#include "core/math/vec.h"
#include "core/synthetic/volume_generator.h"

namespace isoscope::source {

// NRRD headers have the names and colours of labels, as segments of 3D Slicer; the others have no
// place for them.
enum class VolumeFileKind {
  kNrrd,          // .nrrd: header and samples in one file
  kDetachedNrrd,  // .nhdr: the header; the samples lie beside it, in a file that ends in .raw
  kMetaImage,     // .mha
  kRaw,           // .raw: no header
};

// Returns the kind by the ending of the name. INVALID_ARGUMENT, listing the endings, if it is none
// of them.
absl::StatusOr<VolumeFileKind> VolumeFileKindOf(const std::string& path);

struct VolumeFileOptions {
  std::string path;  // the samples of a .nhdr go to the same name with .raw
  math::Vec3d spacing{1, 1, 1};
  math::Vec3d origin{};
  // Sample bytes written and to be written; may be null; called by one thread at a time.
  std::function<void(std::int64_t done_bytes, std::int64_t total_bytes)> progress{};
};

// Generates in parallel and writes front to back, in constant memory (2 MiB or four rows, twice
// each thread). Crash-safe: written to "<path>.partial-<pid>", flushed, and renamed at the end;
// replaces a file of that name in one step; an error or a cancellation leaves nothing.
// INVALID_ARGUMENT: unknown ending, invalid spacing or origin. RESOURCE_EXHAUSTED: the disk is
// full, or would be (checked before the first byte). Returns the bytes of samples.
absl::StatusOr<std::int64_t> WriteVolumeFile(const VolumeGenerator& generator,
                                             const VolumeFileOptions& options,
                                             const base::Cancellation& cancellation);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SYNTHETIC_VOLUME_FILE_H_
