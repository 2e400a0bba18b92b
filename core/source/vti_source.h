// A VTK ImageData file (.vti) as a source.

#ifndef ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_

#include <memory>
#include <optional>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/part_path.h"
#include "core/source/volume_source.h"
#include "core/source/vti_header.h"

namespace isoscope::source {

// True, with the parts, if the name is that of a VTK ImageData file, with or without an array:
// "file.vti", "file.vti:density", "file.vti:velocity:2".
bool SplitVtiPath(const std::string& path, PartPath* parts);

// Opens one array of points or of cells, whose samples lie at the cells' centres: integers of 8 to
// 32 bits or floats, either byte order; "appended" data (raw or base64) or inline "binary",
// uncompressed or in zlib blocks. Of an array of several components, one (counted from 0). Without
// a name: the first array of one component, points before cells, and of either that which is called
// its scalars. The file's Origin, Spacing, Direction and the start of its extent give the world.
//
// Holds the header, 64 KiB, and of compressed data one block and where each one lies (8 bytes a
// block; VTK writes blocks of 32 KiB).
// INVALID_ARGUMENT: no such file; only arrays of several components and none chosen (lists them,
// with the argument to give); text ("ascii") data; several pieces; another compressor; sizes that
// do not fit; the file ends early. NOT_FOUND: no such array (lists those there are). DATA_LOSS:
// damaged.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVtiFile(const std::string& path);

// Opens one component of one array of a file whose header was read before. `geometry` is that of
// the samples in the file, which need not be a volume; `name` is for messages. As OpenVtiFile, and
// takes Int64 and UInt64 (wide_source.h). REQUIRES: the choice is of this header; the geometry has
// at least one sample and at most 2^62.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVtiArray(const std::string& file,
                                                           const VtiHeader& header,
                                                           const VtiChoice& choice,
                                                           const volume::GridGeometry& geometry,
                                                           const std::string& name);

// The file's TimeValue; not set if it has none. Reads it from the file unless it stands in the
// header. INVALID_ARGUMENT: no finite number.
absl::StatusOr<std::optional<double>> ReadVtiTime(const std::string& file, const VtiHeader& header);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_
