// A part of a chunked array of three axes or more as a source.

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_ZARR_SOURCE_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_ZARR_SOURCE_H_

#include <array>
#include <cstddef>
#include <memory>

#include "absl/status/statusor.h"

#include "core/formats/zarr/zarr_packing.h"
#include "core/source/chunks/chunk_box.h"
#include "core/source/chunks/chunked_array.h"
#include "core/source/volume_source.h"

namespace isoscope::source {

// The axes of space in the order of the array, [0] slowest, and the index on all other axes.
struct ZarrPart {
  std::array<std::size_t, 3> space{};
  ChunkIndex index{};  // one number for each axis; those of space do not matter
};

// Serves the part with name, grid and patient frame of `info`; type and memory are set here. Keeps
// chunks that reach into the next planes, at most 256 MiB of them: those of a layer of the volume
// if they fit. Integers of 64 bits and floats of 16 become others as MakeWideSource says.
// REQUIRES: the grid has the sizes of the axes of space; the index lies in the array.
std::unique_ptr<VolumeSource> MakeZarrSource(SourceInfo info,
                                             std::shared_ptr<const ChunkedArray> array,
                                             ZarrPart part, ZarrPacking packing);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_ZARR_SOURCE_H_
