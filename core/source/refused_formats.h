// Formats of volumes that are known, but not read.

#ifndef ISOSCOPE_CORE_SOURCE_REFUSED_FORMATS_H_
#define ISOSCOPE_CORE_SOURCE_REFUSED_FORMATS_H_

#include <optional>
#include <string>

namespace isoscope::source {

// A sentence without its end that names the format of an existing file or folder, and says what to
// do. Not set if it is none of these: N5, Zarr, VTK's meshes and parallel rectilinear grids, files
// of microscopes, JPEG, and MINC as a gzip stream. Names decide, but for folders of arrays, which
// have a file of theirs.
std::optional<std::string> WhyRefused(const std::string& path);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_REFUSED_FORMATS_H_
