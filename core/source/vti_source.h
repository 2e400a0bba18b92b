// A VTK ImageData file (.vti) as a source.

#ifndef ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_

#include <memory>
#include <string>

#include "absl/status/statusor.h"

#include "core/source/volume_source.h"

namespace isoscope::source {

// Opens the array that PointData names as its scalars, or its first one: integers of 8 to 32 bits
// or floats, one component, either byte order; "appended" data (raw or base64) or inline "binary",
// uncompressed or in zlib blocks. Only the header is held, and for compressed data the place of
// every block (8 bytes a block; VTK writes blocks of 32 KiB). The file's Origin, Spacing, Direction
// and the start of its extent give the world.
// Source: VTK's file format description, "XML File Formats", https://docs.vtk.org.
// INVALID_ARGUMENT: no such file; text ("ascii") data; several pieces; another compressor; sizes
// that do not fit; the file ends early. DATA_LOSS: damaged.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVtiFile(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_
