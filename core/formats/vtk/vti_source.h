// A VTK ImageData file (.vti) as a source.

#ifndef ISOSCOPE_CORE_FORMATS_VTK_VTI_SOURCE_H_
#define ISOSCOPE_CORE_FORMATS_VTK_VTI_SOURCE_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/vtk/vti_choice.h"
#include "core/formats/vtk/vti_header.h"
#include "core/io/file.h"
#include "core/source/volume_source.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// Opens one component of one array of a file whose header was read before: integers, those of 64
// bits as in wide_source.h, or floats, either byte order; "appended" data (raw or base64) or inline
// "binary", uncompressed or in zlib blocks; text ("ascii"). `geometry` is that of the samples in
// the file, which need not be a volume; `name` is for messages.
//
// Holds the header and 64 KiB; for compressed data also one block and 8 bytes for each block (VTK
// writes blocks of 32 KiB). INVALID_ARGUMENT: another compressor; sizes that do not fit; the file
// ends early. DATA_LOSS: damaged. REQUIRES: the choice is of this header; the geometry has at least
// one sample and at most 2^62.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVtiArray(const std::string& file,
                                                           const VtiHeader& header,
                                                           const VtiChoice& choice,
                                                           const volume::GridGeometry& geometry,
                                                           const std::string& name);

// The `count` numbers of an array of one component, in any format and of any type of a volume.
// Errors as OpenVtiArray. INVALID_ARGUMENT also: a text that ends early, or has a word that is
// none.
absl::StatusOr<std::vector<double>> ReadVtiNumbers(const io::RandomAccessFile& file,
                                                   const VtiHeader& header, const VtiArray& array,
                                                   std::int64_t count);

// The file's TimeValue; not set if it has none. Reads it from the file unless it stands in the
// header. INVALID_ARGUMENT: no finite number.
absl::StatusOr<std::optional<double>> ReadVtiTime(const std::string& file, const VtiHeader& header);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_VTK_VTI_SOURCE_H_
