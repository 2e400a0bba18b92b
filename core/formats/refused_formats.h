// Files that are not read: what they are, by content and by name, and what to do.

#ifndef ISOSCOPE_CORE_FORMATS_REFUSED_FORMATS_H_
#define ISOSCOPE_CORE_FORMATS_REFUSED_FORMATS_H_

#include <optional>
#include <string>

#include "absl/status/status.h"
#include "absl/types/span.h"

#include "core/formats/format_table.h"

namespace isoscope::source {

// A sentence without its end: what a file or folder is by content (DescribeContent), else by name:
// N5, Zarr, VTK's meshes and parallel rectilinear grids, files of microscopes, ... A folder of
// arrays is known by a file of its own.
std::optional<std::string> WhyRefused(const std::string& path);

// "a.nii.gz, b.nrrd and 3 more": the files of a folder whose names or contents are those of
// volumes, so that one can be given in place of the folder; "" if there are none.
std::string ListVolumesIn(const std::string& folder, absl::Span<const Format> formats = Formats());

// INVALID_ARGUMENT for an existing file that no reader takes: WhyRefused; else that its kind is
// unknown, how it begins, and how to read it as raw samples. 300 bytes beside the path at most.
absl::Status UnknownKindOfFile(const std::string& path);

// An error of a reader. If the file that `path` names, with or without a part behind a colon, is of
// content that explains it (DescribeContent), says that in its place.
absl::Status ExplainByContent(const std::string& path, absl::Status status,
                              absl::Span<const Format> formats = Formats());

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_REFUSED_FORMATS_H_
