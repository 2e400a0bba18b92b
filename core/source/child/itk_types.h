// ITK's sample types and errors as ours. Includes ITK, which is slow to compile: for source files
// only.

#ifndef ISOSCOPE_CORE_SOURCE_CHILD_ITK_TYPES_H_
#define ISOSCOPE_CORE_SOURCE_CHILD_ITK_TYPES_H_

#include <exception>
#include <string>

#include "absl/status/statusor.h"
#include "itkImageIOBase.h"

#include "core/volume/scalar_type.h"

namespace isoscope::source {

// INVALID_ARGUMENT, naming `path`, for 64-bit integers and anything that is no number.
absl::StatusOr<volume::ScalarType> ScalarTypeOf(itk::ImageIOBase::IOComponentEnum component,
                                                const std::string& path);

// "too many axes" of "ITK ERROR: NrrdImageIO(0x55ae): too many axes"; of other errors, all.
std::string TextOfItk(const std::exception& error);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHILD_ITK_TYPES_H_
