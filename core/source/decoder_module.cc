#include "core/source/decoder_module.h"

#include <dlfcn.h>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace isoscope::source {

absl::StatusOr<void*> LoadDecoderModule(const DecoderModule& module) {
  void* const library = ::dlopen(module.file, RTLD_NOW | RTLD_LOCAL);
  void* const symbol = library != nullptr ? ::dlsym(library, module.symbol) : nullptr;
  if (symbol == nullptr) {
    // NOLINTNEXTLINE(concurrency-mt-unsafe): glibc keeps the text by thread
    const char* const why = ::dlerror();
    return absl::FailedPreconditionError(absl::StrCat(
        module.format, " files can't be read (",
        why != nullptr ? why : absl::StrCat("no ", module.symbol).c_str(), "); ", module.file,
        " belongs in lib/isoscope, beside the folder of the program: install it again"));
  }
  return symbol;
}

}  // namespace isoscope::source
