// The module that has ITK's and GDCM's readers of DICOM files (dicom_child.h). GDCM takes long to
// load, and most runs do not need it.

#ifndef ISOSCOPE_CORE_SOURCE_DICOM_MODULE_H_
#define ISOSCOPE_CORE_SOURCE_DICOM_MODULE_H_

#include "absl/status/statusor.h"

#include "core/source/decoder_process.h"

namespace isoscope::source {

// Loads isoscope_dicom.so, for good, and returns its DecodeDicomInChild. Errors: LoadDecoderModule.
// Cheap when called again. Thread-safe.
absl::StatusOr<DecoderProcess::Handler> LoadDicomModule();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_DICOM_MODULE_H_
