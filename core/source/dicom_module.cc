#include "core/source/dicom_module.h"

#include <dlfcn.h>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace isoscope::source {
namespace {

absl::StatusOr<DecoderProcess::Handler> Load() {
  void* const module = ::dlopen("isoscope_dicom.so", RTLD_NOW | RTLD_LOCAL);
  void* const symbol = module != nullptr ? ::dlsym(module, "IsoscopeDecodeDicom") : nullptr;
  if (symbol == nullptr) {
    // NOLINTNEXTLINE(concurrency-mt-unsafe): glibc keeps the text by thread
    const char* const why = ::dlerror();
    return absl::FailedPreconditionError(
        absl::StrCat("DICOM files can't be read (", why != nullptr ? why : "no handler",
                     "); isoscope_dicom.so belongs in lib/isoscope, beside the folder of the "
                     "program: install it again"));
  }
  return reinterpret_cast<DecoderProcess::Handler>(symbol);
}

}  // namespace

absl::StatusOr<DecoderProcess::Handler> LoadDicomModule() {
  static const auto* const loaded = new absl::StatusOr<DecoderProcess::Handler>(Load());
  return *loaded;
}

}  // namespace isoscope::source
