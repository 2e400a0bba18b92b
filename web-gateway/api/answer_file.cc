#include "web-gateway/api/answer_file.h"

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

namespace isoscope::gateway {

absl::StatusOr<std::string> MakeAnswerPath(absl::string_view file_name) {
  std::error_code error;
  std::string folder = (std::filesystem::temp_directory_path(error) / "isoscope-XXXXXX").string();
  // A private folder: no other user can put a file of this name there.
  if (error || mkdtemp(folder.data()) == nullptr) {
    return absl::FailedPreconditionError(
        absl::StrCat("no folder for temporary files can be made (TMPDIR): ",
                     error ? error.message() : std::system_category().message(errno)));
  }
  return absl::StrCat(folder, "/", file_name);
}

}  // namespace isoscope::gateway
