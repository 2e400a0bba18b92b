// The common parts of the headers of both versions of NIfTI, and of Analyze. layout_formats.h has
// their readers.

#ifndef ISOSCOPE_CORE_FORMATS_MEDICAL_NIFTI_LAYOUT_H_
#define ISOSCOPE_CORE_FORMATS_MEDICAL_NIFTI_LAYOUT_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/source/bytes/sample_location.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// Sets how samples are scaled; a slope of 0 or NaN, as nibabel writes it, means that they are not.
// INVALID_ARGUMENT: an infinite slope; a slope with an intercept that is not finite. `format` is
// for messages: "NIfTI-1".
absl::Status SetNiftiScale(double slope, double intercept, const char* format,
                           const std::string& path, SampleLocation* location);

// Returns the type of a code of either version of NIfTI. INVALID_ARGUMENT: no volume has it.
absl::StatusOr<volume::ScalarType> NiftiSampleType(std::int16_t code, const std::string& path);
// "a.img" or "a.img.gz" beside "a.hdr" or "a.hdr.gz", also of Analyze. NOT_FOUND if neither exists.
absl::StatusOr<std::vector<std::string>> NiftiImageOfPair(const std::string& header_path);
// Returns true if the samples in `file` are a gzip stream. In the header's own file its content
// decides; in another one the name must say it, too, as samples may begin with any bytes.
bool IsNiftiStream(const std::string& header_path, const std::string& file);
// "s", "ms", "us", or "" for other units, which are no times.
const char* NiftiTimeUnit(std::uint8_t units);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_MEDICAL_NIFTI_LAYOUT_H_
