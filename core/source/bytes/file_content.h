// Describes a file by its first bytes, if no reader takes it.

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_FILE_CONTENT_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_FILE_CONTENT_H_

#include <cstddef>
#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

#include "core/io/file.h"

namespace isoscope::source {

// This number of bytes is enough to tell.
inline constexpr std::size_t kContentBytes = 1024;

// Advice for kinds of files, behind RefusedSentence.
inline constexpr char kStackAdvice[] =
    "slices are a folder of such files or a pattern, with names that say their format";
inline constexpr char kMeshAdvice[] =
    "a mesh, not a volume: isoscope makes meshes (isoscope export) and reads what they are made of";
inline constexpr char kResampleAdvice[] =
    "resample it, as ParaView's filter \"Resample To Image\" does, and save it as .vti";
inline constexpr char kXdmfAdvice[] =
    "give the HDF5 file that it names, with the dataset: FILE.h5:/name; or pvpython -c \"from "
    "paraview.simple import *; SaveData('OUT.vti', OpenDataFile('./IN'))\"";
inline constexpr char kAmiraAdvice[] =
    "bfconvert IN OUT.ome.tif, of Bio-Formats; or save it as NRRD, MetaImage or .vti";
inline constexpr char kGatanAdvice[] =
    "dm2mrc IN OUT.mrc, of IMOD; or save it as TIFF, as Fiji does";
inline constexpr char kOpenDxAdvice[] =
    "python3 -c \"import gridData as d, mrcfile, numpy; g = d.Grid('IN'); m = "
    "mrcfile.new('OUT.mrc', "
    "numpy.float32(g.grid.T)); m.voxel_size = tuple(g.delta); m.header.origin = tuple(g.origin); "
    "m.close()\"";
inline constexpr char kSegyAdvice[] =
    "python3 -c \"import numpy, segyio; numpy.save('OUT.npy', segyio.tools.cube('IN'))\"";
inline constexpr char kServeAdvice[] = "in Python, isoscope.serve(array) takes its array";

// "NAME, which is not read: ADVICE".
std::string RefusedSentence(absl::string_view name, absl::string_view advice);

// Returns a sentence without its end: the kind of an existing regular file by its first bytes, and
// the way out. Kinds are a Git LFS pointer, a web page, an archive, a picture, a mesh, and formats
// of others. Not set for content that a reader takes, and for what has no mark. Opens no special
// file.
std::optional<std::string> DescribeContent(const std::string& path);

// What Git LFS leaves in place of a file that was not fetched begins with these bytes. So do its
// pointers in place of a chunk, or of metadata.
inline constexpr char kLfsPointerMark[] = "version https://git-lfs.github.com/spec/";
// INVALID_ARGUMENT: `name` is such a pointer, and how to fetch the file.
absl::Status LfsPointerError(absl::string_view name);
// Refuses an open file that is one. Reads nothing of a file that is larger than pointers are.
absl::Status CheckIsNoLfsPointer(const io::RandomAccessFile& file);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_FILE_CONTENT_H_
