// A VTK ImageData file (.vti) as a source.

#ifndef ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_
#define ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/io/file.h"
#include "core/source/grid_rules.h"
#include "core/source/part_path.h"
#include "core/source/volume_source.h"
#include "core/source/vti_choice.h"
#include "core/source/vti_header.h"
#include "core/volume/grid_geometry.h"

namespace isoscope::source {

// True, with the parts, if the name is that of a VTK ImageData file, with or without an array:
// "file.vti", "file.vti:density", "file.vti:velocity:2".
bool SplitVtiPath(const std::string& path, PartPath* parts);

// Opens one array of points or of cells, whose samples lie at the cells' centres: integers, those
// of 64 bits as in wide_source.h, or floats, either byte order; "appended" data (raw or base64) or
// inline "binary", uncompressed or in zlib blocks; text ("ascii"). Reads one component (counted
// from 0) of an array of several. Without a name: the first array of one component, points before
// cells, and among either the one that the file calls its scalars. Origin, Spacing, Direction and
// the start of the extent define the world coordinates.
//
// Holds the header and 64 KiB; for compressed data also one block and 8 bytes for each block (VTK
// writes blocks of 32 KiB). INVALID_ARGUMENT: no such file; only arrays of several components and
// none chosen (lists them, with the argument to give); several pieces; another
// compressor; sizes that do not fit; the file ends early. NOT_FOUND: no such array (lists those
// there are). DATA_LOSS: damaged.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVtiFile(const std::string& path,
                                                          const GridRules& rules = {});

// Opens one component of one array of a file whose header was read before. `geometry` is that of
// the samples in the file, which need not be a volume; `name` is for messages. As OpenVtiFile.
// REQUIRES: the choice is of this header; the geometry has
// at least one sample and at most 2^62.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenVtiArray(const std::string& file,
                                                           const VtiHeader& header,
                                                           const VtiChoice& choice,
                                                           const volume::GridGeometry& geometry,
                                                           const std::string& name);

// The `count` numbers of an array of one component, in any format and of any type of a volume.
// Errors as OpenVtiFile. INVALID_ARGUMENT also: a text that ends early, or has a word that is none.
absl::StatusOr<std::vector<double>> ReadVtiNumbers(const io::RandomAccessFile& file,
                                                   const VtiHeader& header, const VtiArray& array,
                                                   std::int64_t count);

// The file's TimeValue; not set if it has none. Reads it from the file unless it stands in the
// header. INVALID_ARGUMENT: no finite number.
absl::StatusOr<std::optional<double>> ReadVtiTime(const std::string& file, const VtiHeader& header);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VTI_SOURCE_H_
