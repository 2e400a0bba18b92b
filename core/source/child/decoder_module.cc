#include "core/source/child/decoder_module.h"

#include <dlfcn.h>

#include <filesystem>
#include <string>
#include <system_error>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace isoscope::source {

absl::StatusOr<void*> LoadDecoderModule(const DecoderModule& module) {
  // Not by a run path: the loader takes that of its caller, which may be AddressSanitizer.
  std::error_code error;
  const std::filesystem::path program = std::filesystem::read_symlink("/proc/self/exe", error);
  if (error) {
    return absl::FailedPreconditionError(absl::StrCat(
        module.format, " files can't be read: their library ", module.file,
        " is found beside the program, and /proc/self/exe does not say where that is: ",
        error.message(), "; mount /proc"));
  }
  const std::string path =
      (program.parent_path().parent_path() / "lib" / "isoscope" / module.file).string();
  void* const library = ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
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
