// The module that has ITK's and GDCM's readers of DICOM files (dicom_child.h). GDCM takes long to
// load, and most runs do not need it.

#ifndef ISOSCOPE_CORE_FORMATS_DICOM_DICOM_MODULE_H_
#define ISOSCOPE_CORE_FORMATS_DICOM_DICOM_MODULE_H_

#include <cstdint>

#include "absl/status/statusor.h"

#include "core/base/units.h"
#include "core/source/child/decoder_process.h"

namespace isoscope::source {

// The loaded module takes at most this in the process: GDCM's table of elements, and pages of
// libraries.
inline constexpr std::int64_t kDicomModuleBytes = 12 * base::kMiB;

// Loads isoscope_dicom.so, for good, and returns its DecodeDicomInChild. Errors: LoadDecoderModule.
// Cheap when called again. Thread-safe.
absl::StatusOr<DecoderProcess::Handler> LoadDicomModule();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_DICOM_DICOM_MODULE_H_
