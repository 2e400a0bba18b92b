// isoscope_dicom.so exports these symbols (dicom_module.h).

#include "core/formats/dicom/dicom_child.h"

extern "C" void IsoscopeDecodeDicom(const void* request_bytes, void* answer_bytes, char* shared) {
  isoscope::source::DecodeDicomInChild(request_bytes, answer_bytes, shared);
}
