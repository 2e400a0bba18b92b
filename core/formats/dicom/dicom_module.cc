#include "core/formats/dicom/dicom_module.h"

#include "core/base/status_macros.h"
#include "core/source/child/decoder_module.h"

namespace isoscope::source {
namespace {

absl::StatusOr<DecoderProcess::Handler> Load() {
  ISOSCOPE_ASSIGN_OR_RETURN(void* const symbol, LoadDecoderModule({.file = "isoscope_dicom.so",
                                                                   .symbol = "IsoscopeDecodeDicom",
                                                                   .format = "DICOM"}));
  return reinterpret_cast<DecoderProcess::Handler>(symbol);
}

}  // namespace

absl::StatusOr<DecoderProcess::Handler> LoadDicomModule() {
  static const auto* const loaded = new absl::StatusOr<DecoderProcess::Handler>(Load());
  return *loaded;
}

}  // namespace isoscope::source
