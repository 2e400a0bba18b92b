// The modules of lib/isoscope: libraries of formats that take long to load, and that most runs do
// not need.

#ifndef ISOSCOPE_CORE_SOURCE_CHILD_DECODER_MODULE_H_
#define ISOSCOPE_CORE_SOURCE_CHILD_DECODER_MODULE_H_

#include "absl/status/statusor.h"

namespace isoscope::source {

// A module, and a function of it with C linkage.
struct DecoderModule {
  const char* file;    // "isoscope_dicom.so"
  const char* symbol;  // "IsoscopeDecodeDicom"
  const char* format;  // "DICOM", for messages
};

// Loads the module, for good, and returns the address of the function, which is never null. The
// file is in lib/isoscope, beside the folder of the program: /usr/lib/isoscope for
// /usr/bin/isoscope. FAILED_PRECONDITION: it is not there, a library that it needs is missing, or
// /proc is. Thread-safe.
absl::StatusOr<void*> LoadDecoderModule(const DecoderModule& module);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_CHILD_DECODER_MODULE_H_
