// Volumes that are stacks of grey images, read in a process of its own.

#ifndef ISOSCOPE_CORE_FORMATS_STACKS_IMAGE_SLICES_H_
#define ISOSCOPE_CORE_FORMATS_STACKS_IMAGE_SLICES_H_

#include <memory>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/volume_source.h"

namespace isoscope::source {

// Whether the name of a file is one of a slice, in any case.
inline constexpr char kImageSliceEndings[] = ".png .jp2 .j2k .j2c .jpc .jpg .jpeg";
bool IsImageSliceName(const std::string& path);

// The slices that `path`, a folder or a pattern, names (FilesNamed), of one kind: PNG, else JPEG
// 2000, else JPEG. So previews in JPEG are left out.
std::vector<std::string> ImageSlicesNamed(const std::string& path);

// Opens the slices that `path` names, one image each: grey, of one size and type. They are read one
// at a time; the spacing is 1, since such files have only that of a print. INVALID_ARGUMENT: fewer
// than two slices; names that are not those of one stack (stack_names.h), unless they are taken
// `as_neighbours`; colours; slices of different size or type, which are found when they are read.
// DATA_LOSS: a file is cut, or its library ended the child.
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenImageSlices(const std::string& path,
                                                              bool as_neighbours = false);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_STACKS_IMAGE_SLICES_H_
